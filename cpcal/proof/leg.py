"""A problem whose constraints are one leg's rows of a campaign. Standard library only; part of the checker."""

from __future__ import annotations

from fractions import Fraction as F
from typing import Protocol

from cpcal.proof.measurement import AXES, EPS, OFFSET, Measurement, arm_matrix, bends, inequality, slopes
from cpcal.proof.polynomial import ZERO, ExactBox, Polynomial, least, shifted, span

Triple = tuple[F, F, F]
_NOTHING = (ZERO, ZERO, ZERO)


class Readings(Protocol):
    """One leg's rows of a campaign."""

    def __len__(self) -> int: ...

    def measurement(self, k: int) -> Measurement: ...


class Leg:
    """Measurements of a campaign, all or the `chosen` ones, in the unknowns a, b, l and eps."""

    unknowns = ("a1", "a2", "a3", "b1", "b2", "b3", "l", "eps")
    objective = EPS
    sides = ("upper", "lower", "length")

    def __init__(self, campaign: Readings, only: tuple[int, ...] | None = None) -> None:
        self._campaign, self.count = campaign, len(campaign)
        self.chosen = tuple(range(self.count)) if only is None else only
        self._known: dict[int, Measurement] = {}

    def measurement(self, k: int) -> Measurement:
        """Read when first used."""
        if k not in self._known:
            self._known[k] = self._campaign.measurement(k)
        return self._known[k]

    def row(self, side: str, k: int, box: ExactBox) -> Polynomial:
        """Q at its reference reading, less the penalty."""
        m = self.measurement(k)
        reading, penalty = reference(m, side, box)
        row = inequality(m, side, reading)
        row[()] -= penalty
        return row

    def holds(self, k: int, point: tuple[F, ...]) -> bool:
        """Some reading has | ||v|| - (L + e + l) | <= eps, and the leg is longer than eps."""
        m, eps = self.measurement(k), point[EPS]
        shortest, longest = m.length - m.length_radius + point[OFFSET], m.length + m.length_radius + point[OFFSET]
        if eps < 0 or shortest < eps:
            return False
        short, long = extreme_lengths(m, point)
        return bool(short <= (longest + eps) ** 2 and long >= (shortest - eps) ** 2)

    def fails(self, k: int, point: tuple[F, ...]) -> bool:
        """At every reading one of the inequalities is violated."""
        box = ExactBox(point, point)
        return any(least(shifted(self.row(side, k, box), box)) > 0 for side in self.sides)


def largest_sizes(m: Measurement, box: ExactBox) -> list[F]:
    """sup |P_i - a_i|, sup |b_i| and sup |L + l| + eps over the box: seven numbers."""
    away = [max(abs(m.position[i] - box.lo[i]), abs(m.position[i] - box.hi[i])) for i in AXES]
    arm = [max(abs(box.lo[i]), abs(box.hi[i])) for i in range(3, 6)]
    reach = max(abs(m.length + box.lo[OFFSET]), abs(m.length + box.hi[OFFSET])) + max(-box.lo[EPS], box.hi[EPS])
    return [*away, *arm, reach]


def reference(m: Measurement, side: str, box: ExactBox) -> tuple[tuple[F, ...], F]:
    """A reading of the set, and how much Q may be smaller than there at another reading, for any x in the box.

    Component by component: at an end where the slope keeps its sign (nearly), else at the centre.
    """
    radii = (*m.position_radius, *(r / 2 for r in m.rotation_radius), m.length_radius)
    if side == "length" or not any(radii):
        return (ZERO,) * 7, ZERO
    chosen, penalty = [], ZERO
    for p, bend, r in zip(slopes(m, side), bends(m, largest_sizes(m, box)), radii, strict=True):
        middle, half = span(shifted(p, box))
        low, high = middle - half - bend, middle + half + bend
        choices = ((2 * r * max(ZERO, -low), -r), (2 * r * max(ZERO, high), r), (r * max(-low, high), ZERO))
        loss, end = min(choices, key=lambda choice: choice[0])
        chosen.append(end)
        penalty += loss
    return tuple(chosen), penalty


def leg_vector(m: Measurement, x: tuple[F, ...], d: Triple, s: Triple) -> Triple:
    """v = P + d + R(1, s) R(q) b - a, exactly."""
    arm, kappa = arm_matrix(m, s), 1 + sum((c * c for c in s), ZERO)
    a, b, c = (m.position[i] + d[i] + sum((arm[i][j] * x[3 + j] for j in AXES), ZERO) / kappa - x[i] for i in AXES)
    return a, b, c


def extreme_lengths(m: Measurement, x: tuple[F, ...]) -> tuple[F, F]:
    """||v||^2 at the ends of the reading set where it is small and where it is large, by its slopes at the centre."""
    v = leg_vector(m, x, _NOTHING, _NOTHING)
    arm = [v[i] - m.position[i] + x[i] for i in AXES]
    turn = [arm[(i + 1) % 3] * v[(i + 2) % 3] - arm[(i + 2) % 3] * v[(i + 1) % 3] for i in AXES]
    lengths = []
    for sign in (-1, 1):
        d0, d1, d2 = (sign * _sign(v[i]) * m.position_radius[i] for i in AXES)
        s0, s1, s2 = (sign * _sign(turn[i]) * m.rotation_radius[i] / 2 for i in AXES)
        lengths.append(sum((c * c for c in leg_vector(m, x, (d0, d1, d2), (s0, s1, s2))), ZERO))
    return lengths[0], lengths[1]


def _sign(value: F) -> int:
    return (value > 0) - (value < 0)
