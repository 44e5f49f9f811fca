"""From a box of the 24 unknowns to ranges of twelve parameters, in exact arithmetic and rounded outward."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction as F

from cpcal.handeye.exact_errors import Matrix, PlacedFrames, exact_rotation
from cpcal.handeye.frame_equations import R_F, R_X, T_F, T_X

Interval = tuple[F, F]
_DEGREE_UP = F(math.nextafter(180.0, math.inf)) / F(math.nextafter(math.pi, 0.0))  # more than a radian has of them


def parameter_ranges(
    lo: Sequence[float], hi: Sequence[float], about: PlacedFrames
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Lower and upper ends (12): position in mm, turn in degrees from the frames `about`, of camera and target."""
    low: list[float] = []
    high: list[float] = []
    for turn, shift, quaternion in ((R_X, T_X, about.camera_quaternion), (R_F, T_F, about.target_quaternion)):
        low += [lo[i] for i in shift]
        high += [hi[i] for i in shift]
        box = [[(F(lo[turn[3 * a + b]]), F(hi[turn[3 * a + b]])) for b in range(3)] for a in range(3)]
        for ends in turns(box, exact_rotation(quaternion)):
            low.append(ends[0])
            high.append(ends[1])
    return tuple(low), tuple(high)


def turns(box: list[list[Interval]], center: Matrix) -> list[tuple[float, float]]:
    """Rotation vectors w, in degrees, of all rotations exp([w]) C in a box of matrices; +-180 beyond 60 degrees.

    M = R C^T lies in a box. Its skew part is sin(theta) times the axis, and ||M - I||^2 = 8 sin^2(theta / 2), so with
    k = sin(theta / 2) <= 1/2, w is the skew part times theta / sin(theta), which lies between 1 and
    1 / (1 - theta^2 / 6); theta <= 2 k / sqrt(1 - k^2).
    """
    product = [[_dot([box[a][j] for j in range(3)], center[b]) for b in range(3)] for a in range(3)]
    square = F(0)
    for a in range(3):
        for b in range(3):
            low, high = (end - (a == b) for end in product[a][b])
            square += max(low * low, high * high)
    k2 = square / 8
    if k2 > F(1, 4):
        return [(-180.0, 180.0)] * 3
    factor = 1 / (1 - 4 * k2 / (1 - k2) / 6)
    found = []
    for p, q in ((2, 1), (0, 2), (1, 0)):
        low = (product[p][q][0] - product[q][p][1]) / 2
        high = (product[p][q][1] - product[q][p][0]) / 2
        found.append((-_degrees(-low, factor), _degrees(high, factor)))
    return found


def _dot(row: list[Interval], numbers: list[F]) -> Interval:
    ends = [(low * c, high * c) if c >= 0 else (high * c, low * c) for (low, high), c in zip(row, numbers, strict=True)]
    return sum((end[0] for end in ends), F(0)), sum((end[1] for end in ends), F(0))


def _degrees(sine: F, factor: F) -> float:
    """An upper bound in degrees of a component, whose sine-weighted value is at most this."""
    value = sine * factor * _DEGREE_UP if sine >= 0 else sine
    # of a negative upper end the factor 1 is the safe one; degrees rounded towards zero
    if sine < 0:
        value = sine * F(math.nextafter(180.0, 0.0)) / F(math.nextafter(math.pi, math.inf))
    near = float(value)
    return near if F(near) >= value else math.nextafter(near, math.inf)
