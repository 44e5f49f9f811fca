"""Exact arithmetic on float64 data: a point that solves a leg's equations with eps = 0, checked without any rounding.

For a measurement with rotation numerators N(q), N(1, s) (whole polynomials of quaternions, R = N / |q|^2) the vector

    w = |q|^2 (1 + s.s) (P - a) + N(1, s) N(q) b          is |q|^2 (1 + s.s) times v = P + R(1, s) R(q) b - a

so that comparing ||v|| with L + l needs sums and products only. The length reading is eliminated: some L within
lambda of L_k has ||v|| = L + l exactly when (L_k - lambda + l)^2 <= ||v||^2 <= (L_k + lambda + l)^2, bases >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.robot import Campaign, rotation_matrix

Floats = npt.NDArray[np.float64]
Objects = npt.NDArray[Any]

_INSIDE = 1.0 - 1e-9  # how far towards the end of its set a reading is taken


@dataclass(frozen=True, eq=False)
class Dyadic:
    """Exact numbers `mantissa * 2**-exponent`: an array of Python ints and one exponent."""

    mantissa: Objects
    exponent: int

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Dyadic:
        """The exact values of finite float64 numbers."""
        array = np.asarray(values, np.float64)
        ratios = [float(v).as_integer_ratio() for v in array.ravel()]
        exponent = max((d.bit_length() - 1 for _, d in ratios), default=0)
        whole = [n << (exponent - d.bit_length() + 1) for n, d in ratios]
        return cls(np.array(whole, dtype=object).reshape(array.shape), exponent)

    def __add__(self, other: Dyadic) -> Dyadic:
        e = max(self.exponent, other.exponent)
        return Dyadic((self.mantissa << (e - self.exponent)) + (other.mantissa << (e - other.exponent)), e)

    def __sub__(self, other: Dyadic) -> Dyadic:
        return self + Dyadic(-other.mantissa, other.exponent)

    def __mul__(self, other: Dyadic) -> Dyadic:
        return Dyadic(self.mantissa * other.mantissa, self.exponent + other.exponent)

    def __getitem__(self, index: Any) -> Dyadic:
        return Dyadic(np.asarray(self.mantissa[index], dtype=object), self.exponent)

    def sum(self) -> Dyadic:
        """Over the last axis."""
        return Dyadic(np.asarray(self.mantissa.sum(axis=-1), dtype=object), self.exponent)

    def nonnegative(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.mantissa >= 0, dtype=bool)


def solves_exactly(campaign: Campaign, leg: int, parameters: npt.ArrayLike) -> bool:
    """Whether for EVERY measurement SOME reading in its set has g(x, M) = 0 exactly. False: not shown.

    `parameters` (7,) in mm are taken as the exact numbers that they are. Two readings of position and rotation are
    tried, one that shortens the leg and one that lengthens it: the set is connected, so the leg takes every
    length between.
    """
    x, k = np.asarray(parameters, np.float64), leg - 1
    length, radius, offset = (Dyadic.of(v) for v in (campaign.length[:, k], campaign.length_radius[:, k], x[6]))
    shortest, longest = length - radius + offset, length + radius + offset
    short, long = (_squared_length(campaign, x, sign) for sign in (-1.0, 1.0))
    if short is None or long is None:
        return False
    small_enough = longest * longest * short[1] - short[0]
    large_enough = long[0] - shortest * shortest * long[1]
    return all(bool(np.all(d.nonnegative())) for d in (shortest, small_enough, large_enough))


def _squared_length(campaign: Campaign, x: Floats, sign: float) -> tuple[Dyadic, Dyadic] | None:
    """||w||^2 and its scale (|q|^2 (1 + s.s))^2 at the readings that make the leg long (sign 1) or short (-1).

    None when rounding has put a reading outside its set.
    """
    position, s = _readings(campaign, x, sign)
    off = Dyadic.of(position) - Dyadic.of(campaign.position)
    turn = Dyadic.of(2.0 * s)
    for moved, radius in ((off, campaign.position_radius), (turn, campaign.rotation_radius)):
        room = Dyadic.of(radius)
        if not (np.all((room - moved).nonnegative()) and np.all((room + moved).nonnegative())):
            return None
    one, q = Dyadic.of(np.ones(len(s))), Dyadic.of(campaign.quaternion)
    b = Dyadic.of(np.broadcast_to(x[3:6], s.shape))
    arm = _turned(one, Dyadic.of(s), _turned(q[:, 0], q[:, 1:], b))
    scale = (q * q).sum() * (one + (Dyadic.of(s) * Dyadic.of(s)).sum())
    w = (Dyadic.of(position) - Dyadic.of(x[:3])) * scale[:, None] + arm
    return (w * w).sum(), scale * scale


def _readings(campaign: Campaign, x: Floats, sign: float) -> tuple[Floats, Floats]:
    """Position (N, 3) and s (N, 3) near the ends of their sets, by the signs of the length's derivative."""
    arm = rotation_matrix(campaign.quaternion) @ x[3:6]
    v = campaign.position + arm - x[:3]
    position = campaign.position + sign * np.sign(v) * campaign.position_radius * _INSIDE
    return position, sign * np.sign(np.cross(arm, v)) * 0.5 * campaign.rotation_radius * _INSIDE


def _turned(scalar: Dyadic, vector: Dyadic, u: Dyadic) -> Dyadic:
    """N(q) u = (w^2 - r.r) u + 2 (r.u) r + 2 w (r x u) for quaternions (w, r): |q|^2 times the rotated u."""
    two = Dyadic.of(2.0)
    own = scalar * scalar - (vector * vector).sum()
    return own[:, None] * u + two * ((vector * u).sum()[:, None] * vector + scalar[:, None] * _cross(vector, u))


def _cross(x: Dyadic, y: Dyadic) -> Dyadic:
    forth, back = [1, 2, 0], [2, 0, 1]
    return x[:, forth] * y[:, back] - x[:, back] * y[:, forth]
