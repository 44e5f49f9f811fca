"""One measurement of a leg, and the square of the leg's vector as exact polynomials. Standard library only; part of
the checker.

The first unknowns are numbered 0-2: a, 3-5: b, 6: l. See docs/certificate-format.md for every formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F

from cpcal.checker.polynomial import ZERO, ExactBox, Polynomial, Vector, add

A, B, OFFSET = (0, 1, 2), (3, 4, 5), 6
AXES = (0, 1, 2)
ONE = ZERO + 1
CENTER = (ZERO,) * 7  # of the reading set
Matrix = Sequence[Sequence[F]]


@dataclass(frozen=True)
class Measurement:
    """What the campaign says of one row and one leg: exact numbers, mm and radians."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    position_radius: tuple[F, ...]
    rotation_radius: tuple[F, ...]
    length_radius: F

    @property
    def radii(self) -> tuple[F, ...]:
        """Of the seven components (d, s, e) of a reading."""
        return (*self.position_radius, *(r / 2 for r in self.rotation_radius), self.length_radius)

    @property
    def square(self) -> F:
        """The largest s.s of a reading."""
        return sum((r * r for r in self.radii[3:6]), ZERO)


def rotation(q: Vector) -> Matrix:
    """Rows of |q|^2 R(q), exactly."""
    w, x, y, z = q
    return [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]


def product(m: Matrix, n: Matrix) -> Matrix:
    return [[sum((m[i][k] * n[k][j] for k in AXES), ZERO) for j in AXES] for i in AXES]


def arm_matrix(measurement: Measurement, s: Vector) -> Matrix:
    """(1 + s.s) R(1, s) R(q), so that (1 + s.s) v = (1 + s.s) (P + d - a) + arm b."""
    q = measurement.quaternion
    scale = sum((c * c for c in q), ZERO)
    turned = rotation(q) if not any(s) else product(rotation((ONE, *s)), rotation(q))
    return [[entry / scale for entry in row] for row in turned]


def kappa(reading: Vector) -> F:
    """1 + s.s."""
    return 1 + sum((c * c for c in reading[3:6]), ZERO)


def vector(measurement: Measurement, x: Vector, reading: Vector) -> list[F]:
    """v = P + d + R(1, s) R(q) b - a at a point."""
    arm, scale = arm_matrix(measurement, reading[3:6]), kappa(reading)
    turned = (sum((arm[i][j] * x[B[j]] for j in AXES), ZERO) / scale for i in AXES)
    return [measurement.position[i] + reading[i] + c - x[A[i]] for i, c in enumerate(turned)]


def distance(measurement: Measurement, reading: Vector) -> Polynomial:
    """(1 + s.s) ||v||^2 at a reading (d, s, e) of seven numbers."""
    p: Polynomial = {}
    scale, arm = kappa(reading), arm_matrix(measurement, reading[3:6])
    for i in AXES:
        center = measurement.position[i] + reading[i]
        add(p, (), scale * center**2)
        add(p, (A[i],), -2 * scale * center)
        add(p, (A[i], A[i]), scale)
        add(p, (B[i], B[i]), scale)
        for j in AXES:
            add(p, (B[j],), 2 * center * arm[i][j])
            add(p, (A[i], B[j]), -2 * arm[i][j])
    return p


def distance_slopes(measurement: Measurement) -> list[Polynomial]:
    """Derivatives of `distance` with respect to the components of the reading, at the centre of its set."""
    arm = arm_matrix(measurement, CENTER[3:6])
    out: list[Polynomial] = []
    for i in AXES:  # 2 v_i
        p: Polynomial = {(): 2 * measurement.position[i], (A[i],): -2 * ONE}
        for j in AXES:
            add(p, (B[j],), 2 * arm[i][j])
        out.append(p)
    for i in AXES:  # 4 (b' x (P - a))_i with b' = R b
        j, k = (i + 1) % 3, (i + 2) % 3
        p = {}
        for n in AXES:
            for row, other, factor in ((j, k, 4), (k, j, -4)):
                add(p, (B[n],), factor * arm[row][n] * measurement.position[other])
                add(p, (B[n], A[other]), -factor * arm[row][n])
        out.append(p)
    return [*out, {}]


def distance_bends(measurement: Measurement, box: ExactBox) -> list[F]:
    """How far each of these slopes is at most from its value at the centre, for x in the box and all readings."""
    away = [max(abs(measurement.position[i] - box.lo[i]), abs(measurement.position[i] - box.hi[i])) for i in AXES]
    arm_size = sum((max(abs(box.lo[j]), abs(box.hi[j])) for j in B), ZERO)
    p, t, square = measurement.position_radius, measurement.radii[3:6], measurement.square
    total = sum(t, ZERO)
    span = [away[i] + p[i] for i in AXES]
    # every component of R b is at most the sum of |b_j|; of (R(1,s)(1+s.s) - I) R b at most `turn`
    turn = (2 * total + 5 * square) * arm_size
    out = [2 * (square * away[i] + (1 + square) * p[i] + turn) for i in AXES]
    size = sum((c * c for c in span), ZERO) + arm_size**2
    for i in AXES:
        j, k = (i + 1) % 3, (i + 2) % 3
        shifted = 4 * arm_size * (p[j] + p[k])
        curved = 4 * arm_size * (t[i] * sum(span, ZERO) + span[i] * total + sum((span[n] * t[n] for n in AXES), ZERO))
        out.append(shifted + curved + 2 * t[i] * size)
    return [*out, ZERO]
