"""One measurement in a leg model as rows `Q <= 0`. Standard library only; part of the checker.

With N = ||v||^2 - h and U = L + e + l + t + eps (upper; - eps: lower) Q is (1 + s.s) (N - U^2), or its negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property

from cpcal.checker.measurement import (
    AXES,
    CENTER,
    OFFSET,
    ONE,
    Measurement,
    distance,
    distance_bends,
    distance_slopes,
    kappa,
    vector,
)
from cpcal.checker.models import Model
from cpcal.checker.polynomial import (
    ZERO,
    ExactBox,
    Polynomial,
    Vector,
    combined,
    product,
    shifted,
    span,
    square,
    value,
)

_SIGN = {"upper": 1, "lower": -1}


@dataclass(frozen=True)
class Equation:
    """A measurement and a model."""

    measurement: Measurement
    model: Model

    @cached_property
    def length_slopes(self) -> list[Polynomial]:
        return self.model.length_slopes(self.measurement)

    @cached_property
    def distance_slopes(self) -> list[Polynomial]:
        return distance_slopes(self.measurement)

    def row(self, side: str, box: ExactBox) -> Polynomial:
        """At most zero at every solution in the box: Q at its reference reading, less the penalties."""
        m = self.measurement
        if side == "length":
            return {(self.model.eps,): ONE, (OFFSET,): -ONE, (): m.length_radius - m.length}
        reading, penalty = self.reference(side, box)
        row = self.inequality(side, reading)
        row[()] -= penalty
        if side == "lower":  # where U is negative, U^2 is at most slack^2
            row[()] -= (1 + m.square) * self.slack(box) ** 2
        return row

    def inequality(self, side: str, reading: Vector) -> Polynomial:
        """The left side Q of side "upper" or "lower" at a reading (d, s, e) of seven numbers."""
        m, sign = self.measurement, _SIGN[side]
        less, length = -sign * kappa(reading), square(self.model.length(m, sign, reading))
        return combined((sign, distance(m, reading)), (less, length), (less, self.model.square))

    def slopes(self, side: str) -> list[Polynomial]:
        """Derivatives of Q with respect to the seven components of the reading, at the centre of its set."""
        m, sign = self.measurement, _SIGN[side]
        length = self.model.length(m, sign, CENTER)
        pairs = zip(self.distance_slopes, self.length_slopes, strict=True)
        return [combined((sign, n), (-2 * sign, product(length, b))) for n, b in pairs]

    def bends(self, side: str, box: ExactBox) -> list[F]:
        """How far each slope is at most from its value at the centre, for x in the box and all readings."""
        m, model = self.measurement, self.model
        sizes = [_largest(p, box) for p in self.length_slopes]
        curves, spread = model.length_bends(m, box), self.spread(box)
        middle = _largest(model.length(m, _SIGN[side], CENTER), box)
        moved = (1 + m.square) * spread + m.square * middle  # of (1 + s.s) U
        reach = middle + spread
        parts = zip(distance_bends(m, box), sizes, curves, strict=True)
        out = [n + 2 * moved * size + 2 * (1 + m.square) * reach * curve for n, size, curve in parts]
        other = reach**2 + _largest(model.square, box)
        for i in AXES:  # of the factor 1 + s.s
            out[3 + i] += 2 * m.radii[3 + i] * other
        return out

    def spread(self, box: ExactBox) -> F:
        """How far the length is at most from that at the centre of the reading set, for x in the box."""
        m = self.measurement
        parts = zip(m.radii, self.length_slopes, self.model.length_bends(m, box), strict=True)
        return sum((r * (_largest(p, box) + curve) for r, p, curve in parts), ZERO)

    def slack(self, box: ExactBox) -> F:
        """-U is at most this at every solution in the box; without a term t, L_min + l >= eps makes U nonnegative."""
        if not self.model.corrected:
            return ZERO
        middle, half = span(shifted(self.model.length(self.measurement, -1, CENTER), box))
        return max(ZERO, half + self.spread(box) - middle)

    def reference(self, side: str, box: ExactBox) -> tuple[tuple[F, ...], F]:
        """A reading of the set, and how much Q may be smaller than there at another reading, for any x in the box.

        Component by component: at an end where the slope keeps its sign (nearly), else at the centre.
        """
        radii = self.measurement.radii
        if not any(radii):
            return CENTER, ZERO
        chosen, penalty = [], ZERO
        for p, bend, r in zip(self.slopes(side), self.bends(side, box), radii, strict=True):
            middle, half = span(shifted(p, box))
            low, high = middle - half - bend, middle + half + bend
            choices = ((2 * r * max(ZERO, -low), -r), (2 * r * max(ZERO, high), r), (r * max(-low, high), ZERO))
            loss, end = min(choices, key=lambda choice: choice[0])
            chosen.append(end)
            penalty += loss
        return tuple(chosen), penalty

    def holds(self, x: tuple[F, ...]) -> bool:
        """Whether it is proved that some reading has |sqrt(N) - (L + e + l + t)| <= eps, and the leg is long enough."""
        m, eps = self.measurement, x[self.model.eps]
        lowest = value(self.model.length(m, -1, CENTER), x) - self.spread(ExactBox(x, x))
        if eps < 0 or m.length - m.length_radius + x[OFFSET] < eps or lowest < 0:
            return False
        large = self.lengthening(x)
        (short, longest), (long, shortest) = (self._at(x, [sign * c for c in large]) for sign in (-1, 1))
        return bool(short <= (longest + eps) ** 2 and long >= (shortest - eps) ** 2)

    def _at(self, x: tuple[F, ...], reading: Vector) -> tuple[F, F]:
        """N and L + e + l + t."""
        v = vector(self.measurement, x, reading)
        n = sum((c * c for c in v), ZERO) - value(self.model.square, x)
        return n, value(self.model.length(self.measurement, 0, reading), x)

    def lengthening(self, x: tuple[F, ...]) -> list[F]:
        """The end of the set where sqrt(N) - (L + e + l + t) is large, by its slopes at the centre."""
        m = self.measurement
        v, n = vector(m, x, CENTER), max(ZERO, self._at(x, CENTER)[0])
        arm = [v[i] - m.position[i] + x[i] for i in AXES]
        turn = [arm[(i + 1) % 3] * v[(i + 2) % 3] - arm[(i + 2) % 3] * v[(i + 1) % 3] for i in AXES]
        of_n = [*(2 * c for c in v), *(4 * c for c in turn), ZERO]
        out = []
        for r, p, q in zip(m.radii, of_n, self.length_slopes, strict=True):
            slope = _signed_square(p) - 4 * n * _signed_square(value(q, x))  # has the sign of p - 2 sqrt(n) q
            out.append(r * ((slope > 0) - (slope < 0)))
        return out


def _signed_square(c: F) -> F:
    return c * abs(c)


def _largest(p: Polynomial, box: ExactBox) -> F:
    """An upper bound of |p| over the box."""
    middle, half = span(shifted(p, box))
    return abs(middle) + half
