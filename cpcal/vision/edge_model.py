"""The grey levels that a blurred ellipse under light makes of pixels, and their derivatives; n ellipses, k pixels each.

The columns of the parameters, lengths in units of a dot's own radius:
0, 1 centre; 2, 3, 4 the conic's xx, xy, yy; 5 grey level around; 6 contrast; 7 logarithm of the blur; 8, 9 the light's
growth to the right and down.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

PARAMETERS = 10
_TINY = np.float32(1e-12)
_BELL = np.float32(1.0 / np.sqrt(2.0 * np.pi))


def depths(parameters: Array, x: Single, y: Single) -> Single:
    """The signed distances (n, k) of pixels (n, k) inside the ellipses, to first order (exact for circles)."""
    return _depths(parameters.astype(np.float32), x, y)[0]


def grey_model(parameters: Array, x: Single, y: Single, used: int) -> tuple[Single, Single]:
    """The grey levels (n, k) and their derivatives (n, used, k) by the first `used` parameters."""
    p = parameters.astype(np.float32)
    depth, x, y, u, v, slope = _depths(p, x, y)
    back, contrast, light_x, light_y = p[:, 5:6], p[:, 6:7], p[:, 8:9], p[:, 9:10]
    blur = np.exp(p[:, 7:8])
    out = np.empty((len(p), used, depth.shape[1]), dtype=np.float32)
    z = depth / blur
    density = np.exp(np.float32(-0.5) * z * z)
    share = _normal_share(z, density)
    light = light_x * x
    light += light_y * y
    light += np.float32(1.0)
    density *= light
    density *= _BELL * contrast / blur
    np.multiply(-density, depth, out=out[:, 7])
    density *= slope
    np.multiply(density, u, out=out[:, 0])
    np.multiply(density, v, out=out[:, 1])
    density *= np.float32(-0.5)
    x_bend = density * x
    np.multiply(x_bend, x, out=out[:, 2])
    np.multiply(x_bend, y, out=out[:, 3])
    out[:, 3] *= np.float32(2.0)
    density *= y
    np.multiply(density, y, out=out[:, 4])
    out[:, 5] = light
    np.multiply(light, share, out=out[:, 6])
    share *= contrast
    share += back
    if used > 8:
        np.multiply(share, x, out=out[:, 8])
        np.multiply(share, y, out=out[:, 9])
    share *= light
    return share, out


def _depths(p: Single, x: Single, y: Single) -> tuple[Single, ...]:
    """Distance inside, the coordinates from the centre, half the gradient (u, v) of the quadratic form, 1 / |(u, v)|."""
    x, y = x - p[:, :1], y - p[:, 1:2]
    u = p[:, 2:3] * x
    u += p[:, 3:4] * y
    v = p[:, 3:4] * x
    v += p[:, 4:5] * y
    root = x * u
    root += y * v
    np.sqrt(np.maximum(root, _TINY, out=root), out=root)
    slope = u * u
    slope += v * v
    slope += _TINY
    np.sqrt(slope, out=slope)
    np.reciprocal(slope, out=slope)
    depth = np.float32(1.0) - root
    depth *= root
    depth *= slope
    return depth, x, y, u, v, slope


def _normal_share(z: Single, bell: Single) -> Single:
    """The normal distribution's function at z, given exp(-z^2 / 2), to 8e-8 (Abramowitz and Stegun 26.2.17)."""
    t = np.abs(z)
    t *= np.float32(0.2316419)
    t += np.float32(1.0)
    np.reciprocal(t, out=t)
    series: Any = t * np.float32(1.330274429)
    for coefficient in (-1.821255978, 1.781477937, -0.356563782, 0.319381530):
        series += np.float32(coefficient)
        series *= t
    series *= bell
    series *= _BELL
    # 1 - series where z > 0: copysign makes it 1/2 + (1/2 - series) there and 1/2 - (1/2 - series) elsewhere
    np.subtract(np.float32(0.5), series, out=series)
    np.copysign(series, z, out=series)
    series += np.float32(0.5)
    return np.asarray(series)
