"""One measurement of a leg as exact polynomials. Standard library only; part of the checker.

Unknowns are numbered 0-2: a, 3-5: b, 6: l, 7: eps. See docs/certificate-format.md for every formula.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction as F

from cpcal.proof.polynomial import ZERO, Polynomial, Vector, add, square

A, B, OFFSET, EPS = (0, 1, 2), (3, 4, 5), 6, 7
AXES = (0, 1, 2)
ONE = ZERO + 1
Matrix = list[list[F]]


@dataclass(frozen=True)
class Measurement:
    """What the campaign says of one row and one leg: exact numbers, mm and radians."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    position_radius: tuple[F, ...]
    rotation_radius: tuple[F, ...]
    length_radius: F


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


def inequality(measurement: Measurement, side: str, reading: tuple[F, ...]) -> Polynomial:
    """The left side Q of `Q <= 0` for side "upper", "lower" or "length", at a reading (d, s, e) of 7 numbers."""
    p: Polynomial = {}
    if side == "length":
        add(p, (EPS,), ONE)
        add(p, (OFFSET,), -ONE)
        add(p, (), measurement.length_radius - measurement.length)
        return p
    sign = 1 if side == "upper" else -1
    d, s, e = reading[:3], reading[3:6], reading[6]
    kappa = 1 + sum((c * c for c in s), ZERO)
    arm = arm_matrix(measurement, s)
    center = [measurement.position[i] + d[i] for i in AXES]
    for i in AXES:  # (1 + s.s) ||v||^2
        add(p, (), sign * kappa * center[i] ** 2)
        add(p, (A[i],), -2 * sign * kappa * center[i])
        add(p, (A[i], A[i]), sign * kappa)
        add(p, (B[i], B[i]), sign * kappa)
        for j in AXES:
            add(p, (B[j],), 2 * sign * center[i] * arm[i][j])
            add(p, (A[i], B[j]), -2 * sign * arm[i][j])
    base: Polynomial = {(): measurement.length + e, (OFFSET,): ONE, (EPS,): sign * ONE}
    for monomial, c in square(base).items():  # less (1 + s.s) (L + e + l +- eps)^2
        add(p, monomial, -sign * kappa * c)
    return p


def slopes(measurement: Measurement, side: str) -> list[Polynomial]:
    """Derivatives of Q with respect to the seven components of the reading, at the centre of its set."""
    sign = 1 if side == "upper" else -1
    arm = arm_matrix(measurement, (ZERO, ZERO, ZERO))
    out: list[Polynomial] = []
    for i in AXES:  # 2 v_i
        p: Polynomial = {(): 2 * sign * measurement.position[i], (A[i],): -2 * sign * ONE}
        for j in AXES:
            add(p, (B[j],), 2 * sign * arm[i][j])
        out.append(p)
    for i in AXES:  # 4 (b' x (P - a))_i with b' = R b
        j, k = (i + 1) % 3, (i + 2) % 3
        p = {}
        for n in AXES:
            for row, other, factor in ((j, k, 4 * sign), (k, j, -4 * sign)):
                add(p, (B[n],), factor * arm[row][n] * measurement.position[other])
                add(p, (B[n], A[other]), -factor * arm[row][n])
        out.append(p)
    out.append({(): -2 * sign * measurement.length, (OFFSET,): -2 * sign * ONE, (EPS,): -2 * ONE})
    return out


def bends(measurement: Measurement, largest: Vector) -> list[F]:
    """How far each slope is at most from its value at the centre of the set, for |P - a|, |b|, |L + l| + eps up to
    `largest` = (sup|P_1 - a_1|, .., sup|b_3| , sup(|L + l| + eps)), eight numbers less one.
    """
    away, arm_size, reach = largest[:3], sum(largest[3:6], ZERO), largest[6]
    p, lam = measurement.position_radius, measurement.length_radius
    t = [r / 2 for r in measurement.rotation_radius]
    total, square = sum(t, ZERO), sum((c * c for c in t), ZERO)
    span = [away[i] + p[i] for i in AXES]
    # every component of R b is at most the sum of |b_j|; of (R(1,s)(1+s.s) - I) R b at most `turn`
    turn = (2 * total + 5 * square) * arm_size
    out = [2 * (square * away[i] + (1 + square) * p[i] + turn) for i in AXES]
    size = sum((c * c for c in span), ZERO) + arm_size**2 + (reach + lam) ** 2
    for i in AXES:
        j, k = (i + 1) % 3, (i + 2) % 3
        shifted = 4 * arm_size * (p[j] + p[k])
        curved = 4 * arm_size * (t[i] * sum(span, ZERO) + span[i] * total + sum((span[n] * t[n] for n in AXES), ZERO))
        out.append(shifted + curved + 2 * t[i] * size)
    out.append(2 * ((1 + square) * lam + square * reach))
    return out
