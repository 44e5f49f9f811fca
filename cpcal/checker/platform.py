"""Where a platform can be that its controller commands to a pose, whose legs have uncertain parameters.

The controller's parameters x^ give each leg the reading ||v^|| - l^ at the pose P, R = R(q), v^ = P + R b^ - a^. With
other parameters x = (a, b, l) and a model error e of at most eps, the platform is at P + p, R(1, s) R where

    ||P + p + R(1, s) R b - a|| = ||v^|| - l^ + l + e      for each of its legs

A certificate of each leg claims the boxes of x, of x along seven directions, and of the *form* T(x) = ||P + R b - a||^2
- (||v^|| - l^ + l)^2 at every pose. Squared, less T, and times (1 + s.s), an equation is a polynomial in (p, s), with x
in the middle of its set, and small terms that hold both (p, s) and what x is off that middle.

About a centre (p, s) = c + w the linear parts of all legs' polynomials are J w. With a left inverse C of J we write
w = C y, where y = J w but for rounding: y_j is by how much leg j is longer. A box of y is bounded leg by leg, on a
smaller box each time; that of (p, s) would be far larger, for a platform can move where its legs hardly change. What x
is off in a direction that the measurements leave open mostly makes a leg longer or shorter as a whole, and so adds a
share of y_j, not of (p, s). Some of (p, s) may be *held* at 0 by the robot's mechanism, which is an assumption: a
planar robot of three legs moves in its plane.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from math import isqrt, prod
from pathlib import Path
from typing import Any

from .certificate import Accepted, Given
from .files import ACCURACY_NAME, content, leg_work, parsed
from .frames import AXES, rotation
from .leg import NAME, ExactCampaign
from .polynomial import Form, Spend, applied, cross, forms, inner, minus, plus, product, transposed
from .readers import Json, Refused, Stated, array, compare, exact, finite, many, reading, same, shown, up, whole
from .run import INFORMATION, LegCertificates, of_the_campaign

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")  # of (p, 2 s)
MOST_LEGS = 12  # the largest ||p|| is sought at 2^n corners
DIRECTION_BITS = 40
_LENGTH_BITS, _BOX_BITS = 40, 60
_PASSES = 100
_SETTLED = 0.98  # of a size: passes go on while some becomes smaller
_ROW_WORK, _PASS_WORK = 10_000, 10_000
ACCURACY_FORMAT = "cpcal-accuracy/12"
POSE_WORK = 1_000_000  # of a run, for each pose, beyond that of its legs
_BOUNDS = ("lo", "hi", "position_bound", "rotation_bound")
_POSITION, _QUATERNION, _PARAMETERS = (many(exact, count) for count in (3, 4, 7))
_DIRECTIONS = many(_PARAMETERS, 7)
_MOST = 2**60  # of numbers of which any will do
_ROUNDED, _TINY = 1.0 + 2.0**-30, 2.0**-200
Vector = Sequence[F]


@dataclass(frozen=True)
class Leg:
    """The controller's parameters, the box of those that are possible and their ranges `along` directions (any serve,
    best orthonormal ones), the model error, and the range of the form."""

    controller: Vector
    lo: Vector
    hi: Vector
    directions: Sequence[Vector]
    along: Sequence[tuple[F, F]]
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
        (*a, b1, b2, b3, offset), rest = forms(range(7)), length - controller[6]  # what the controller reads
        z, b, square = minus(a, self.position), (b1, b2, b3), (offset + rest) * (offset + rest)
        found = (inner(z, z) + inner(b, b) - square) * n - inner(z, applied(self.turn, b)) * 2
        scale = self.scale(length)
        return tuple((m, c / scale) for m, c in found.terms.items())


def direction_form(direction: Vector) -> Given:
    """x along a direction."""
    if any(abs(v) > 1 or (v * 2**DIRECTION_BITS).denominator > 1 for v in direction):
        raise Refused(f"states a direction that is no vector of multiples of 2^-{DIRECTION_BITS} up to 1")
    return tuple(((i,), v) for i, v in enumerate(direction) if v)


def pose_bounds(
    pose: Commanded, legs: Sequence[Leg], reach: F, half_turn: F, center: Vector, inverse: Sequence[Vector],
    spend: Spend, held: Sequence[int] = (),
) -> PoseBounds | None:  # fmt: skip
    """Of all (p, s) with |p_i| <= reach (mm), |s_i| <= half_turn, and 0 where `held`, that the legs allow; None where
    nothing is proved. `center` of (p, s), and a left `inverse` of the equations' slopes there over |q|^2, in mm: what
    they prove holds whatever they are."""
    asked = [F(0) if i in held else reach if i < 3 else half_turn for i in range(6)]
    center, inverse = list(map(_cut, center)), [[_cut(v) / pose.norm for v in line] for line in inverse]
    forms = [AboutCenter(LegEquation(pose, leg, spend), center) for leg in legs]
    bounds = _legwise(forms, center, inverse, asked, spend)
    if bounds is None:
        return None
    moves = [[(w * a, w * b) for w, (a, b) in zip(line, bounds, strict=True)] for line in inverse]
    ends = [[sum(map(of, pairs), c) for c, pairs in zip(center, moves, strict=True)] for of in (min, max)]
    lo = [max(_cut(a), -most) for a, most in zip(ends[0], asked, strict=True)]
    hi = [min(-_cut(-b), most) for b, most in zip(ends[1], asked, strict=True)]
    if any(a > b or (most and most in (-a, b)) for a, b, most in zip(lo, hi, asked, strict=True)):
        return None
    box = [max(-a, b) for a, b in zip(lo, hi, strict=True)]
    position, turn = (
        min(_longest(center[three], moves[three]), _root(inner(box[three], box[three])))
        for three in (slice(3), slice(3, 6))
    )
    return PoseBounds(lo, hi, position, turn)


class LegEquation:
    """The equation of a leg, times |q|^2: a polynomial in (p, s) is (1 + s.s) times what lies in `value`, but for terms
    with what x is off the middle of its set, which `beside` bounds."""

    def __init__(self, pose: Commanded, leg: Leg, spend: Spend) -> None:
        spend(_ROW_WORK)
        n, believed = pose.norm, pose.length(leg.controller)
        middle = applied(transposed(leg.directions), [(a + b) / 2 for a, b in leg.along])
        off = [max(b - x, x - a) for x, a, b in zip(middle, leg.lo, leg.hi, strict=True)]
        self._norm, self._arm = n, applied(pose.turn, middle[3:6])
        self._place = minus(pose.position, middle[:3])
        self._sizes = _sizes(self._place), _sizes(self._arm)
        # x is off by the directions, each times how far along it, and by what these lack of being orthonormal
        there, squared = applied(leg.directions, middle), product(transposed(leg.directions), leg.directions)
        self.far = _sizes([max(b - x, x - a) for x, (a, b) in zip(there, leg.along, strict=True)])
        lost = [inner([abs(v - (i == j)) for j, v in enumerate(row)], off) for i, row in enumerate(squared)]
        self._off, self._lost = (
            (_sizes(by[:3]), [inner(map(float, map(abs, row)), _sizes(by[3:6])) for row in pose.turn])
            for by in (off, lost)
        )
        # in (p, s) at 0, along each direction: a moves by `base`, and |q|^2 R b by `arm`
        self.gradients = []
        for direction in leg.directions:
            base, arm = direction[:3], applied(pose.turn, direction[3:6])
            turned = minus(cross(arm, self._place), cross(self._arm, base))
            self.gradients.append([2 * (b - n * a) for a, b in zip(base, arm, strict=True)] + [4 * v for v in turned])
        scale, length = pose.scale(believed), believed - leg.controller[6]
        longest = max(abs(length + leg.lo[6]), abs(length + leg.hi[6]))
        error = leg.eps + F(2, 2**_LENGTH_BITS)
        most = n * error * (2 * longest + error)
        self.value = -leg.form[1] * scale - most, -leg.form[0] * scale + most

    def about(self, center: Vector) -> Form:
        """(1 + s.s) (|p|^2 + 2 p.v - h) + 4 (w + p).(s x r + s x (s x r)) + h, with the middle h of `value`, in what
        (p, s) is off a centre."""
        n, r, h = self._norm, self._arm, (self.value[0] + self.value[1]) / 2
        p, s = plus(forms(range(3)), center[:3]), plus(forms(range(3, 6)), center[3:])
        once, v = cross(s, r), plus([n * w for w in self._place], r)
        swung = inner(plus(self._place, p), plus(once, cross(s, once)))
        found: Form = (inner(s, s) + 1) * (inner(p, p) * n + inner(p, v) * 2 - h) + swung * 4 + h
        return found

    def beside(self, z: Sequence[float], linear: Sequence[float]) -> float:
        """At most so large is all else, for components of (p, s) at most as large as `z`, and products with the
        `gradients` at most as large as `linear`.

        Nothing here is negative: no sum or product is wrong by more than a few hundred roundings.
        """
        (off, swing), (lost, stray), (place, arm), n = self._off, self._lost, self._sizes, float(self._norm)
        p, s = z[:3], z[3:]
        square, once = inner(s, s), _crossed(s, swing)
        more = inner(p, [n * a + b for a, b in zip(lost, stray, strict=True)])
        more += 2.0 * (inner(place, _crossed(s, stray)) + inner(lost, _crossed(s, arm)))
        more += square * inner(p, [n * a + b for a, b in zip(off, swing, strict=True)])
        more += 2.0 * (inner(plus(p, off), once) + inner(off, _crossed(s, _crossed(s, arm))))
        more += 2.0 * inner(plus(plus(place, p), off), _crossed(s, once))
        rest = inner(self.far, linear) + 2.0 * more + float(self.value[1] - self.value[0]) * square
        return float(rest)


class AboutCenter:
    """A row about a centre: slopes.w + (terms of w of degree two and more) is in `value`, but for what is beside."""

    def __init__(self, row: LegEquation, center: Vector) -> None:
        self.row, form = row, row.about(center).terms
        constant = form.pop((), F(0))
        self.value = row.value[0] - constant, row.value[1] - constant
        self.slopes, self.curved = [form.pop((i,), F(0)) for i in range(6)], [[F(0)] * 6 for _ in range(6)]
        self._higher: list[tuple[float, tuple[int, ...]]] = []
        for held, c in form.items():
            if len(held) == 2:
                for i, j in (held, held[::-1]):
                    self.curved[i][j] = c / (1 + (i != j))
            else:
                self._higher.append((float(abs(c)), held))

    def by_legs(self, inverse: Sequence[Vector], center: Vector) -> None:
        """What is linear or of degree two in w, in the legs' coordinates y, w = C y."""
        columns = transposed(inverse)
        self._squares = [_Square(self.curved), _Square(product(columns, product(self.curved, inverse)))]
        self._shares = [
            (_sizes(k), float(abs(inner(k, center))), _sizes(applied(columns, k))) for k in self.row.gradients
        ]

    def spread(self, z: Sequence[float], w: Sequence[float], y: Sequence[float]) -> tuple[F, F]:
        """How far below and above its linear part it may be, where (p, s), w and y are at most so large."""
        linear = [min(inner(k, z), at + inner(by, y)) for k, at, by in self._shares]
        rest = self.row.beside(z, linear) + sum(c * prod(w[i] for i in held) for c, held in self._higher)
        of_w, of_y = (square.most(v) for square, v in zip(self._squares, (w, y), strict=True))
        below, above = (F((min(pair) + rest) * _ROUNDED + _TINY) for pair in zip(of_w, of_y, strict=True))
        return below, above


class _Square:
    """v' H v for symmetric H."""

    def __init__(self, matrix: Sequence[Vector]) -> None:
        self._own = [float(row[i]) for i, row in enumerate(matrix)]
        self._mixed = [[0.0 if i == j else float(abs(v)) for j, v in enumerate(row)] for i, row in enumerate(matrix)]

    def most(self, v: Sequence[float]) -> tuple[float, float]:
        """How far below and above 0 it is, for components at most so large."""
        mixed = sum(a * inner(row, v) for a, row in zip(v, self._mixed, strict=True))
        return tuple(
            mixed + sum(max(sign * c, 0.0) * a * a for c, a in zip(self._own, v, strict=True)) for sign in (-1, 1)
        )


def _legwise(
    forms: Sequence[AboutCenter], center: Vector, inverse: Sequence[Vector], asked: Vector, spend: Spend
) -> list[tuple[F, F]] | None:
    """A box of y, for all (p, s) = c + C y in the box that is asked for; None where there is none.

    y is J (C J)^-1 w. With E = I - C J and |E| r <= r / 2 for some r >= |w|, it is J w but for J E (C J)^-1 w, which is
    at most 2 |J E| r.
    """
    reach, slopes = [abs(c) + most for c, most in zip(center, asked, strict=True)], [form.slopes for form in forms]
    lost = [[F(i == k) - v for k, v in enumerate(row)] for i, row in enumerate(product(inverse, slopes))]
    if any(2 * inner(map(abs, row), reach) > most for row, most in zip(lost, reach, strict=True)):
        return None
    rounding = [2 * inner(map(abs, row), reach) for row in product(slopes, lost)]
    longest = [inner(map(abs, row), reach) + more for row, more in zip(slopes, rounding, strict=True)]
    for form in forms:
        form.by_legs(inverse, center)
    bounds, weights = [(-most, most) for most in longest], [_sizes(line) for line in inverse]
    y, w, z = map(_sizes, (longest, reach, asked))
    for _ in range(_PASSES):
        spend(_PASS_WORK)
        for k, (form, more, (lo, hi)) in enumerate(zip(forms, rounding, bounds, strict=True)):
            below, above = form.spread(z, w, y)
            lo, hi = max(lo, _cut(form.value[0] - above - more)), min(hi, -_cut(-form.value[1] - below - more))
            if lo > hi:
                return None
            bounds[k] = lo, hi
        before, y = y, [up(max(-lo, hi)) for lo, hi in bounds]
        w = [min(a, inner(line, y) * _ROUNDED + _TINY) for a, line in zip(w, weights, strict=True)]
        z = [min(a, (float(abs(c)) + b) * _ROUNDED) for a, c, b in zip(z, center, w, strict=True)]
        if all(a > _SETTLED * b for a, b in zip(y, before, strict=True)):
            break
    return bounds


def _longest(center: Vector, moves: Sequence[Sequence[tuple[F, F]]]) -> F:
    """An upper bound of the norm of three unknowns, which is largest at a corner of the box of y."""
    sums = [center]
    for ends in transposed(moves):
        sums = [plus(one, [pair[side] for pair in ends]) for one in sums for side in (0, 1)]
    return _root(max(inner(one, one) for one in sums))


def _root(square: F) -> F:
    """Rounded up."""
    return F(isqrt((square * 4**_BOX_BITS).__ceil__()) + 1, 2**_BOX_BITS)


def _cut(value: F) -> F:
    """Rounded down."""
    return F((value * 2**_BOX_BITS).__floor__(), 2**_BOX_BITS)


def _sizes(values: Iterable[F]) -> list[float]:
    return [float(abs(v)) for v in values]


def _crossed(p: Sequence[float], q: Sequence[float]) -> list[float]:
    return [p[i - 2] * q[i - 1] + p[i - 1] * q[i - 2] for i in AXES]


# runs ---------------------------------------------------------------------------------------------------------------


def stated(bounds: PoseBounds) -> tuple[tuple[float, ...], tuple[float, ...], float, float]:
    """(p, 2 s) from and to, mm and rad, and the largest ||p|| and angle, as a result states them: rounded outward."""
    twice = [1] * 3 + [2] * 3
    lo = tuple(-up(-f * v) for f, v in zip(twice, bounds.lo, strict=True))
    hi = tuple(up(f * v) for f, v in zip(twice, bounds.hi, strict=True))
    return lo, hi, up(bounds.position), up(2 * bounds.half_turn)


def _any(value: Any) -> F:
    if abs(exact(value)) >= _MOST:
        raise Refused(f"holds {shown(value)} where a smaller number is needed")
    return F(value)


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
    directions = list[list[Vector]]()
    refuted = not all(box["lo"] for box in boxes)
    for leg, (row, box) in enumerate(zip(controller, boxes, strict=True), start=1):
        accepted = certificates.accepted(box["certificate"])
        # of a run without poses nothing is said of the forms
        forms: Sequence[Given] = accepted.forms
        if not refuted:
            directions.append(_DIRECTIONS(box["directions"]))
            forms = [*(pose.form(row) for pose in poses), *map(direction_form, directions[-1])]
        compare(_of_the_set(leg, box, accepted, exact(result["delta"]), campaign, forms))
        enclosed.append(accepted)
        claim = "there are none" if accepted.claims.infeasible else "they lie in the box"
        yield True, f"parameters of leg {leg}, model error up to {float(box['eps'])!r} mm: PROVED, {claim}"
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
        for row, accepted, own in zip(controller, enclosed, directions, strict=True):
            lo, hi = accepted.claims.enclosure or ((), ())
            ranges = list(zip(lo[8:], hi[8:], strict=True))
            at.append(Leg(row, lo[:7], hi[:7], own, ranges[len(poses) :], accepted.lo[7], ranges[k]))
        about = many(_any, 6)(one[INFORMATION]["center"]), many(many(_any, legs), 6)(one[INFORMATION]["inverse"])
        bounds = pose_bounds(pose, at, reach, turn / 2, *about, certificates.budget.spend, held)
        if bounds is None:
            raise Refused(f"states bounds of pose {k} that are not proved")
        same(f"bounds of pose {k}", [one[key] for key in _BOUNDS], stated(bounds))
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
    claims, there = accepted.claims, [dict(form) for form in accepted.forms]
    yield "leg", (box["leg"], accepted.leg, accepted.model), (leg, leg, "plain")
    count, out = len(campaign), [campaign.place.get(name, -1) for name in box["left_out"]]
    kept = [k for k in range(count + len(forms)) if k not in out]
    yield "number of measurements", accepted.count, count + len(forms)
    yield "measurements", (list(accepted.chosen), -1 in out, len(set(out))), (kept, False, len(out))
    yield "forms of poses", there, [dict(form) for form in forms]
    yield "eps", [box["eps"]] * 3, (claims.cap, accepted.lo[7], accepted.hi[7])
    for lo, hi in zip(accepted.lo[:7], accepted.hi, strict=False):
        slack = (abs(lo) + abs(hi)) / 2**49
        yield "delta", 2 * delta <= hi - lo <= 2 * delta + slack, True
    sides = ([], []) if claims.infeasible or claims.enclosure is None else claims.enclosure
    yield "box", [box["lo"], box["hi"]], [side[:7] for side in sides]
    yield "claim", (claims.infeasible or claims.enclosure is not None, claims.point), (True, None)
