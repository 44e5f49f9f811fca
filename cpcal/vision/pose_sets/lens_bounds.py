"""Enclosures of the lens on boxes of directions, for all cameras of a set: d(x, y), its slopes and its curvatures.

The lens of the model "brown" is d = (x, y) g(r^2) + t (see `lens_models`), the gradient of a potential: its Jacobian is
symmetric, its second derivatives are symmetric in all three indices. All are linear in k1, k2, p1, p2, k3, so that over
a set of cameras they are what they are for its centre, and a linear form in t: errors of these numbers that go
together, as those of a calibration do, are not taken one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.solver.interval import IntervalArray
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, stacked
from cpcal.vision.pose_sets.uncertain import CameraSet

_STRAIGHT = np.array([1.0, 1.0, *np.zeros(7)])  # a camera without distortion
_UNITS = _STRAIGHT + np.eye(9)[4:]
_TWO, _THREE, _FOUR, _SIX = (exact(float(k)) for k in (2, 3, 4, 6))


def product(*factors: IntervalArray) -> IntervalArray:
    out = factors[0]
    for factor in factors[1:]:
        out = ENGINE.mul(out, factor)
    return out


def total(parts: Sequence[IntervalArray]) -> IntervalArray:
    out = parts[0]
    for part in parts[1:]:
        out = ENGINE.add(out, part)
    return out


@dataclass(frozen=True)
class LensBounds:
    """On boxes (...,): d (..., 2); slopes (..., 3), of the first component by x, of it by y (the same as of the second
    by x), of the second by y."""

    value: IntervalArray
    slopes: IntervalArray

    @property
    def jacobian(self) -> IntervalArray:
        """(..., 2, 2)"""
        s = self.slopes
        return stacked([stacked([s[..., 0], s[..., 1]]), stacked([s[..., 1], s[..., 2]])], axis=-2)

    @property
    def least_slope(self) -> IntervalArray:
        """(...,) whose lower bound no eigenvalue of a Jacobian is below (Gershgorin)."""
        s, e = self.slopes, ENGINE
        off = exact(s[..., 1].mag)
        a, b = e.sub(s[..., 0], off), e.sub(s[..., 2], off)
        return IntervalArray(np.minimum(a.lo, b.lo), np.minimum(a.hi, b.hi))


def lens_over(x: IntervalArray, cameras: CameraSet) -> LensBounds:
    """Of boxes of directions x (..., 2), for all cameras of a set. `value` is meant for boxes that are points."""
    at = lens_bounds(x, exact(cameras.camera.numbers))
    if not cameras.size:
        return at
    units = [lens_bounds(x, exact(unit)) for unit in _UNITS]
    e, plain = ENGINE, lens_bounds(x, exact(_STRAIGHT))
    value = _over(at.value, [e.sub(one.value, plain.value) for one in units], cameras)
    return LensBounds(value, _over(at.slopes, [e.sub(one.slopes, plain.slopes) for one in units], cameras))


def curvatures_over(x: IntervalArray, cameras: CameraSet) -> IntervalArray:
    """(..., 4), as `curvatures`, for all cameras of a set."""
    at = curvatures(x, exact(cameras.camera.numbers))
    return _over(at, [curvatures(x, exact(unit)) for unit in _UNITS], cameras) if cameras.size else at


def _over(at: IntervalArray, by: Sequence[IntervalArray], cameras: CameraSet) -> IntervalArray:
    """What is linear in the lens's numbers, and `at` those of the centre: `by` each of the five (...,)."""
    rows = ENGINE.dot(stacked(by), exact(cameras.spread[4:]))
    most = cameras.most(rows).hi
    return ENGINE.add(at, IntervalArray(-most, most))


def lens_bounds(x: IntervalArray, numbers: IntervalArray) -> LensBounds:
    """Of boxes of directions x (..., 2); numbers (9,): fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    e = ENGINE
    k1, k2, p1, p2, k3 = (numbers[4 + k] for k in range(5))
    u, v = x[..., 0], x[..., 1]
    uu, vv, uv = e.sqr(u), e.sqr(v), e.mul(u, v)
    s = e.add(uu, vv)

    g = e.add(exact(1.0), e.mul(s, e.add(k1, e.mul(s, e.add(k2, e.mul(s, k3))))))
    g1 = e.add(k1, e.mul(s, e.add(e.mul(_TWO, k2), e.mul(s, e.mul(_THREE, k3)))))
    du = total([e.mul(u, g), product(_TWO, p1, uv), e.mul(p2, e.add(s, e.mul(_TWO, uu)))])
    dv = total([e.mul(v, g), product(_TWO, p2, uv), e.mul(p1, e.add(s, e.mul(_TWO, vv)))])
    along = total([g, product(_TWO, g1, uu), product(_TWO, p1, v), product(_SIX, p2, u)])
    mixed = total([product(_TWO, g1, uv), product(_TWO, p1, u), product(_TWO, p2, v)])
    down = total([g, product(_TWO, g1, vv), product(_SIX, p1, v), product(_TWO, p2, u)])
    return LensBounds(stacked([du, dv]), stacked([along, mixed, down]))


def curvatures(x: IntervalArray, numbers: IntervalArray) -> IntervalArray:
    """(..., 4): second derivatives of d on boxes x (..., 2): xxx, xxy, xyy, yyy."""
    e = ENGINE
    k1, k2, p1, p2, k3 = (numbers[4 + k] for k in range(5))
    u, v = x[..., 0], x[..., 1]
    uu, vv = e.sqr(u), e.sqr(v)
    s = e.add(uu, vv)
    g1 = e.add(k1, e.mul(s, e.add(e.mul(_TWO, k2), e.mul(s, e.mul(_THREE, k3)))))
    g2 = e.add(e.mul(_TWO, k2), product(_SIX, s, k3))
    xxx = total([e.mul(_SIX, p2), product(_SIX, g1, u), product(_FOUR, g2, uu, u)])
    xxy = total([e.mul(_TWO, p1), product(_TWO, g1, v), product(_FOUR, g2, uu, v)])
    xyy = total([e.mul(_TWO, p2), product(_TWO, g1, u), product(_FOUR, g2, vv, u)])
    yyy = total([e.mul(_SIX, p1), product(_SIX, g1, v), product(_FOUR, g2, vv, v)])
    return stacked([xxx, xxy, xyy, yyy])


def number_slopes(x: IntervalArray, numbers: IntervalArray) -> IntervalArray:
    """(..., 2, 9): derivatives of pixels by fx, fy, cx, cy, k1, k2, p1, p2, k3 at directions x (..., 2)."""
    e = ENGINE
    u, v = x[..., 0], x[..., 1]
    uu, vv, uv = e.sqr(u), e.sqr(v), e.mul(u, v)
    s = e.add(uu, vv)
    s2 = e.sqr(s)
    s3, two = e.mul(s2, s), _TWO
    bent = lens_bounds(x, numbers).value
    zero, one = exact(np.zeros(u.shape)), exact(np.ones(u.shape))
    by_x = [e.mul(u, s), e.mul(u, s2), e.mul(two, uv), e.add(s, e.mul(two, uu)), e.mul(u, s3)]
    by_y = [e.mul(v, s), e.mul(v, s2), e.add(s, e.mul(two, vv)), e.mul(two, uv), e.mul(v, s3)]
    first = [bent[..., 0], zero, one, zero, *(e.mul(numbers[0], part) for part in by_x)]
    second = [zero, bent[..., 1], zero, one, *(e.mul(numbers[1], part) for part in by_y)]
    return stacked([stacked(first), stacked(second)], axis=-2)
