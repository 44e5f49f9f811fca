"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from array import array as array_of
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property, lru_cache
from hashlib import sha256
from itertools import chain, repeat
from math import hypot, nan
from operator import add, mul
from pathlib import Path
from typing import Any, NamedTuple

from .files import content, parsed
from .polynomial import (
    FIELD,
    READINGS,
    Polynomial,
    Remainder,
    applied,
    constant,
    dyadics,
    inner,
    minus,
    plus,
    rotation_rows,
    shortened,
    signed,
    unknown,
)
from .readers import Json, Refused, array, decimals, shown, text
from .rule import ENDS, SIDES, Constraint, Problem, Unknowns, beyond

# a formula, traced once ----------------------------------------------------------------------------------------------
#
# The rows of a leg have the same monomials for every measurement on every box; only their coefficients differ. So the
# formula runs once on `Traced` polynomials, which know places instead of coefficients; the trace notes what becomes of
# these. Whoever runs it gets the coefficients, and looks up no monomial: for many measurements side by side.
#
# Each number that is given is whole over one power of two, 2 ** unit; the first of them is 2 ** unit itself, the number
# one. A coefficient that is a product of d of them is whole over 2 ** (d unit): d is its degree.

Column = int | list[int]  # of all measurements the same, or one for each
Note = int | tuple[tuple[int, int], ...]
Sums = dict[tuple[int, int], int]  # the sum of factor * v[i] * v[j]


class Trace:
    """Notes, each of the next place: a whole number, or pairs (i, j) whose products v[i] * v[j] are added.

    `shared`: whether the numbers that are given, which come first, are the same for all measurements.
    """

    def __init__(self, shared: Sequence[bool]) -> None:
        self.shared = list(shared)  # of all places
        self.count, self.notes = len(shared), list[Note]()
        self._known: dict[Note, int] = {}
        self.work = 0  # products
        self.unit = self.place(1)

    def place(self, note: Note) -> int:
        if note not in self._known:
            self._known[note] = len(self.shared)
            self.notes.append(note)
            self.shared.append(isinstance(note, int) or all(self.shared[i] and self.shared[j] for i, j in note))
            self.work += 1 if isinstance(note, int) else len(note)
        return self._known[note]

    def settled(self, sums: Sums) -> tuple[int, int]:
        """Place and factor of a sum."""
        if len(sums) == 1 and self.unit in next(iter(sums)):
            (((i, j), factor),) = sums.items()
            return (j if i == self.unit else i), factor
        return self.place(tuple((self.multiple(i, factor), j) for (i, j), factor in sums.items())), 1

    def multiple(self, i: int, factor: int) -> int:
        """The place of factor * v[i]."""
        if factor == 1:
            return i
        number = self.place(factor)
        return number if i == self.unit else self.place(((number, i),))

    def run(self, given: Sequence[Column]) -> list[Iterable[int]]:
        """The numbers at all places; shared ones without end."""
        v = [column if isinstance(column, int) else 0 for column in given]
        w: list[Iterable[int]] = [repeat(column) if isinstance(column, int) else column for column in given]
        for note, shared in zip(self.notes, self.shared[self.count :], strict=True):
            if shared:
                v.append(note if isinstance(note, int) else sum([v[i] * v[j] for i, j in note]))
                w.append(repeat(v[-1]))
            elif not isinstance(note, int):
                (i, j), *others = note
                found = map(mul, w[i], w[j])
                for i, j in others:
                    found = map(add, found, map(mul, w[i], w[j]))
                v.append(0)
                w.append(list(found))
        return w


class Traced:
    """A polynomial whose coefficients are numbers of a trace."""

    __slots__ = ("_known", "degree", "terms", "trace")

    def __init__(self, trace: Trace, terms: dict[int, Sums], degree: int) -> None:
        self.trace, self.terms, self.degree = trace, terms, degree
        self._known: dict[int, tuple[int, int]] | None = None

    @staticmethod
    def of(trace: Trace, places: dict[int, int], degree: int = 1) -> Traced:
        """Of numbers by their monomials."""
        terms: dict[int, Sums] = {m: {(min(i, trace.unit), max(i, trace.unit)): 1} for m, i in places.items()}
        return Traced(trace, terms, degree)

    def __add__(self, other: Traced) -> Traced:
        return self._summed(other, 1)

    def __sub__(self, other: Traced) -> Traced:
        return self._summed(other, -1)

    def _summed(self, other: Traced, sign: int) -> Traced:
        degree = max(self.degree, other.degree)
        terms = {m: dict(sums) for m, sums in self._raised(degree).terms.items()}
        for m, sums in other._raised(degree).terms.items():
            own = terms.setdefault(m, {})
            for pair, factor in sums.items():
                own[pair] = own.get(pair, 0) + sign * factor
        return Traced(self.trace, terms, degree)

    def _raised(self, degree: int) -> Traced:
        """The same, of a degree that is not lower."""
        one = Traced.of(self.trace, {0: 0})
        return self if degree == self.degree else (self * one)._raised(degree)

    def __mul__(self, other: Traced) -> Traced:
        terms: dict[int, Sums] = {}
        ours, theirs = self._settled(), other._settled()
        for m, (i, f) in ours.items():
            for n, (j, g) in theirs.items():
                sums, pair = terms.setdefault(m + n, {}), (min(i, j), max(i, j))
                sums[pair] = sums.get(pair, 0) + f * g
        return Traced(self.trace, terms, self.degree + other.degree)

    def _settled(self) -> dict[int, tuple[int, int]]:
        """Place and factor of every coefficient."""
        if self._known is None:
            left = {m: {pair: f for pair, f in sums.items() if f} for m, sums in self.terms.items()}
            self._known = {m: self.trace.settled(sums) for m, sums in left.items() if sums}
        return self._known

    def places(self) -> dict[int, int]:
        """The place of every coefficient itself."""
        return {m: self.trace.multiple(i, f) for m, (i, f) in self._settled().items()}


PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "lateral": ("h",)}
_SURE, AXES = ("plain", "lateral"), range(3)
_KEPT = 4096  # measurements
# of a measurement at a point, in float64 where it is exact, and of bits times bits of its longest number a part
POINT_WORK, _FLOAT_WORK, _POINT_BITS = 300, 10, 16
_FAR = 2**60  # mm: no point so far away is computed in float64
_BATCH, _HELD = 256, 16 << 20  # measurements at once; bytes, about, that what is formed for them takes meanwhile


def check_model(name: str) -> None:
    """A model's name is one of those that are known here, or an ASCII identifier that is none of them."""
    if name not in EXTRA and not (name.isascii() and name.isidentifier() and name.lower() not in EXTRA):
        raise Refused(f"names the model {shown(name)}: a name is an ASCII identifier, and none of cpcal's")


class Measurement:
    """One row of a campaign for one leg: quaternion, position, length; the half-widths of its reading (d, 2 s, e)."""

    def __init__(self, given: Sequence[float], widths: Sequence[float | F]):
        self.given, self.radii = given, tuple(widths)
        self.uncertain = any(self.radii)


def leg_problem(
    rows: Callable[[int], Measurement],
    count: int,
    model: str,
    only: tuple[int, ...] | None,
    forms: Sequence[Polynomial] = (),
    exact: Callable[[At, Sequence[int]], Iterable[int]] | None = None,
) -> Problem:
    """`count` measurements of a leg, or `only` those. The `forms`, polynomials in its unknowns, are unknowns too; that
    each is equal to its polynomial is a constraint beyond the measurements. `exact`: where all are exact, those of
    some that a point does not satisfy."""
    names, known = (*PARAMETERS, *EXTRA[model], "eps"), lru_cache(_KEPT)(rows)
    n, nothing = len(names), [Polynomial({}, 0, form.spend) for form in forms[:1]]
    stated = [
        Constraint(form - Polynomial({unknown(n + m): 1}, 0, form.spend), *nothing, *nothing)
        for m, form in enumerate(forms)
    ]

    def constraint(k: int, x: Unknowns, signs: str) -> LegConstraint | Constraint:
        return LegConstraint(known(k), model, x.first(n), signs) if k < count else stated[k - count].on(x.images)

    def at(x: Unknowns, points: Sequence[tuple[int, str]], factor: F | None) -> int | None:
        point, places = At(x.first(n), model, factor), [k for k, _ in points if k < count]
        each = (k for k, signs in points[: len(places)] if not point.holds(known(k), signs))
        wrong = each if exact is None else exact(point, places)
        of_forms = (k for k, _ in points[len(places) :] if not stated[k - count].on(x.images).held)
        return next(chain(wrong, of_forms), None)

    chosen = tuple(range(count)) if only is None else only
    return Problem(
        (*names, *(f"form {m}" for m in range(len(forms)))), n - 1, count + len(forms),
        (*chosen, *range(count, count + len(forms))), constraint, lambda k: known(k).radii if k < count else (),
        (*SIDES, "length"), model, settled=settled_legs, at=at,
    )  # fmt: skip


@dataclass(frozen=True)
class LegConstraint:
    """The constraint of a measurement on a box, its readings in sets from the ends that `signs` name."""

    m: Measurement
    model: str
    x: Unknowns
    signs: str

    @property
    def sure(self) -> bool:
        """Whether at_least is not negative at any solution."""
        return self.model in _SURE


def placed(x: float, y: float, z: float, *quaternion: float) -> tuple[float, ...]:
    """P and R(q) in float64, an entry of R at most 2^-49 off; not a number where the square of q may be too large."""
    norm = hypot(*quaternion)
    norm = norm if 1e-9 < norm < 1e9 else nan
    first, second, third = rotation_rows([v / norm for v in quaternion])
    return (x, y, z, *first, *second, *third)


class At:
    """A point, of which it is proved measurement by measurement that it satisfies them.

    That is for some reading between the end M of its set that the signs name and -M; with a `factor` for all readings
    of sets with so many times the half-widths.
    """

    def __init__(self, x: Unknowns, model: str, factor: F | None) -> None:
        self.x, self.factor = x, factor
        (*ab, self.offset), extra, self.eps = x.at.values[:7], x.at.values[7:-1], x.at.values[-1]
        self.a, self.b, self.one = ab[:3], ab[3:], 1 << x.at.power
        self.gain = self.one + extra[0] if model == "gain" else self.one
        self.h = extra[0] if model == "lateral" else 0

    def holds(self, m: Measurement, signs: str) -> bool:
        """One whose reading its signs name.

        Numbers are whole, over one power of two; a product of k of them is of degree k, and so are sums of these. See
        docs/certificate-format.md, "The claims", for every name here.
        """
        factor, at = self.factor, self.x.at
        given, radii, (above, below) = dyadics(m.given), dyadics(m.radii), (factor or F(1)).as_integer_ratio()
        p = max(given.power, radii.power + below.bit_length(), at.power)
        one, more, up = 1 << p, p - radii.power - below.bit_length() + 1, p - at.power
        q0, q1, q2, q3, *place, read = given.over(p)
        r1, r2, r3, *turns, rl = [0] * READINGS if factor == 0 else [above * width << more for width in radii.values]
        t1, t2, t3 = (width >> 1 for width in turns)
        a1, a2, a3, b1, b2, b3, offset, gain, h, eps = (
            v << up for v in (*self.a, *self.b, self.offset, self.gain, self.h, self.eps)
        )
        if eps < 0 or read - rl + offset < eps:
            return False
        # n = |q|^2, c = n R(q) b, w = P - a
        n, turn = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3, rotation_rows((q0, q1, q2, q3))
        c1, c2, c3 = (i * b1 + j * b2 + k * b3 for i, j, k in turn)
        w1, w2, w3 = place[0] - a1, place[1] - a2, place[2] - a3
        off = eps << p
        if factor is not None and gain * read + (offset << p) < abs(gain) * rl + off:
            return False
        square = w1 * w1 + w2 * w2 + w3 * w3 + b1 * b1 + b2 * b2 + b3 * b3 - (h << p)
        x1, x2, x3 = c2 * w3 - c3 * w2, c3 * w1 - c1 * w3, c1 * w2 - c2 * w1  # of degree 4
        slack = 0
        if factor is None:
            d1, d2, d3, s1, s2, s3, e = (
                -ENDS[sign][0] * r for sign, r in zip(signs, (r1, r2, r3, t1, t2, t3, rl), strict=True)
            )
        else:
            shift, swing, size = r1 + r2 + r3, t1 + t2 + t3, n * (abs(b1) + abs(b2) + abs(b3))
            bent = swing * size * (5 * swing * (abs(w1) + abs(w2) + abs(w3) + shift) + (3 * shift << p))
            curved, slopes, swings = 3 * swing * swing * size, [], []
            axes = (c1, w1, r1, t1, x1), (c2, w2, r2, t2, x2), (c3, w3, r3, t3, x3)
            for i in AXES:
                (ci, wi, ri, ti, xi), (cj, wj, rj, tj, _), (ck, wk, rk, tk, _) = axes[i], axes[i - 2], axes[i - 1]
                by_c, of_w, of_c = abs(ci), tj * abs(wj) + tk * abs(wk), tj * abs(cj) + tk * abs(ck)
                turning = by_c * of_w + abs(wi) * of_c + 2 * ti * abs(cj * wj + ck * wk)
                moved = (n * ri << 2 * p) + (2 * (tj * abs(ck) + tk * abs(cj)) << p) + curved
                slopes.append((n * wi + ci << 2 * p, moved, ri))
                swings.append((xi << 2 * p, (turning << p) + (rj * abs(ck) + rk * abs(cj) << 2 * p) + bent, ti))
            slack = sum((4 * r * max(far - abs(g), 0) << p for g, far, r in slopes), 0)
            slack = -(-slack - sum(8 * t * max(far - abs(g), 0) for g, far, t in swings) >> p)
            d1, d2, d3, s1, s2, s3 = (r if g > 0 else -r for g, _, r in (*slopes, *swings))
            e = -rl if gain > 0 else rl
        # at this reading and at the opposite one, with (1 + s.s): what is even in the reading, and what is odd
        over = (one << p) + s1 * s1 + s2 * s2 + s3 * s3
        less, kappa, sc = (one << p + 1) - over, n * over, s1 * c1 + s2 * c2 + s3 * c3
        square += d1 * d1 + d2 * d2 + d3 * d3
        across = s1 * (c2 * d3 - c3 * d2) + s2 * (c3 * d1 - c1 * d3) + s3 * (c1 * d2 - c2 * d1)
        even = kappa * square + 2 * less * (w1 * c1 + w2 * c2 + w3 * c3)
        even += 4 * (sc * (s1 * w1 + s2 * w2 + s3 * w3) + (across << p))
        odd = 2 * (kappa * (w1 * d1 + w2 * d2 + w3 * d3) + less * (c1 * d1 + c2 * d2 + c3 * d3))
        odd += 4 * (sc * (s1 * d1 + s2 * d2 + s3 * d3) + (s1 * x1 + s2 * x2 + s3 * x3 << p))
        slack *= over
        most, least = (even + odd << 2 * p) + slack, (even - odd << 2 * p) - slack  # of degree 8
        self.x.spend(POINT_WORK + (most.bit_length() ** 2 >> _POINT_BITS))
        high, low = gain * (read + e) + (offset << p), gain * (read - e) + (offset << p)
        if high + off < 0 or most > kappa * (high + off) ** 2 or least < 0:
            return False
        return low <= off or kappa * (low - off) ** 2 <= least


def taken(legs: Sequence[LegConstraint]) -> tuple[list[Column], int]:
    """What the trace of legs takes that have one formula: whole numbers, and the power of two that divides them."""
    x, reads = legs[0].x.numbers, legs[0].m.uncertain
    given = dyadics([v for leg in legs for v in leg.m.given])
    reach = dyadics([v for leg in legs for v in leg.m.radii] if reads else [])
    unit = max(given.power, reach.power + 1, x.power)
    own, widths = given.over(unit), reach.over(unit)
    columns: list[Column] = [1 << unit, *(own[j::8] for j in range(8))]
    columns.append([v - width for v, width in zip(own[7::8], widths[6::7], strict=True)] if reads else own[7::8])
    columns += x.over(unit)
    for part in range(2 * reads):
        for j in range(READINGS):
            signs = [ENDS[leg.signs[j]][part] for leg in legs]
            both = zip(signs, widths[j::7], strict=True)
            columns.append([sign * width >> (3 <= j < 6) for sign, width in both])
    return columns, unit


def formed(
    legs: Sequence[LegConstraint], formula: LegFormula
) -> Iterator[tuple[list[Iterable[int]], int, Sequence[LegConstraint]]]:
    """Batches of legs that have one formula: all numbers of its trace, and the unit that they are in."""
    trace = formula.trace
    for start in range(0, len(legs), _BATCH):
        batch = legs[start : start + _BATCH]
        columns, unit = taken(batch)
        longest = max(max(map(int.bit_length, [column] if isinstance(column, int) else column)) for column in columns)
        batch[0].x.spend(trace.work * (3 + len(batch) * (1 + (longest * longest >> 14))) + 60 * len(batch))
        step = max(1, _HELD // (trace.work * (64 + longest)))
        for k in range(0, len(batch), step):
            some = [column if isinstance(column, int) else column[k : k + step] for column in columns]
            yield trace.run(some), unit, batch[k : k + step]


def settled_legs(x: Unknowns, legs: Sequence[LegConstraint], side: str) -> Iterator[Polynomial]:
    """Their rows at the reference readings, less the penalties, in order; legs have one formula."""
    bounded = side == "lower" and not legs[0].sure
    names = (side, "at_least", "factor") if bounded else (side,)
    formula = leg_formula(legs[0].model, legs[0].m.uncertain, names)
    for v, unit, batch in formed(legs, formula):
        parts = [
            (tuple(places), -unit * degree, zip(*(v[k] for k in places.values()), strict=False))
            for places, degree in formula.parts
        ]
        for leg in batch:
            x.spend(2 * sum(len(monomials) for monomials, *_ in parts))
            mask, settled = signed(len(x), leg.signs), parts[0][0]
            remainder = _remainder(settled, "".join("0" if sign == "0" else "+" for sign in leg.signs), mask)
            row = shortened(remainder.of(next(parts[0][2])), parts[0][1], x.spend)
            if bounded:
                low, factor = (
                    shortened(dict(zip(monomials, next(values), strict=True)), exponent, x.spend)
                    for monomials, exponent, values in parts[1:]
                )
                row = row - constant(beyond(low, factor, mask), x.spend)
            yield row


_remainder = lru_cache(maxsize=4096)(Remainder)


class LegFormula(NamedTuple):
    """A trace, and of polynomials the places of their coefficients by monomial, and their degrees."""

    trace: Trace
    parts: list[tuple[dict[int, int], int]]


@lru_cache(maxsize=256)
def leg_formula(model: str, reads: bool, names: tuple[str, ...]) -> LegFormula:
    """Of polynomials in u, and in y if it `reads` sets."""
    n = 8 + len(EXTRA[model])
    trace = Trace([True, *[False] * 9, *[True] * 2 * n, *[False] * 2 * READINGS * reads])
    quaternion, position = ([Traced.of(trace, {0: k}) for k in range(start, end)] for start, end in ((1, 5), (5, 8)))
    length, shortest = (Traced.of(trace, {0: k}) for k in (8, 9))
    x = [Traced.of(trace, {0: 10 + i, unknown(i): 10 + n + i}) for i in range(n)]
    reading, first = [Traced(trace, {}, 0)] * READINGS, 10 + 2 * n
    if reads:
        reading = [Traced.of(trace, {0: first + j, 1 << FIELD * j: first + READINGS + j}) for j in range(READINGS)]
    parts = _parts(model, Traced.of(trace, {0: trace.unit}, 0), (position, quaternion, length, shortest), x, reading)
    return LegFormula(trace, [(part.places(), part.degree) for part in map(parts, names)])


def _parts(
    model: str,
    one: Traced,
    m: tuple[Sequence[Traced], Sequence[Traced], Traced, Traced],
    x: Sequence[Traced],
    y: Sequence[Traced],
) -> Callable[[str], Traced]:
    """By name; see docs/certificate-format.md, "A leg as constraints", for every name here."""
    position, quaternion, reading, shortest = m
    a, b, offset, eps = x[:3], x[3:6], x[6], x[-1]
    s, fixed, nothing = y[3:6], rotation_rows(quaternion), one - one
    factor = inner(quaternion, quaternion) * (one + inner(s, s))
    z = minus(plus(position, y[:3]), a)
    along = inner(z, applied(rotation_rows([one, *s]), applied(fixed, b)))
    square = inner((*z, *b), (*z, *b))
    if model == "lateral":
        square = square - x[7]
    body = factor * square + along + along
    length = reading + y[6] + offset
    if model == "gain":
        length = length + x[7] * (reading + y[6])
    low, high = length - eps, length + eps
    parts: dict[str, Callable[[], Traced]] = {
        "upper": lambda: body - factor * (high * high),
        "lower": lambda: factor * (low * low) - body,
        "sign": lambda: nothing - high,
        "body": lambda: nothing - body,
        "length": lambda: x[-1] - offset - shortest,
        "at_least": lambda: low,
        "factor": lambda: factor,
    }
    return lambda name: parts[name]()


# campaign.json: the exact numbers of a campaign ----------------------------------------------------------------------

NAME = "campaign.json"
FORMAT = "cpcal-campaign-exact/1"
_OTHERS = ("files", "robot", "uncertainty", "model", "provenance")
_LARGEST = 32 << 20  # bytes
_DEEPEST = 28  # lists and objects, one in the other


class ExactCampaign:
    """Measurements as rationals: each number is the float64 nearest to its decimal text."""

    def __init__(self, path: Path) -> None:
        """Raises Unusable where the file cannot be read, Refused where it is no campaign."""
        self.robot: Any = None
        self.legs, self.exact = 0, True  # of all readings
        self.place: dict[str, int] = {}  # number of each measurement by its name, pose/run
        self._numbers = array_of("d")
        self._shortest: dict[int, F] = {}
        try:
            given = content(path, _LARGEST)
            self.sha256 = sha256(given).hexdigest()
            self._read(parsed(given))
        except Refused as refused:
            raise Refused(f"{NAME}: {refused.reason}", "campaign", 0) from None

    def _read(self, data: Json) -> None:
        if data.keys() != {"format", *_OTHERS, "measurements"}:
            raise Refused("it holds another key than " + ", ".join(["format", *_OTHERS, "measurements"]))
        if data["format"] != FORMAT:
            raise Refused(f"its format is not {FORMAT}")
        if _depth([data[key] for key in _OTHERS]) > _DEEPEST + 1:
            raise Refused("it is nested too deeply")
        if isinstance(data["robot"], dict):
            self.robot = data["robot"].get("name")
        stated, widths = list[Any](), list[float]()  # of the row before: most rows have the same half-widths
        for cells in map(array, array(data["measurements"])):
            self.legs = self.legs or (len(cells) - 15) // 2
            if self.legs < 1 or len(cells) != 15 + 2 * self.legs:
                raise Refused(f"a list of {15 + 2 * max(self.legs, 1)} is needed here")
            name, numbers = f"{text(cells[0])}/{text(cells[1])}", decimals(cells[2 : 9 + self.legs])
            if stated != cells[9 + self.legs :]:
                stated = cells[9 + self.legs :]
                widths = decimals(stated)
            if not any(numbers[3:7]) or min(widths) < 0:
                raise Refused("a measurement has a quaternion that is no rotation, or a negative half-width")
            if self.place.setdefault(name, len(self.place)) * (len(cells) - 2) < len(self._numbers):
                raise Refused(f"two measurements have the name {shown(name)}")
            self.exact = self.exact and not any(widths)
            self._numbers.extend(numbers + widths)
        if not self.place:
            raise Refused("it lacks measurements")

    def __len__(self) -> int:
        return len(self.place)

    def measurement(self, k: int, leg: int) -> Measurement:
        """Row k from 0, leg from 1."""
        width, first = 13 + 2 * self.legs, 7 + self.legs
        numbers = self._numbers[k * width : (k + 1) * width]
        given = (*numbers[3:7], *numbers[:3], numbers[6 + leg])
        return Measurement(given, (*numbers[first : first + 6], numbers[first + 5 + leg]))

    @cached_property
    def _placed(self) -> tuple[float, list[tuple[float, ...]]]:
        """No |P_x| + |P_y| + |P_z| is larger; and of each measurement P and R, in float64."""
        columns = [self._numbers[j :: 13 + 2 * self.legs] for j in range(7)]
        return 2 * max(map(hypot, *columns[:3])), list(map(placed, *columns))

    def unmet(self, leg: int, point: At, rows: Sequence[int]) -> Iterator[int]:
        """Of rows, all exact, those that a point does not satisfy.

        Few are in doubt in float64: only these are computed exactly. With u = 2^-53, or 2^-52 where rounding is not to
        nearest, an entry of R is at most 16 u off, a component of P + R b - a 24 u times `size`, and what is compared
        200 u times its square.
        """
        point.x.spend(_FLOAT_WORK * len(rows))
        (*x, eps), doubtful = point.x.box.lo, rows
        if 0 <= eps <= self.shortest(leg) + x[6] and max(map(abs, point.x.box.lo)) < _FAR:
            far, poses = self._placed
            readings, doubtful = self._numbers[6 + leg :: 13 + 2 * self.legs], list[int]()
            a1, a2, a3, b1, b2, b3, offset, *_ = own = list(map(float, x))
            gain, h, off = point.gain / point.one, point.h / point.one, float(eps)
            size = 1 + far + sum(map(abs, own)) + off + (2 + abs(gain)) * max(max(readings), abs(offset))
            doubt = size * size * 2.0**-43
            for k in rows:
                v1, v2, v3, r11, r12, r13, r21, r22, r23, r31, r32, r33 = poses[k]
                v1 += r11 * b1 + r12 * b2 + r13 * b3 - a1
                v2 += r21 * b1 + r22 * b2 + r23 * b3 - a2
                v3 += r31 * b1 + r32 * b2 + r33 * b3 - a3
                square, length = v1 * v1 + v2 * v2 + v3 * v3 - h, gain * readings[k] + offset
                low, high = length - off, length + off
                if not (doubt <= low and low * low + doubt <= square <= high * high - doubt):
                    doubtful.append(k)
        return (k for k in doubtful if not point.holds(self.measurement(k, leg), "0" * READINGS))

    def shortest(self, leg: int) -> F:
        """Of all lengths that the readings of a leg may stand for."""
        if leg not in self._shortest:
            lengths, widths = (self._numbers[first + leg :: 13 + 2 * self.legs] for first in (6, 12 + self.legs))
            ends = [(min(lengths), 0)] if self.exact else zip(lengths, widths, strict=True)
            self._shortest[leg] = min(F(length) - F(width) for length, width in ends)
        return self._shortest[leg]


def _depth(value: Any) -> int:
    if not isinstance(value, dict | list):
        return 0
    return 1 + max(map(_depth, value.values() if isinstance(value, dict) else value), default=0)
