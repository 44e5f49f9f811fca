"""Where a platform can be that its controller commands to a pose, whose legs have uncertain parameters.

The controller's parameters x^ give each leg the reading ||v^|| - l^ at the pose P, R = R(q), v^ = P + R b^ - a^. With
other parameters x = (a, b, l) and a model error e of at most eps, the platform is at P + p, R(1, s) R where

    ||P + p + R(1, s) R b - a|| = ||v^|| - l^ + l + e      for each of its legs

A certificate of each leg claims the boxes of x, and of the *form* T(x) = ||P + R b - a||^2 - (||v^|| - l^ + l)^2 at
every pose. Squared, less T, and times (1 + s.s), an equation is a polynomial in (p, s), with x at the middle of its
box, and small terms that hold both (p, s) and what x is off that middle. On a box of (p, s) their sizes are bounded;
then a left inverse of the linear parts gives each unknown by itself, on a smaller box. Some of (p, s) may be *held* at
0 by the robot's mechanism, which is an assumption: a planar robot of three legs moves in its plane.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from math import isqrt
from operator import mul
from pathlib import Path
from typing import NamedTuple

from .certificate import Accepted, Given, polynomial
from .files import ACCURACY_NAME, content, leg_work, parsed
from .frames import AXES, rotation
from .leg import NAME, ExactCampaign
from .polynomial import (
    Polynomial,
    Spend,
    applied,
    combined,
    dyadics,
    inner,
    least,
    minus,
    plus,
    signed,
    substituted,
    transposed,
    unknown,
)
from .readers import Json, Refused, Stated, array, compare, exact, finite, many, reading, same, up, whole
from .rule import Box, Unknowns
from .run import INFORMATION, LegCertificates, of_the_campaign

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")  # of (p, 2 s)
MOST_LEGS = 12  # the largest ||p|| is sought at 2^n corners
_LENGTH_BITS, _BOX_BITS, _WEIGHT_BITS = 40, 60, 50
_PASSES = 20
_SETTLED = F(95, 100)  # of a width: passes go on while some becomes smaller
_PASS_WORK = 60_000
ACCURACY_FORMAT = "cpcal-accuracy/8"
POSE_WORK = 1_000_000  # of a run, for each pose, beyond that of its legs
_BOUNDS = ("lo", "hi", "position_bound", "rotation_bound")
_POSITION, _QUATERNION, _PARAMETERS = (many(exact, count) for count in (3, 4, 7))
_ROUNDED, _TINY = 1.0 + 2.0**-30, 2.0**-200
Vector = Sequence[F]


@dataclass(frozen=True)
class Leg:
    """The controller's parameters, the box of those that are possible, the model error, and the range of the form."""

    controller: Vector
    lo: Vector
    hi: Vector
    eps: F
    form: tuple[F, F]


@dataclass(frozen=True)
class PoseBounds:
    """Of all (p, s): a box in mm and of halves of rotation vectors, and how large ||p|| and ||s|| can be."""

    lo: Vector
    hi: Vector
    position: F
    half_turn: F


class Commanded:
    """A pose as the controller commands it: exact numbers."""

    def __init__(self, position: Vector, quaternion: Vector) -> None:
        self.position = position
        self.turn, self.norm = rotation(quaternion)  # R |q|^2 and |q|^2

    def length(self, controller: Vector) -> F:
        """Of the controller's leg, at most 2^-40 mm too short."""
        arm = [r / self.norm for r in applied(self.turn, controller[3:6])]
        leg = plus(minus(self.position, controller[:3]), arm)
        square = inner(leg, leg)
        return F(isqrt((square * 4**_LENGTH_BITS).__floor__()), 2**_LENGTH_BITS)

    def scale(self, length: F) -> F:
        """The power of two by which T |q|^2 is divided, for a leg of that length: what is left is about in mm."""
        return F(2) ** (2 * self.norm * max(length, F(1))).__floor__().bit_length()

    def form(self, controller: Vector) -> Given:
        """T |q|^2 over its scale, in the unknowns x."""
        n, length = self.norm, self.length(controller)
        scale = self.scale(length)
        rest = length - controller[6]  # what the controller reads
        terms: dict[tuple[int, ...], F] = {(): n * (inner(self.position, self.position) - rest * rest)}
        terms[6,], terms[6, 6] = -2 * n * rest, F(-n)
        for i, back in enumerate(applied(transposed(self.turn), self.position)):
            terms[i,], terms[i, i], terms[3 + i, 3 + i] = -2 * n * self.position[i], F(n), F(n)
            terms[3 + i,] = F(2 * back)
            terms |= {(i, 3 + j): F(-2 * self.turn[i][j]) for j in AXES}
        return tuple((m, c / scale) for m, c in terms.items() if c)


def pose_bounds(
    pose: Commanded, legs: Sequence[Leg], reach: F, half_turn: F, spend: Spend, held: Sequence[int] = ()
) -> PoseBounds | None:
    """Of all (p, s) with |p_i| <= reach (mm), |s_i| <= half_turn, and 0 where `held`, that the legs allow; None where
    nothing is proved."""
    asked = (reach,) * 3 + (half_turn,) * 3
    box, free = Box(tuple(-v for v in asked), asked), [i for i in range(6) if i not in held]
    rows, found = [_Row(pose, leg, spend, held) for leg in legs], None
    for _ in range(_PASSES):
        spend(_PASS_WORK)
        found = _pass(rows, box, free, spend)
        if found is None:
            return None
        before, box = box, Box(tuple(map(max, box.lo, found.lo)), tuple(map(min, box.hi, found.hi)))
        if any(a > b for a, b in zip(box.lo, box.hi, strict=True)):
            return None
        ends = zip(before.lo, before.hi, box.lo, box.hi, strict=True)
        if all(d - c > _SETTLED * (b - a) for a, b, c, d in ends):
            break
    if found is None or any(asked[i] in (-box.lo[i], box.hi[i]) for i in free):
        return None
    box = Box(*(tuple(v if i in free else F(0) for i, v in enumerate(side)) for side in (box.lo, box.hi)))
    position, turn = (_longest(found, rows, box, slice(k, k + 3)) for k in (0, 3))
    return PoseBounds(box.lo, box.hi, position, turn)


class _Solved(NamedTuple):
    """Each unknown is the weighted values of the rows, and something in `rest`; so it lies from lo to hi."""

    weights: Sequence[Vector]
    rest: Sequence[tuple[F, F]]
    lo: Vector
    hi: Vector


class _Row:
    """The equation of a leg, times |q|^2: `polynomial` in (p, s) is (1 + s.s) times what lies in `value`, but for terms
    with what x is off the middle of its box, which `beside` bounds."""

    def __init__(self, pose: Commanded, leg: Leg, spend: Spend, held: Sequence[int] = ()) -> None:
        n, believed = pose.norm, pose.length(leg.controller)
        middle, off = ([v / 2 for v in way(leg.hi, leg.lo)] for way in (plus, minus))
        self._norm, self._arm = n, applied(pose.turn, middle[3:6])
        self._place = minus(pose.position, middle[:3])
        sizes = (off[:3], [inner(map(abs, row), off[3:6]) for row in pose.turn], self._place, self._arm)
        self._sizes = [_sizes(values) for values in sizes]
        scale, length = pose.scale(believed), believed - leg.controller[6]
        longest = max(abs(length + leg.lo[6]), abs(length + leg.hi[6]))
        error = leg.eps + F(2, 2**_LENGTH_BITS)
        most = n * error * (2 * longest + error)
        self.value = -leg.form[1] * scale - most, -leg.form[0] * scale + most
        self.polynomial = self._formed(spend, set(held))

    def _formed(self, spend: Spend, held: set[int]) -> Polynomial:
        """(1 + s.s) (|p|^2 + 2 p.v - h) + 4 (w + p).(s x r + s x (s x r)) + h, with the middle h of `value`."""
        n, r, w, h = self._norm, self._arm, self._place, (self.value[0] + self.value[1]) / 2
        terms: dict[tuple[int, ...], F] = {}

        def add(m: tuple[int, ...], c: F) -> None:
            key = tuple(sorted(m))
            terms[key] = terms.get(key, F(0)) + c

        for i in AXES:
            v = n * w[i] + r[i]
            for squared in ((), *((3 + k, 3 + k) for k in AXES)):
                add((i, i, *squared), F(n))
                add((i, *squared), 2 * v)
            add((3 + i, 3 + i), -h)
            j, k = (i + 1) % 3, (i + 2) % 3
            # component i of s x r + s (s.r) - (s.s) r
            turned: list[tuple[tuple[int, ...], F]] = [((3 + j,), r[k]), ((3 + k,), -r[j])]
            turned += [((3 + i, 3 + m), r[m]) for m in (j, k)] + [((3 + m, 3 + m), -r[i]) for m in (j, k)]
            for monomial, c in turned:
                add(monomial, 4 * w[i] * c)
                add((*monomial, i), 4 * c)
        return polynomial(tuple((m, c) for m, c in terms.items() if c and held.isdisjoint(m)), spend)

    def beside(self, p: Sequence[float], s: Sequence[float]) -> F:
        """At most so large is all else, for (p, s) at most so large.

        Nothing here is negative: no sum or product is wrong by more than a few hundred roundings.
        """
        off, swing, place, arm = self._sizes
        n, square = float(self._norm), math.fsum(v * v for v in s)
        shift = math.fsum(q * (n * a + b) for q, a, b in zip(p, off, swing, strict=True))
        away = zip(place, p, off, _turning(s, swing), strict=True)
        swung = math.fsum((w + q + a) * moved for w, q, a, moved in away)
        turned = math.fsum(a * moved for a, moved in zip(off, _turning(s, arm), strict=True))
        rest = float(self.value[1] - self.value[0]) * square
        return F((2.0 * (1.0 + square) * shift + 4.0 * (swung + turned) + rest) * _ROUNDED + _TINY)


def _pass(rows: Sequence[_Row], box: Box, free: Sequence[int], spend: Spend) -> _Solved | None:
    """What the rows say of the poses in a box, whose `free` unknowns are not 0; None where the platform is singular."""
    x = Unknowns(box, spend)
    forms = [substituted(row.polynomial, x.images) for row in rows]
    inverse = _left_inverse([[_slope(form, i) / float(x.radius(i)) for i in free] for form in forms])
    if inverse is None:
        return None
    lines = dict(zip(free, inverse, strict=True))
    weights = [lines.get(i, [F(0)] * len(rows)) for i in range(6)]
    most = _sizes([max(-box.lo[i], box.hi[i]) if i in lines else F(0) for i in range(6)])
    beside = [row.beside(most[:3], most[3:]) for row in rows]
    mask, parts, lo, hi = signed(6), list[tuple[F, F]](), list(box.lo), list(box.hi)
    for i, line in enumerate(weights):
        if i not in lines:
            parts.append((F(0), F(0)))
            continue
        whole = dyadics(line)
        one = x.variable(7 + i, x.center(i), x.radius(i))
        rest = combined(
            [(1, one), *((-w, form.times(1, -whole.power)) for w, form in zip(whole.values, forms, strict=True))], spend
        )
        given = sum((abs(w) * m for w, m in zip(line, beside, strict=True)), F(0))
        ends = least(rest, mask) - given, given - least(rest.times(-1), mask)
        parts.append(ends)
        values = [sorted((w * a, w * b)) for w, (a, b) in zip(line, (row.value for row in rows), strict=True)]
        lo[i] = _cut(ends[0] + sum(low for low, _ in values))
        hi[i] = -_cut(-ends[1] - sum(high for _, high in values))
    return _Solved(weights, parts, lo, hi)


def _longest(found: _Solved, rows: Sequence[_Row], box: Box, three: slice) -> F:
    """An upper bound of the norm of three unknowns in a box. What the values alone give is largest at a corner."""
    rest = found.rest[three]
    sums = [[(a + b) / 2 for a, b in rest]]
    for j, row in enumerate(rows):
        weights = [line[j] for line in found.weights[three]]
        sums = [[c + w * v for c, w in zip(one, weights, strict=True)] for one in sums for v in row.value]
    off = [(b - a) / 2 for a, b in rest]
    most = [max(-a, b) for a, b in zip(box.lo[three], box.hi[three], strict=True)]
    return min(_root(max(inner(one, one) for one in sums)) + _root(inner(off, off)), _root(inner(most, most)))


def _slope(form: Polynomial, i: int) -> float:
    c = form.terms.get(unknown(i), 0)
    return float(F(c) * F(2) ** form.exponent)


def _left_inverse(matrix: list[list[float]]) -> list[list[F]] | None:
    """Nearly, as short numbers: whatever they are, what they prove holds. With more rows than columns that of least
    squares."""
    n, columns = len(matrix[0]), list(zip(*matrix, strict=True))
    if len(matrix) > n:
        square = _left_inverse([[sum(map(mul, a, b)) for b in columns] for a in columns])
        return square and [[F(sum(map(mul, map(float, line), row))) for row in matrix] for line in square]
    lines = [[*line, *(float(i == j) for j in range(n))] for i, line in enumerate(matrix)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(lines[i][k]))
        lines[k], lines[pivot] = lines[pivot], lines[k]
        if not abs(lines[k][k]) > 1e-300:
            return None
        lines[k] = [v / lines[k][k] for v in lines[k]]
        for i in range(n):
            if i != k:
                lines[i] = [a - lines[i][k] * b for a, b in zip(lines[i], lines[k], strict=True)]
    try:
        return [[F(v) for v in line[n:]] for line in lines]
    except (ValueError, OverflowError):
        return None


def _root(square: F) -> F:
    """Rounded up."""
    return F(isqrt((square * 4**_BOX_BITS).__ceil__()) + 1, 2**_BOX_BITS)


def _cut(value: F) -> F:
    """Rounded down."""
    return F((value * 2**_BOX_BITS).__floor__(), 2**_BOX_BITS)


def _sizes(values: Iterable[F]) -> list[float]:
    return [float(abs(v)) for v in values]


def _turning(s: Sequence[float], r: Sequence[float]) -> list[float]:
    """At most so large are the components of s x r + s x (s x r)."""
    once = _crossed(s, r)
    return plus(once, _crossed(s, once))


def _crossed(p: Sequence[float], q: Sequence[float]) -> list[float]:
    return [p[i - 2] * q[i - 1] + p[i - 1] * q[i - 2] for i in AXES]


# runs ---------------------------------------------------------------------------------------------------------------


def stated(bounds: PoseBounds) -> tuple[tuple[float, ...], tuple[float, ...], float, float]:
    """(p, 2 s) from and to, mm and rad, and the largest ||p|| and angle, as a result states them: rounded outward."""
    twice = [1] * 3 + [2] * 3
    lo = tuple(-up(-f * v) for f, v in zip(twice, bounds.lo, strict=True))
    hi = tuple(up(f * v) for f, v in zip(twice, bounds.hi, strict=True))
    return lo, hi, up(bounds.position), up(2 * bounds.half_turn)


def check_accuracy(folder: Path, *, work: int = 0) -> list[tuple[bool, str]]:
    """For each statement of accuracy.json whether it is accepted, and a sentence. Raises Unusable, Refused."""
    with reading(ACCURACY_NAME):
        result = parsed(content(folder / ACCURACY_NAME), finite)
        same("format", result["format"], ACCURACY_FORMAT)
        return list(_statements(folder, result, ExactCampaign(folder / NAME), work))


def _statements(folder: Path, result: Json, campaign: ExactCampaign, work: int) -> Iterator[tuple[bool, str]]:
    count, legs = len(campaign), campaign.legs
    compare(of_the_campaign(result["campaign"], campaign))
    held = [whole(6)(one) for one in array(result["held"])]
    if legs > MOST_LEGS or len(set(held)) < len(held) or 6 - len(held) > legs:
        raise Refused("speaks of poses that its legs do not determine, or of too many legs")
    poses = [Commanded(_POSITION(one["position"]), _QUATERNION(one["quaternion"])) for one in result["poses"]]
    controller, boxes = many(_PARAMETERS, legs)(result["parameters"]), array(result["legs"], legs)
    budget = work or leg_work(1, legs * count) + POSE_WORK * len(poses)
    certificates, enclosed = LegCertificates(folder, campaign, budget), list[Accepted]()
    refuted = not all(box["lo"] for box in boxes)
    for leg, (row, box) in enumerate(zip(controller, boxes, strict=True), start=1):
        accepted = certificates.proved(box["certificate"])
        # of a run without poses nothing is said of the forms
        forms = accepted.forms if refuted else [pose.form(row) for pose in poses]
        compare(_of_the_set(leg, box, accepted, exact(result["delta"]), campaign, forms))
        enclosed.append(accepted)
        claim = "there are none" if accepted.claims.infeasible else "they lie in the box"
        yield True, f"parameters of leg {leg}, model error up to {float(exact(box['eps']))!r} mm: PROVED, {claim}"
    certificates.names_all([box["certificate"] for box in boxes])
    if refuted:
        same("poses", result["poses"], [])
        return
    reach, turn = many(exact, 2)(result["within"])
    if not (0 < reach < 10**6 and 0 < turn <= 1):
        raise Refused("speaks of no poses within its box")
    proved = []
    for k, (one, pose) in enumerate(zip(result["poses"], poses, strict=True)):
        if one["proved"] is not True:
            same(f"bounds of pose {k}", (one["proved"], *(one.get(key) for key in _BOUNDS)), (False, *[None] * 4))
            continue
        at = []
        for row, accepted in zip(controller, enclosed, strict=True):
            lo, hi = accepted.claims.enclosure or ((), ())
            at.append(Leg(row, lo[:7], hi[:7], accepted.lo[7], (lo[8 + k], hi[8 + k])))
        bounds = pose_bounds(pose, at, reach, turn / 2, certificates.budget.spend, held)
        if bounds is None:
            raise Refused(f"states bounds of pose {k} that are not proved")
        *sides, position_bound, rotation_bound = stated(bounds)
        said = [many(exact, 6)(one[key]) for key in _BOUNDS[:2]], [exact(one[key]) for key in _BOUNDS[2:]]
        same(
            f"bounds of pose {k}",
            said,
            ([tuple(map(F, side)) for side in sides], [F(position_bound), F(rotation_bound)]),
        )
        proved.append(bounds)
    if proved:
        position, angle = max(one.position for one in proved), 2 * max(one.half_turn for one in proved)
        most_shown = [(value * 10**6).__ceil__() / 10**6 for value in (position, angle)]
        inside = f"+-{float(reach)!r} mm and +-{float(turn)!r} rad"
        if held:
            inside += f", its {', '.join(COORDINATES[i] for i in sorted(held))} as commanded,"
        yield (
            True,
            f"{len(proved)} of {len(poses)} poses: PROVED, every pose within {inside} that the legs allow is within "
            f"{most_shown[0]} mm and {most_shown[1]} rad",
        )
    if result[INFORMATION]["workspace"] is not None:
        yield True, "no certificate holds the bounds of the workspace's cells"


def _of_the_set(
    leg: int, box: Json, accepted: Accepted, delta: F, campaign: ExactCampaign, forms: Sequence[Given]
) -> Stated:
    claims, eps, there = accepted.claims, exact(box["eps"]), [dict(form) for form in accepted.forms]
    yield "leg", (box["leg"], accepted.leg, accepted.model), (leg, leg, "plain")
    count, out = len(campaign), [campaign.place.get(name, -1) for name in box["left_out"]]
    kept = [k for k in range(count + len(forms)) if k not in out]
    yield "number of measurements", accepted.count, count + len(forms)
    yield "measurements", (list(accepted.chosen), -1 in out, len(set(out))), (kept, False, len(out))
    yield "forms of poses", there, [dict(form) for form in forms]
    yield "eps", (eps, eps, eps), (claims.cap, accepted.lo[7], accepted.hi[7])
    for lo, hi in zip(accepted.lo[:7], accepted.hi, strict=False):
        slack = (abs(lo) + abs(hi)) / 2**49
        yield "delta", 2 * delta <= hi - lo <= 2 * delta + slack, True
    sides = ([], []) if claims.infeasible or claims.enclosure is None else claims.enclosure
    yield "box", [[exact(v) for v in box[side]] for side in ("lo", "hi")], [list(side[:7]) for side in sides]
    yield "claim", (claims.infeasible or claims.enclosure is not None, claims.point), (True, None)
