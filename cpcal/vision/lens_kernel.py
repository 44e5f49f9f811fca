"""How a lens bends a direction, compiled: the radial factor with its derivatives, the lens, and its inverse.

A lens is packed as (9,) numbers: 1 for a fisheye and 0 otherwise; p1, p2; k1 to k6 (k4 to k6 are zero for "brown", k5
and k6 for "fisheye"). `cpcal.vision.lens_models` says what they stand for.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.compiled import compiled

PACKED = 9
_NEAR = 1e-2  # below this r^2 the series of atan(r) / r has all digits
_TERMS = 12
_NEWTON_STEPS = 50
_LAST = 1e-8  # of a normalised coordinate: after so short a step of Newton the error is its square
_EXACT = 1e-9  # how near the inverse must come

Four = tuple[float, float, float, float]


@compiled
def radial(lens: Floats, s: float) -> Four:
    """The factor g(s), s = r^2, and its first three derivatives by s."""
    if lens[0] != 0.0:
        return _fisheye(lens, s)
    n, n1, n2, n3 = _cubic(s, lens[3], lens[4], lens[5])
    if lens[6] == 0.0 and lens[7] == 0.0 and lens[8] == 0.0:
        return n, n1, n2, n3
    d, d1, d2, d3 = _cubic(s, lens[6], lens[7], lens[8])
    g = n / d
    g1 = (n1 - g * d1) / d
    g2 = (n2 - 2.0 * g1 * d1 - g * d2) / d
    return g, g1, g2, (n3 - 3.0 * g2 * d1 - 3.0 * g1 * d2 - g * d3) / d


@compiled
def _cubic(s: float, a: float, b: float, c: float) -> Four:
    """1 + a s + b s^2 + c s^3."""
    return 1.0 + s * (a + s * (b + s * c)), a + s * (2.0 * b + s * 3.0 * c), 2.0 * b + s * 6.0 * c, 6.0 * c


@compiled
def _fisheye(lens: Floats, s: float) -> Four:
    h = _angle_by_radius(s)
    square = _product((s, 1.0, 0.0, 0.0), _product(h, h))  # a^2
    total = (0.0, 0.0, 0.0, 0.0)
    for k in (lens[6], lens[5], lens[4], lens[3], 1.0):  # Horner's rule
        value, first, second, third = _product(total, square)
        total = (value + k, first, second, third)
    return _product(h, total)


@compiled
def _product(f: Four, g: Four) -> Four:
    """Leibniz's rule."""
    return (
        f[0] * g[0],
        f[1] * g[0] + f[0] * g[1],
        f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2],
        f[3] * g[0] + 3.0 * f[2] * g[1] + 3.0 * f[1] * g[2] + f[0] * g[3],
    )


@compiled
def _angle_by_radius(s: float) -> Four:
    """h = atan(r) / r; away from 0 from 2 s h' + h = 1 / (1 + s) and that, derived: near it by the series."""
    if s < _NEAR:
        h, h1, h2, h3, power = 0.0, 0.0, 0.0, 0.0, 1.0
        for k in range(_TERMS):  # of (-1)^k s^k / (2 k + 1), and derived
            sign = 1.0 - 2.0 * (k % 2)
            h += sign * power / (2 * k + 1)
            h1 -= sign * power * (k + 1) / (2 * k + 3)
            h2 += sign * power * (k + 1) * (k + 2) / (2 * k + 5)
            h3 -= sign * power * (k + 1) * (k + 2) * (k + 3) / (2 * k + 7)
            power *= s
        return h, h1, h2, h3
    r = np.sqrt(s)
    h = np.arctan(r) / r
    h1 = (1.0 / (1.0 + s) - h) / (2.0 * s)
    h2 = (-1.0 / (1.0 + s) ** 2 - 3.0 * h1) / (2.0 * s)
    return h, h1, h2, (2.0 / (1.0 + s) ** 3 - 5.0 * h2) / (2.0 * s)


@compiled
def radials(lens: Floats, s: Floats, out: Floats) -> None:
    """`radial` of s (n,), into (4, n)."""
    for i in range(len(s)):
        out[0, i], out[1, i], out[2, i], out[3, i] = radial(lens, s[i])


@compiled
def bent(lens: Floats, x: float, y: float) -> tuple[float, float, float, float, float]:
    """d(x, y), and the derivatives of the first component by x, of it by y (and of the other by x), of the other by
    y."""
    p1, p2 = lens[1], lens[2]
    r2 = x * x + y * y
    g, slope, _, _ = radial(lens, r2)
    return (
        x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        g + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        2.0 * slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
        g + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@compiled
def all_bent(lens: Floats, points: Floats, out: Floats) -> None:
    """`bent` of points (n, 2), into (n, 5)."""
    for i in range(len(points)):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = bent(lens, points[i, 0], points[i, 1])


@compiled
def unbent(lens: Floats, wanted: Floats, out: Floats) -> None:
    """The directions (n, 2) that are bent to those wanted (n, 2), by Newton's method; nan where there is none
    nearby."""
    for i in range(len(wanted)):
        u, v = wanted[i, 0], wanted[i, 1]
        x, y = u, v
        for _ in range(_NEWTON_STEPS):
            dx, dy, xx, xy, yy = bent(lens, x, y)
            off_x, off_y, determinant = u - dx, v - dy, xx * yy - xy * xy
            step_x, step_y = (yy * off_x - xy * off_y) / determinant, (xx * off_y - xy * off_x) / determinant
            x, y = x + step_x, y + step_y
            if not (abs(step_x) > _LAST or abs(step_y) > _LAST):
                break
        dx, dy, _, _, _ = bent(lens, x, y)
        near = abs(dx - u) < _EXACT and abs(dy - v) < _EXACT
        out[i, 0], out[i, 1] = (x, y) if near else (np.nan, np.nan)
