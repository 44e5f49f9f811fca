"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import lru_cache
from typing import NamedTuple

from .exact_polynomial import FIELD, READINGS, Polynomial, Remainder, constant, settled, shortened, unknown
from .problem import ENDS, SIDES, Problem, Unknowns, beyond
from .program import Degree, Dyadic, Formula, Program, Traced, dyadic

_AXES = (0, 1, 2)
PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", "cx", "cy", "cz", "tx", "ty", "tz"), "lateral": ("h",)}
_SURE = ("plain", "lateral")
_KEPT = 4096  # measurements
Quaternion = list[Traced]


class Measurement(NamedTuple):
    """One row of a campaign for one leg: exact numbers, mm; `radii` of the reading (d, s, e)."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    radii: tuple[F, ...]


class Stated:
    """A measurement as programs take it: quaternion, position and length, and the half-widths of its reading."""

    def __init__(self, numbers: Sequence[Dyadic], reach: Sequence[Dyadic]) -> None:
        (length, p), (e, q) = numbers[7], reach[6]
        power = max(p, q)
        self.fixed = [*numbers, ((length << power - p) - (e << power - q), power)]
        self.radii, self._reach = tuple(m for m, _ in reach), reach
        self.uncertain = any(self.radii)

    @classmethod
    def of(cls, m: Measurement) -> Stated:
        return cls(list(map(dyadic, (*m.quaternion, *m.position, m.length))), list(map(dyadic, m.radii)))

    def reading(self, signs: str, way: int) -> list[Dyadic]:
        """Its components, or with `way` 0 what they are made of: see `ENDS`."""
        ends = [(ENDS[sign], *reach) for sign, reach in zip(signs, self._reach, strict=True)]
        if way:
            return [(way * end * m, power) for (end, _), m, power in ends]
        return [(end * m, power) for (end, _), m, power in ends] + [(slope * m, power) for (_, slope), m, power in ends]


def leg_problem(rows: Callable[[int], Stated], count: int, model: str, only: tuple[int, ...] | None) -> Problem:
    """`count` measurements of a leg, or `only` those."""
    names, known = (*PARAMETERS, *EXTRA[model], "eps"), lru_cache(_KEPT)(rows)
    chosen = tuple(range(count)) if only is None else only
    return Problem(
        names, len(names) - 1, count, chosen,
        lambda k, x, signs, way: LegConstraint(known(k), model, x, signs, way), lambda k: known(k).radii,
        (*SIDES, "length"), (*SIDES, "length", "eps"), model,
    )  # fmt: skip


@dataclass(frozen=True)
class LegConstraint:
    """The constraint of a measurement on a box."""

    m: Stated
    model: str
    x: Unknowns
    signs: str
    way: int

    def rows(self, sides: Sequence[str], mask: int) -> list[Polynomial]:
        """Each at most zero at every solution, in u and y."""
        if self.sure or "lower" not in sides:
            return self.parts(*sides)
        return [self._lower(mask) if side == "lower" else self.parts(side)[0] for side in sides]

    def _lower(self, mask: int) -> Polynomial:
        row, low, factor = self.parts("lower", "at_least", "factor")
        return row - constant(beyond(low, factor, mask), self.x.spend)

    def settled(self, side: str, signs: str, mask: int) -> Polynomial:
        """A row at the reference reading, less the penalties."""
        if side == "lower" and not self.sure:
            return settled(self._lower(mask), signs, mask)
        formed = self._formed((side,))
        values, units = formed.formula.run(self.numbers(), self.x.spend)
        self.x.spend(len(formed.places[0]) // 4)
        ((p, q),) = formed.degrees
        terms = formed.remainder(signs, mask).of(values)
        return shortened(terms, -(units[0] * p + units[1] * q), self.x.spend)

    def parts(self, *names: str) -> list[Polynomial]:
        """Rows by their sides, or what they are made of by its name in `_Constraint`, in u and y."""
        formed = self._formed(names)
        values, units = formed.formula.run(self.numbers(), self.x.spend)
        found, out = iter(values), []
        for places, (p, q) in zip(formed.places, formed.degrees, strict=True):
            terms = dict(zip(places, found))  # noqa: B905 - the others are of the parts that follow
            out.append(shortened(terms, -(units[0] * p + units[1] * q), self.x.spend))
        return out

    def _formed(self, names: tuple[str, ...]) -> LegFormula:
        return leg_formula(self.model, any(self.x.radii), self._reads, names)

    @property
    def _reads(self) -> int:
        return self.m.uncertain * (1 if self.way else 2)

    @property
    def sure(self) -> bool:
        """Whether at_least is not negative at any solution."""
        return self.model in _SURE

    def numbers(self) -> list[Dyadic]:
        """What its program takes."""
        reading = self.m.reading(self.signs, self.way) if self._reads else ()
        return [*self.m.fixed, *self.x.numbers, *reading]


class LegFormula(NamedTuple):
    """A program, the places of the coefficients of some parts by monomial, their degrees, and all of it as code."""

    program: Program
    places: list[dict[int, int]]
    degrees: list[Degree]
    formula: Formula
    remainders: dict[tuple[str, int], Remainder]

    def remainder(self, signs: str, mask: int) -> Remainder:
        """Of the only part, for readings with these signs."""
        key = "".join("0" if sign == "0" else "+" for sign in signs), mask
        if key not in self.remainders:
            self.remainders[key] = Remainder(list(self.places[0]), *key)
        return self.remainders[key]


@lru_cache(maxsize=256)
def leg_formula(model: str, moves: bool, reads: int, names: tuple[str, ...]) -> LegFormula:
    """Of polynomials in u if the box `moves`, that is, has a width; `reads`: 0 exactly, 1 one reading, 2 sets, in y."""
    n = 8 + len(EXTRA[model])
    program = Program([0] * 4 + [1] * (5 + n * (1 + moves) + READINGS * reads))
    given = iter(program.given())
    quaternion, position, (length, shortest), centers = ([next(given) for _ in range(k)] for k in (4, 3, 2, n))
    x = [c + next(given).moved(unknown(i)) for i, c in enumerate(centers)] if moves else centers
    nothing = Traced(program, {}, (0, 0))
    reading = [next(given) for _ in range(READINGS)] if reads else [nothing] * READINGS
    if reads == 2:
        reading = [at + next(given).moved(1 << FIELD * j) for j, at in enumerate(reading)]
    found = _constraint(model, program.one(), (position, quaternion, length, shortest), x, reading)
    parts = [found.part(name) for name in names]
    program.highest = max(p.degree[0] for p in parts), max(p.degree[1] for p in parts)
    places = [part.places() for part in parts]
    formula = program.formula([k for part in places for k in part.values()])
    return LegFormula(program, places, [part.degree for part in parts], formula, {})


class _Constraint(NamedTuple):
    """`at_least <= sqrt(under_root / factor) <= at_most`, and what else is at most zero."""

    under_root: Traced
    factor: Traced
    at_least: Traced
    at_most: Traced
    length: Traced
    eps: Traced

    def part(self, name: str) -> Traced:
        """A row, or one of the fields."""
        body, factor, low, high = self[:4]
        if name == "upper":
            return body - factor * (high * high)
        if name == "lower":
            return factor * (low * low) - body
        if name == "sign":
            return high.times(-1)
        found: Traced = body.times(-1) if name == "body" else getattr(self, name)
        return found


def _constraint(
    model: str, one: Traced, m: tuple[Quaternion, Quaternion, Traced, Traced], x: Sequence[Traced], y: Sequence[Traced]
) -> _Constraint:
    """See docs/certificate-format.md, "A leg as constraints", for every name here."""
    position, quaternion, reading, shortest = m
    a, b, offset, eps = x[:3], x[3:6], x[6], x[-1]
    s, fixed = y[3:6], _rotation(quaternion)
    turned, norm = _total([c * c for c in s]), _total([c * c for c in quaternion])
    kappa = norm * (one + turned)
    p = [position[i] + y[i] for i in _AXES]
    z = [p[i] - a[i] for i in _AXES]
    w = [_total([fixed[i][j] * b[j] for j in _AXES]) for i in _AXES]
    along = (one - turned) * _dot(z, w) + (_dot(s, z) * _dot(s, w) + _dot(s, _cross(w, z))).times(2)
    square = _total([c * c for c in (*z, *b)])
    if model == "lateral":
        square = square - x[7]
    body = kappa * square + along.times(2)
    read, factor, wide = reading + y[6], kappa, eps
    length = read + offset
    if model in ("gain", "linear"):
        length = length + x[7] * read
    if model == "linear":
        of_position = _total([x[8 + i] * p[i] for i in _AXES])
        scalar = quaternion[0] - _dot(s, quaternion[1:])
        moved = _cross(s, quaternion[1:])
        vector = [quaternion[1 + i] + s[i] * quaternion[0] + moved[i] for i in _AXES]
        of_rotation = (scalar * _dot(x[11:14], vector)).times(2)
        length = kappa * (length + of_position) + of_rotation
        body, wide, factor = kappa * body, kappa * eps, one
    return _Constraint(body, factor, length - wide, length + wide, eps - offset - shortest, eps.times(-1))


def _total(parts: Sequence[Traced]) -> Traced:
    return sum(parts[1:], start=parts[0])


def _dot(p: Sequence[Traced], q: Sequence[Traced]) -> Traced:
    return _total([c * d for c, d in zip(p, q, strict=True)])


def _cross(p: Sequence[Traced], q: Sequence[Traced]) -> list[Traced]:
    return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in _AXES]


def _rotation(h: Quaternion) -> list[list[Traced]]:
    """|h|^2 R(h)."""
    w, x, y, z = h
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    wx, wy, wz, xy, xz, yz = ((p * q).times(2) for p, q in ((w, x), (w, y), (w, z), (x, y), (x, z), (y, z)))
    return [
        [ww + xx - (yy + zz), xy - wz, xz + wy],
        [xy + wz, ww + yy - (xx + zz), yz - wx],
        [xz - wy, yz + wx, ww + zz - (xx + yy)],
    ]
