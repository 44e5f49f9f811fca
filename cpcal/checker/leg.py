"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import lru_cache
from typing import NamedTuple

from .exact_polynomial import FIELD, READINGS, Polynomial, Remainder, constant, shortened, signed, unknown
from .problem import ENDS, SIDES, Constraint, Problem, Unknowns, beyond
from .program import Column, Degree, Formula, Program, Traced, dyadics
from .readers import shown
from .refusal import Refused

_AXES = (0, 1, 2)
PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", "cx", "cy", "cz", "tx", "ty", "tz"), "lateral": ("h",)}
_SURE = ("plain", "lateral")
_KEPT = 4096  # measurements
_BATCH, _HELD = 256, 16 << 20  # measurements at once; bytes, about, that what is formed for them takes meanwhile
Quaternion = list[Traced]


def check_model(name: str) -> None:
    """A model's name is one of those that are known here, or an ASCII identifier that is none of them."""
    if name not in EXTRA and not (name.isascii() and name.isidentifier() and name.lower() not in EXTRA):
        raise Refused(f"names the model {shown(name)}: a name is an ASCII identifier, and none of cpcal's")


class Measurement:
    """One row of a campaign for one leg: quaternion; position, length; the half-widths of its reading (d, 2 s, e)."""

    def __init__(self, quaternion: Sequence[float], position: Sequence[float], length: float, widths: Sequence[float]):
        self.given, self.radii = (*quaternion, *position, length), tuple(widths)
        self.uncertain = any(self.radii)

    @property
    def shortest(self) -> F:
        """Of the lengths that the reading may stand for."""
        return F(self.given[-1]) - F(self.radii[-1])


def leg_problem(
    rows: Callable[[int], Measurement],
    count: int,
    model: str,
    only: tuple[int, ...] | None,
    forms: Sequence[Polynomial] = (),
) -> Problem:
    """`count` measurements of a leg, or `only` those. The `forms`, polynomials in its unknowns, are unknowns too; that
    each is equal to its polynomial is a constraint beyond the measurements."""
    names, known = (*PARAMETERS, *EXTRA[model], "eps"), lru_cache(_KEPT)(rows)
    n, nothing = len(names), [Polynomial({}, 0, form.spend) for form in forms[:1]]
    stated = [
        Constraint(form - Polynomial({unknown(n + m): 1}, 0, form.spend), *nothing, *nothing)
        for m, form in enumerate(forms)
    ]

    def constraint(k: int, x: Unknowns, signs: str, way: int) -> LegConstraint | Constraint:
        return LegConstraint(known(k), model, x.first(n), signs, way) if k < count else stated[k - count].on(x.images)

    chosen = tuple(range(count)) if only is None else only
    return Problem(
        (*names, *(f"form {m}" for m in range(len(forms)))), n - 1, count + len(forms),
        (*chosen, *range(count, count + len(forms))), constraint, lambda k: known(k).radii if k < count else (),
        (*SIDES, "length"), (*SIDES, "length", "eps"), model, settled=settled_legs, held=held_legs,
    )  # fmt: skip


@dataclass(frozen=True)
class LegConstraint:
    """The constraint of a measurement on a box. Readings with `way` 0 are sets, else the ends that `signs` name, or
    with -1 the opposite ones."""

    m: Measurement
    model: str
    x: Unknowns
    signs: str
    way: int

    @property
    def reads(self) -> int:
        """How its program takes a reading: see `leg_formula`."""
        return self.m.uncertain * (1 if self.way else 2)

    @property
    def sure(self) -> bool:
        """Whether at_least is not negative at any solution."""
        return self.model in _SURE


def taken(legs: Sequence[LegConstraint]) -> tuple[list[Column], Degree]:
    """What the program takes of legs that have one: whole numbers, and the powers of two that they are divided by."""
    x, reads = legs[0].x.numbers, legs[0].reads
    given = dyadics([v for leg in legs for v in leg.m.given[:4]])
    at = dyadics([v for leg in legs for v in leg.m.given[4:]])
    reach = dyadics([v for leg in legs for v in leg.m.radii] if reads else [])
    unit = max(at.power, reach.power + 1, x.power)
    places = at.over(unit)
    columns: list[Column] = [given.values[j::4] for j in range(4)]
    columns += [places[j::4] for j in range(4)]
    if reads:
        widths = reach.over(unit)
        columns.append([length - width for length, width in zip(places[3::4], widths[6::7], strict=True)])
    else:
        columns.append(columns[-1])
    columns += x.over(unit)
    for part in range(reads):
        for j in range(READINGS if reads else 0):
            signs = [(leg.way or 1) * ENDS[leg.signs[j]][0] if not part else ENDS[leg.signs[j]][1] for leg in legs]
            own = zip(signs, widths[j::7], strict=True)
            columns.append([sign * width >> 1 if 3 <= j < 6 else sign * width for sign, width in own])
    if eased(legs[0].model, reads):
        columns += [[width >> 1 for width in widths[j::7]] for j in range(3, 6)]
    return columns, (given.power, unit)


def formed(legs: Sequence[LegConstraint], names: tuple[str, ...]) -> Iterator[tuple[Sequence[int], Degree]]:
    """For each of legs that have one program the coefficients of some parts, and the units that they are in."""
    formula = _formula(legs, names).formula
    for start in range(0, len(legs), _BATCH):
        batch = legs[start : start + _BATCH]
        columns, units = taken(batch)
        work, bits = formula.cost(columns, units)
        batch[0].x.spend(3 * formula.notes + len(batch) * (60 + work))
        step = max(1, _HELD // (formula.notes * (64 + bits // 8) + 1))
        for k in range(0, len(batch), step):
            some = [column if isinstance(column, int) else column[k : k + step] for column in columns]
            found = formula.run(some, units)
            yield from ((values, units) for _, *values in zip(batch[k : k + step], *found))  # noqa: B905 - endless ones


def settled_legs(x: Unknowns, items: Sequence[LegConstraint | Constraint], side: str) -> Iterator[Polynomial]:
    """Their rows at the reference readings, less the penalties, in order; legs have one program."""
    legs = [item for item in items if isinstance(item, LegConstraint)]
    found = _settled(x, legs, side) if legs else iter(())
    return (next(found) if isinstance(item, LegConstraint) else item.row(side, signed(len(x))) for item in items)


def _settled(x: Unknowns, legs: Sequence[LegConstraint], side: str) -> Iterator[Polynomial]:
    bounded = side == "lower" and not legs[0].sure
    names = (side, "at_least", "factor") if bounded else (side,)
    formula = _formula(legs, names)
    ends = [sum(map(len, formula.places[:k])) for k in range(len(names) + 1)]
    for leg, (values, units) in zip(legs, formed(legs, names), strict=True):
        x.spend(2 * len(values))
        mask = signed(len(x), leg.signs)
        exponents = [-(units[0] * p + units[1] * q) for p, q in formula.degrees]
        row = shortened(formula.remainder(leg.signs, mask).of(values[: ends[1]]), exponents[0], x.spend)
        if bounded:
            low, factor = (
                shortened(
                    dict(zip(formula.places[k], values[ends[k] : ends[k + 1]], strict=True)), exponents[k], x.spend
                )
                for k in (1, 2)
            )
            row = row - constant(beyond(low, factor, mask), x.spend)
        yield row


def held_legs(legs: Sequence[LegConstraint], sides: tuple[str, ...]) -> Iterator[bool]:
    """Whether each holds at its reading and the point: all sides are at most zero; "lower" holds as well where at_least
    is. Legs have one program."""
    names = sides if legs[0].sure else (*sides, "at_least")
    filled = [name for name, places in zip(names, _formula(legs, names).places, strict=True) if places]
    for values, _ in formed(legs, names):
        at = dict(zip(filled, values, strict=True))
        yield all(at.get(side, 0) <= 0 or (side == "lower" and at.get("at_least", 1) <= 0) for side in sides)


def eased(model: str, reads: int) -> bool:
    """Whether rows are eased by what the rotation's half-widths allow: see `_constraint`."""
    return model == "linear" and reads == 2


def _formula(legs: Sequence[LegConstraint], names: tuple[str, ...]) -> LegFormula:
    return leg_formula(legs[0].model, legs[0].x.moves, legs[0].reads, names)


class LegFormula(NamedTuple):
    """A program, the places of the coefficients of some parts by monomial, their degrees, and what computes them."""

    program: Program
    places: list[dict[int, int]]
    degrees: list[Degree]
    formula: Formula
    remainders: dict[tuple[str, int], Remainder]

    def remainder(self, signs: str, mask: int) -> Remainder:
        """Of the first part, for readings with these signs."""
        key = "".join("0" if sign == "0" else "+" for sign in signs), mask
        if key not in self.remainders:
            self.remainders[key] = Remainder(list(self.places[0]), *key)
        return self.remainders[key]


@lru_cache(maxsize=256)
def leg_formula(model: str, moves: bool, reads: int, names: tuple[str, ...]) -> LegFormula:
    """Of polynomials in u if the box `moves`, that is, has a width; `reads`: 0 exactly, 1 one reading, 2 sets, in y."""
    n = 8 + len(EXTRA[model])
    box, own = n * (1 + moves), READINGS * reads + 3 * eased(model, reads)
    program = Program([0] * 4 + [1] * (5 + box + own), [False] * 9 + [True] * box + [False] * own)
    given = iter(program.given())
    quaternion, position, (length, shortest), centers = ([next(given) for _ in range(k)] for k in (4, 3, 2, n))
    x = [c + next(given).moved(unknown(i)) for i, c in enumerate(centers)] if moves else centers
    nothing = Traced(program, {}, (0, 0))
    reading = [next(given) for _ in range(READINGS)] if reads else [nothing] * READINGS
    if reads == 2:
        reading = [at + next(given).moved(1 << FIELD * j) for j, at in enumerate(reading)]
    widest = list(given)
    found = _constraint(model, program.one(), (position, quaternion, length, shortest), x, reading, widest)
    parts = [found.part(name) for name in names]
    program.highest = max(p.degree[0] for p in parts), max(p.degree[1] for p in parts)
    places = [part.places() for part in parts]
    formula = Formula(program, [k for part in places for k in part.values()])
    return LegFormula(program, places, [part.degree for part in parts], formula, {})


class _Constraint(NamedTuple):
    """`at_least <= sqrt(under_root / factor) <= at_most`, and what else is at most zero."""

    under_root: Traced
    factor: Traced
    at_least: Traced
    at_most: Traced
    length: Traced
    eps: Traced
    upper: Traced | None = None  # where these rows are not those of the bounds squared
    lower: Traced | None = None

    def part(self, name: str) -> Traced:
        """A row, or one of the fields."""
        body, factor, low, high = self[:4]
        if name == "upper":
            return body - factor * (high * high) if self.upper is None else self.upper
        if name == "lower":
            return factor * (low * low) - body if self.lower is None else self.lower
        if name == "sign":
            return high.times(-1)
        found: Traced = body.times(-1) if name == "body" else getattr(self, name)
        return found


def _constraint(
    model: str,
    one: Traced,
    m: tuple[Quaternion, Quaternion, Traced, Traced],
    x: Sequence[Traced],
    y: Sequence[Traced],
    widest: Sequence[Traced],
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
    read, factor, wide, upper, lower = reading + y[6], kappa, eps, None, None
    length = read + offset
    if model in ("gain", "linear"):
        length = length + x[7] * read
    if model == "linear":
        of_position = _total([x[8 + i] * p[i] for i in _AXES])
        scalar = quaternion[0] - _dot(s, quaternion[1:])
        moved = _cross(s, quaternion[1:])
        vector = [quaternion[1 + i] + s[i] * quaternion[0] + moved[i] for i in _AXES]
        of_rotation = (scalar * _dot(x[11:14], vector)).times(2)
        length = length + of_position
        if widest:  # divided by kappa, where (1 - widest^2) / norm and 1 / norm take the place of 1 / kappa
            low, high, of_square = length - eps, length + eps, of_rotation * of_rotation
            parts = norm * kappa, (norm * along).times(2), (norm * of_rotation).times(2)
            upper = parts[0] * (square - high * high) + parts[1] - parts[2] * high - of_square
            less = one - _total([c * c for c in widest])
            parts = parts[0] * less.unit, parts[1] * less.unit, parts[2] * less.unit  # in the degree of what is added
            lower = parts[0] * (low * low - square) - parts[1] + parts[2] * low + less * of_square
        length = kappa * length + of_rotation
        body, wide, factor = kappa * body, kappa * eps, one
    return _Constraint(body, factor, length - wide, length + wide, eps - offset - shortest, eps.times(-1), upper, lower)


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
