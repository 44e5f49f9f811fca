"""The one rule: a weighted sum of inequalities, less products of bounds, bounded over a box. Part of the checker.

Standard library only. On a box with midpoint c and radius r write x_i = c_i + r_i u_i with |u_i| <= 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F

from cpcal.proof.measurement import EPS, OFFSET, Measurement, Polynomial, Range, bends, inequality, slopes

RowWeight = tuple[str, int, F]  # side, measurement, weight >= 0
BoundProduct = tuple[int, int, F, F, F]  # unknowns i, j, then p, q, weight >= 0: weight * (1 + p u_i)(1 + q u_j)
Tangent = tuple[int, F, F]  # unknown i, then t, weight >= 0: weight * (u_i - t)^2

ZERO = F(0)


@dataclass(frozen=True)
class Weights:
    """What is claimed to exclude or to bound: nothing but nonnegative numbers."""

    rows: tuple[RowWeight, ...]
    products: tuple[BoundProduct, ...]
    tangents: tuple[Tangent, ...]


@dataclass(frozen=True)
class ExactBox:
    """lo <= x <= hi for the eight unknowns."""

    lo: tuple[F, ...]
    hi: tuple[F, ...]

    @property
    def center(self) -> tuple[F, ...]:
        return tuple((a + b) / 2 for a, b in zip(self.lo, self.hi, strict=True))

    @property
    def radius(self) -> tuple[F, ...]:
        return tuple((b - a) / 2 for a, b in zip(self.lo, self.hi, strict=True))


def shifted(p: Polynomial, center: Sequence[F], radius: Sequence[F]) -> Polynomial:
    """The polynomial in u."""
    out: Polynomial = {}

    def put(key: tuple[int, ...], value: F) -> None:
        if value:
            out[key] = out.get(key, ZERO) + value

    for monomial, c in p.items():
        if not c:
            continue
        if len(monomial) == 0:
            put((), c)
        elif len(monomial) == 1:
            (i,) = monomial
            put((), c * center[i])
            put((i,), c * radius[i])
        else:
            i, j = monomial
            put((), c * center[i] * center[j])
            put((i,), c * radius[i] * center[j])
            put((j,), c * center[i] * radius[j])
            put((i, j), c * radius[i] * radius[j])
    return out


def least(p: Polynomial) -> F:
    """A lower bound over |u| <= 1: a square lies in [0, 1], any other monomial in [-1, 1]."""
    total = ZERO
    for monomial, c in p.items():
        if not monomial:
            total += c
        elif len(monomial) == 2 and monomial[0] == monomial[1]:
            total += min(c, ZERO)
        else:
            total -= abs(c)
    return total


def span(p: Polynomial) -> Range:
    """Midpoint and radius of an enclosure over |u| <= 1."""
    return p.get((), ZERO), sum((abs(c) for monomial, c in p.items() if monomial), ZERO)


def largest_sizes(m: Measurement, box: ExactBox) -> list[F]:
    """sup |P_i - a_i|, sup |b_i| and sup |L + l| + eps over the box: seven numbers."""
    away = [max(abs(m.position[i] - box.lo[i]), abs(m.position[i] - box.hi[i])) for i in range(3)]
    arm = [max(abs(box.lo[i]), abs(box.hi[i])) for i in range(3, 6)]
    reach = max(abs(m.length + box.lo[OFFSET]), abs(m.length + box.hi[OFFSET])) + box.hi[EPS]
    return [*away, *arm, reach]


def reference(m: Measurement, side: str, box: ExactBox) -> tuple[tuple[F, ...], F]:
    """A reading of the set, and how much Q may be smaller than there at another reading, for any x in the box.

    Component by component: at an end where the slope keeps its sign (nearly), else at the centre.
    """
    radii = (*m.position_radius, *(r / 2 for r in m.rotation_radius), m.length_radius)
    if side == "length" or not any(radii):
        return (ZERO,) * 7, ZERO
    center, radius = box.center, box.radius
    chosen, penalty = [], ZERO
    for p, bend, r in zip(slopes(m, side), bends(m, largest_sizes(m, box)), radii, strict=True):
        middle, half = span(shifted(p, center, radius))
        low, high = middle - half - bend, middle + half + bend
        choices = ((2 * r * max(ZERO, -low), -r), (2 * r * max(ZERO, high), r), (r * max(-low, high), ZERO))
        loss, end = min(choices, key=lambda choice: choice[0])
        chosen.append(end)
        penalty += loss
    return tuple(chosen), penalty


class Bounder:
    """Applies the rule on one box; the references of its rows are found once."""

    def __init__(self, measurements: Mapping[int, Measurement], box: ExactBox) -> None:
        self._measurements, self.box = measurements, box
        self._center, self._radius = box.center, box.radius
        self._rows: dict[tuple[str, int], tuple[Polynomial, F]] = {}

    def row(self, side: str, k: int) -> tuple[Polynomial, F]:
        """Q at its reference reading, in u, and its penalty."""
        if (side, k) not in self._rows:
            m = self._measurements[k]
            reading, penalty = reference(m, side, self.box)
            self._rows[side, k] = shifted(inequality(m, side, reading), self._center, self._radius), penalty
        return self._rows[side, k]

    def aggregate(self, weights: Weights) -> Polynomial:
        """sum of weighted rows less penalties, less weighted products: at most zero at every solution in the box."""
        p: Polynomial = {(): ZERO}

        def put(key: tuple[int, ...], value: F) -> None:
            p[key] = p.get(key, ZERO) + value

        for side, k, weight in weights.rows:
            polynomial, penalty = self.row(side, k)
            put((), -weight * penalty)
            for monomial, c in polynomial.items():
                put(monomial, weight * c)
        for i, j, a, b, weight in weights.products:
            put((), -weight)
            put((i,), -weight * a)
            put((j,), -weight * b)
            put((min(i, j), max(i, j)), -weight * a * b)
        for i, t, weight in weights.tangents:
            put((), -weight * t * t)
            put((i,), 2 * weight * t)
            put((i, i), -weight)
        return p

    def excludes(self, weights: Weights) -> bool:
        """Whether no solution lies in the box: the aggregate is positive on it."""
        return least(self.aggregate(weights)) > 0

    def improved(self, variable: int, side: str, weights: Weights) -> F:
        """What the aggregate proves of an unknown: every solution in the box is at least ("lo") or at most this."""
        sign = 1 if side == "lo" else -1
        p = self.aggregate(weights)
        p[(variable,)] = p.get((variable,), ZERO) + sign
        # sign u + aggregate <= sign u at a solution
        return self._center[variable] + self._radius[variable] * sign * least(p)
