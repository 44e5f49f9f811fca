"""Rows of a leg in float64: the checker's own formula, with a bound of all that is rounded on the way.

The checker traces the formula once (`cpcal.checker.program`); its notes `v[k] += v[i] * v[j]` are swept here in
float64, each v with a bound of its error. With unit roundoff u the product of two such numbers is wrong by at most
|v_i| e_j + |v_j| e_i + e_i e_j + u |v_i v_j|, the sum by u of its size more. What is rounded in the bound itself is
covered by a factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cpcal.checker.exact_polynomial import FIELD, READINGS
from cpcal.checker.leg import LegConstraint, leg_formula
from cpcal.checker.problem import ENDS
from cpcal.checker.program import Numbers
from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.compiled import compiled

_UNIT = 2.0**-53
_MORE = 1.0 + 2.0**-20  # covers the roundings of error bounds, of which there are some thousands at most
_SMALLEST = 1e-280  # more than all that numbers lose that are too small


class FloatRow(NamedTuple):
    """Coefficients of monomials in u, the constant first, and a bound of the sum of their errors."""

    monomials: tuple[int, ...]
    values: Floats
    error: float


def float_rows(legs: Sequence[LegConstraint], side: str) -> list[FloatRow]:
    """`Problem.row`, nearly, of constraints that have one program; of `sure` sides, whose rows are all that it says."""
    plan = _plan(legs[0], side)
    ends = np.array([[sign != "0" for sign in leg.signs] if plan.reads else [False] * READINGS for leg in legs])
    found, errors = _all_settled(*plan.sweep(legs), plan.first, plan.odd, plan.alone, plan.kept, ends)
    return [FloatRow(plan.monomials, *row) for row in zip(found, errors.tolist(), strict=True)]


def best_signs(legs: Sequence[LegConstraint], side: str) -> list[str]:
    """The reference readings that cost least, by the range of the derivative: `legs` are at the centres of the sets,
    and have one program."""
    plan = _plan(legs[0], side)
    low, high = _all_slopes(*plan.sweep(legs), plan.linear, plan.alone)
    return ["".join(map(cheapest, *ends)) for ends in zip(low.tolist(), high.tolist(), strict=True)]


def programs(legs: Sequence[LegConstraint]) -> list[list[int]]:
    """The places of those that have one program: with readings, and without."""
    kinds = ([n for n, leg in enumerate(legs) if leg.m.uncertain is reads] for reads in (True, False))
    return [places for places in kinds if places]


def linear_parts(legs: Sequence[LegConstraint], name: str) -> tuple[Floats, Floats]:
    """Of a part of the constraints the values (B,) at the centres of the sets, and the derivatives (B, 7) by each
    reading there; they have one program."""
    plan = _plan(legs[0], name)
    return _all_linear(*plan.sweep(legs), plan.linear, plan.alone, plan.kept)


def cheapest(low: float, high: float) -> str:
    """At an end it costs what the row may fall from there, at the centre half of it."""
    choices = ((max(-low, high), "0"), (2 * max(0, -low), "-"), (2 * max(0, high), "+"))
    return min(choices, key=lambda choice: choice[0])[1]


@dataclass(frozen=True)
class _Plan:
    """A program and its output as arrays. Of each coefficient (T,): its place, the first reading in its monomial (-1:
    none), the odd exponents as bits, whether its monomial is that reading `alone`, the one reading that it is `linear`
    in (-1: none), its number among `monomials` (-1: it has a reading)."""

    reads: bool
    notes: Indices
    places: Indices
    fixed: Indices
    numbers: Floats
    size: int
    monomials: tuple[int, ...]
    first: Indices
    odd: Indices
    alone: Bools
    linear: Indices
    kept: Indices

    def given(self, legs: Sequence[LegConstraint]) -> Floats:
        """What the program takes, each number rounded once: (B, G). All are on the same box."""
        x = _floats(legs[0].x.numbers)
        return np.array([[*_measured(leg), *x, *_reading(leg)] for leg in legs])

    def sweep(self, legs: Sequence[LegConstraint]) -> tuple[Indices, Floats, Indices, Floats, int, Indices]:
        """How kernels begin that sweep it."""
        return self.notes, self.given(legs), self.fixed, self.numbers, self.size, self.places


def _floats(numbers: Numbers) -> list[float]:
    unit = 1 << numbers.power
    return [value / unit for value in numbers.values]


def _measured(leg: LegConstraint) -> list[float]:
    m = leg.m
    return [*map(float, m.given), float(m.shortest) if m.uncertain else float(m.given[-1])]


def _reading(leg: LegConstraint) -> list[float]:
    """Of the set that the signs begin, each number exactly."""
    if not leg.m.uncertain:
        return []
    widths = [float(width) * (0.5 if 3 <= j < 6 else 1.0) for j, width in enumerate(leg.m.radii)]
    return [ENDS[sign][part] * width for part in (0, 1) for sign, width in zip(leg.signs, widths, strict=True)]


def _plan(leg: LegConstraint, side: str) -> _Plan:
    return _planned(leg.model, leg.x.moves, leg.m.uncertain, side)


@lru_cache(maxsize=64)
def _planned(model: str, moves: bool, reads: bool, side: str) -> _Plan:
    formed = leg_formula(model, moves, 2 * reads, (side,))
    program, (places,) = formed.program, formed.places
    of_readings = (1 << FIELD * READINGS) - 1
    kept = [0, *(m for m in places if m and not m & of_readings)]
    number = {m: k for k, m in enumerate(kept)}
    firsts = [_exponents(m & of_readings)[:1] for m in places]
    return _Plan(
        reads=reads,
        notes=np.array(program.notes, dtype=np.intp).reshape(-1, 3),
        places=np.array(list(places.values()), dtype=np.intp),
        fixed=np.array([*program.whole, *program.ones], dtype=np.intp),
        numbers=np.array([*program.whole.values(), *(1 for _ in program.ones)], dtype=np.float64),
        size=program.size,
        monomials=tuple(kept),
        first=np.array([found[0][0] if found else -1 for found in firsts], dtype=np.intp),
        odd=np.array([sum(1 << field for field, power in _exponents(m) if power % 2) for m in places], dtype=np.intp),
        alone=np.array([len(_exponents(m)) == 1 and _exponents(m)[0][1] == 1 for m in places], dtype=np.bool_),
        linear=np.array([_linear(m & of_readings) for m in places], dtype=np.intp),
        kept=np.array([number.get(m, -1) for m in places], dtype=np.intp),
    )


def _exponents(monomial: int) -> list[tuple[int, int]]:
    """The fields of a monomial that are not zero, and their exponents."""
    powers = ((field, monomial >> FIELD * field & (1 << FIELD) - 1) for field in range(64))
    return [(field, power) for field, power in powers if power]


def _linear(reading: int) -> int:
    found = _exponents(reading)
    return found[0][0] if len(found) == 1 and found[0][1] == 1 else -1


@compiled
def _swept(notes: Indices, given: Floats, fixed: Indices, numbers: Floats, size: int) -> tuple[Floats, Floats]:
    """All numbers of a program, and their errors. Those given were rounded once."""
    v, e = np.zeros(size), np.zeros(size)
    for k in range(given.size):
        v[k], e[k] = given[k], _UNIT * abs(given[k]) + _SMALLEST
    for k in range(fixed.size):
        v[fixed[k]] = numbers[k]
    for n in range(notes.shape[0]):
        k, i, j = notes[n, 0], notes[n, 1], notes[n, 2]
        a, b = v[i], v[j]
        product = a * b
        v[k] += product
        more = abs(a) * e[j] + abs(b) * e[i] + e[i] * e[j] + _UNIT * (abs(product) + abs(v[k])) + _SMALLEST
        e[k] += more * _MORE
    return v, e


@compiled
def _all_settled(
    notes: Indices,
    given: Floats,
    fixed: Indices,
    numbers: Floats,
    size: int,
    places: Indices,
    first: Indices,
    odd: Indices,
    alone: Bools,
    kept: Indices,
    ends: Bools,
) -> tuple[Floats, Floats]:
    """What is left without the readings for each of (B, G) numbers given, and the error of all of it.

    `ends` (B, 7): the readings that begin at an end.
    """
    count = len(given)
    found, errors = np.zeros((count, max(kept.max() + 1, 1))), np.zeros(count)
    for b in range(count):
        v, e = _swept(notes, given[b], fixed, numbers, size)
        errors[b] = _settled(v[places], e[places], first, odd, alone, kept, ends[b], found[b])
    return found, errors


@compiled
def _all_slopes(
    notes: Indices,
    given: Floats,
    fixed: Indices,
    numbers: Floats,
    size: int,
    places: Indices,
    linear: Indices,
    alone: Bools,
) -> tuple[Floats, Floats]:
    """For each of (B, G) numbers given, and each reading, the range over the box of the derivative by that reading at
    the centre of the sets."""
    low, high = np.zeros((len(given), READINGS)), np.zeros((len(given), READINGS))
    for b in range(len(given)):
        v, _ = _swept(notes, given[b], fixed, numbers, size)
        for t in range(places.size):
            j, value = linear[t], v[places[t]]
            if j >= 0:
                low[b, j] += value if alone[t] else -abs(value)
                high[b, j] += value if alone[t] else abs(value)
    return low, high


@compiled
def _all_linear(
    notes: Indices,
    given: Floats,
    fixed: Indices,
    numbers: Floats,
    size: int,
    places: Indices,
    linear: Indices,
    alone: Bools,
    kept: Indices,
) -> tuple[Floats, Floats]:
    """For each of (B, G) numbers given the value without readings, and the derivative by each of them alone."""
    values, slopes = np.zeros(len(given)), np.zeros((len(given), READINGS))
    for b in range(len(given)):
        v, _ = _swept(notes, given[b], fixed, numbers, size)
        for t in range(places.size):
            if kept[t] == 0:
                values[b] += v[places[t]]
            if linear[t] >= 0 and alone[t]:
                slopes[b, linear[t]] = v[places[t]]
    return values, slopes


@compiled
def _settled(
    values: Floats,
    errors: Floats,
    first: Indices,
    odd: Indices,
    alone: Bools,
    kept: Indices,
    ends: Bools,
    found: Floats,
) -> float:
    """At the readings' reference, less the penalties, added to `found`; the error of all of it."""
    centered = (1 << 62) - 1  # bits of the variables that may be negative
    for j in range(ends.size):
        if ends[j]:
            centered -= 1 << j
    lowest = np.zeros(ends.size)
    error, size = 0.0, 0.0
    for t in range(values.size):
        value = values[t]
        error += errors[t]
        if kept[t] >= 0:
            found[kept[t]] += value
            continue
        j = first[t]
        size += abs(value)
        bits = odd[t] ^ (1 << j) if ends[j] else odd[t]
        if bits & centered != 0:
            lowest[j] -= abs(value)
        elif value < 0.0 or (ends[j] and alone[t]):
            lowest[j] += value
    for j in range(ends.size):
        if lowest[j] < 0.0:
            found[0] += lowest[j]
    error += 2.0 * _UNIT * (values.size + 16) * (size + abs(found[0]))
    return float(error * _MORE)
