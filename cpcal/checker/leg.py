"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import lru_cache
from typing import NamedTuple

from .exact_polynomial import FIELD, READINGS, Polynomial, Remainder, constant, settled, shortened, unknown
from .problem import ENDS, SIDES, Problem, Unknowns, beyond
from .program import Degree, Formula, Numbers, Program, Traced, dyadics
from .readers import shown
from .refusal import Refused

_AXES = (0, 1, 2)
PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", "cx", "cy", "cz", "tx", "ty", "tz"), "lateral": ("h",)}
_SURE = ("plain", "lateral")
_KEPT = 4096  # measurements
Quaternion = list[Traced]


def check_model(name: str) -> None:
    """A model's name is one of those that are known here, or an ASCII identifier that is none of them."""
    if name not in EXTRA and not (name.isascii() and name.isidentifier() and name.lower() not in EXTRA):
        raise Refused(f"names the model {shown(name)}: a name is an ASCII identifier, and none of cpcal's")


class Measurement:
    """One row of a campaign for one leg, as programs take it: quaternion; position, length and the shortest one, mm;
    the half-widths of its reading (d, 2 s, e)."""

    def __init__(self, quaternion: Iterable[float], position: Iterable[float], length: float, widths: Iterable[float]):
        self.quaternion = dyadics(quaternion)
        reach = dyadics(widths)
        self.radii = tuple(reach.values)
        self.reach = Numbers([m if 3 <= j < 6 else 2 * m for j, m in enumerate(self.radii)], reach.power + 1)
        at = dyadics((*position, length))
        power = max(at.power, reach.power)
        values = at.over(power)
        self.fixed = Numbers([*values, values[-1] - (self.radii[-1] << power - reach.power)], power)
        self.uncertain = any(self.radii)

    @property
    def shortest(self) -> F:
        """Of the lengths that the reading may stand for."""
        return F(self.fixed.values[-1], 1 << self.fixed.power)

    def reading(self, signs: str, way: int) -> Numbers:
        """Its components, or with `way` 0 what they are made of: see `ENDS`."""
        values = self.reach.values
        found = [(way or 1) * ENDS[sign][0] * m for sign, m in zip(signs, values, strict=True)]
        if not way:
            found += [ENDS[sign][1] * m for sign, m in zip(signs, values, strict=True)]
        return Numbers(found, self.reach.power)


def leg_problem(rows: Callable[[int], Measurement], count: int, model: str, only: tuple[int, ...] | None) -> Problem:
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

    m: Measurement
    model: str
    x: Unknowns
    signs: str
    way: int

    def holds(self, sides: tuple[str, ...]) -> bool:
        """Each is at most zero; "lower" holds as well where at_least is."""
        names = sides if self.sure else (*sides, "at_least")
        formed, values, _ = self._run(names)
        found = iter(values)
        at = {name: next(found) if places else 0 for name, places in zip(names, formed.places, strict=True)}
        return all(at[side] <= 0 or (side == "lower" and at.get("at_least", 1) <= 0) for side in sides)

    def row(self, side: str, mask: int) -> Polynomial:
        """At most zero at every solution, in u and y."""
        if side != "lower" or self.sure:
            return self._parts(side)[0]
        row, low, factor = self._parts("lower", "at_least", "factor")
        return row - constant(beyond(low, factor, mask), self.x.spend)

    def settled(self, side: str, signs: str, mask: int) -> Polynomial:
        """A row at the reference reading, less the penalties."""
        if side == "lower" and not self.sure:
            return settled(self.row(side, mask), signs, mask)
        formed, values, units = self._run((side,))
        self.x.spend(len(formed.places[0]) // 4)
        ((p, q),) = formed.degrees
        terms = formed.remainder(signs, mask).of(values)
        return shortened(terms, -(units[0] * p + units[1] * q), self.x.spend)

    def _parts(self, *names: str) -> list[Polynomial]:
        """Rows by their sides, or what they are made of by its name in `_Constraint`, in u and y."""
        formed, values, units = self._run(names)
        found, out = iter(values), []
        for places, (p, q) in zip(formed.places, formed.degrees, strict=True):
            terms = dict(zip(places, found))  # noqa: B905 - the others are of the parts that follow
            out.append(shortened(terms, -(units[0] * p + units[1] * q), self.x.spend))
        return out

    def _run(self, names: tuple[str, ...]) -> tuple[LegFormula, list[int], Degree]:
        """The coefficients of some parts, and the units that they are in."""
        formed = leg_formula(self.model, self.x.moves, self._reads, names)
        return formed, *formed.formula.run(self.m.quaternion, self.numbers(), self.x.spend)

    @property
    def _reads(self) -> int:
        return self.m.uncertain * (1 if self.way else 2)

    @property
    def sure(self) -> bool:
        """Whether at_least is not negative at any solution."""
        return self.model in _SURE

    def numbers(self) -> list[Numbers]:
        """What its program takes beside the quaternion."""
        reading = [self.m.reading(self.signs, self.way)] if self._reads else []
        return [self.m.fixed, self.x.numbers, *reading]


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
    arm = [_dot(row, b) for row in fixed]
    along = _dot(z, [_dot(row, arm) for row in _rotation([one, *s])])
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
