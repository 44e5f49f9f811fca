"""The grey levels that a blurred ellipse under light makes of pixels, and the normal equations of its parameters.

n ellipses see the same k pixels, relative to a pixel of their own. So every derivative is one of a few arrays (n, k)
times a polynomial of the pixels' coordinates, and the normal equations are products with the table of monomials: no
array of derivatives is ever formed.

The columns of the parameters, lengths in units of the stencil's:
0, 1 centre; 2, 3, 4 the conic's xx, xy, yy; 5 grey level around; 6 contrast; 7 logarithm of the blur; 8, 9 the light's
growth to the right and down.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats

Single = npt.NDArray[np.float32]

PARAMETERS = 10
_TINY = np.float32(1e-12)
_FLAT = np.float32(1e-4)  # the squared half gradient, next to the centre
_DIM = np.float32(0.05)  # light, at least, relative to that at the centre
_BELL = np.float32(1.0 / np.sqrt(2.0 * np.pi))
_POWERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]  # the monomials of a quadratic form
_HIGHER = [*_POWERS, (3, 0), (2, 1), (1, 2), (0, 3), (4, 0), (3, 1), (2, 2), (1, 3), (0, 4)]  # their products
_PRODUCT = np.array([[_HIGHER.index((a + c, b + d)) for c, d in _POWERS] for a, b in _POWERS])


def monomials(x: Floats, y: Floats) -> Single:
    """The table (15, k) of the monomials up to the fourth degree of pixels (k,)."""
    xs, ys = ([np.ones_like(x)] for _ in "xy")
    for _ in range(4):
        xs.append(xs[-1] * x)
        ys.append(ys[-1] * y)
    return np.stack([xs[a] * ys[b] for a, b in _HIGHER]).astype(np.float32)


def depths(parameters: Floats, table: Single) -> Single:
    """The signed distances (n, k) of pixels inside the ellipses, to first order (exact for circles)."""
    return _depths(parameters, table)[0]


def normal_equations(
    parameters: Floats, table: Single, level: Single, weight: Single, used: int
) -> tuple[Floats, Floats, Floats]:
    """Of the first `used` parameters: the normal matrices (n, used, used), right sides (n, used) and the sums (n,) of
    squared residuals, for grey levels (n, k) of weight 0 or 1, themselves 0 where the weight is."""
    p = parameters.astype(np.float32)
    depth, slope = _depths(parameters, table)
    z = depth * np.exp(-p[:, 7:8])
    density: Single = z * z
    density *= np.float32(-0.5)
    np.exp(density, out=density)
    share = _normal_share(z, density)
    light = _light(parameters) @ table[:3]
    light *= weight
    density *= light
    density *= _BELL * p[:, 6:7] * np.exp(-p[:, 7:8])
    share *= light
    model = p[:, 6:7] * share
    model += p[:, 5:6] * light
    residual = level - model
    depth *= density
    np.negative(depth, out=depth)
    density *= slope
    density *= np.float32(-0.5)  # by the quadratic form
    return _assembled(parameters, table, density, [light, share, depth], model, light, residual, used)


def _assembled(
    parameters: Floats,
    table: Single,
    by_form: Single,
    others: list[Single],
    model: Single,
    light: Single,
    residual: Single,
    used: int,
) -> tuple[Floats, Floats, Floats]:
    n, plain = len(parameters), len(others)
    forms = _form_derivatives(parameters)
    normal, right = np.empty((n, used, used)), np.empty((n, used))
    # by_form times itself, the others and the residual, by the quadratic form's coefficients: one product with `forms`
    by_form_times = np.empty((n, 6, 6 + plain + 1))
    columns = np.ascontiguousarray(table.T)  # twice as fast
    low = np.ascontiguousarray(columns[:, :6])
    by_form_times[..., :6] = ((by_form * by_form) @ columns).take(_PRODUCT, axis=1)
    for i, one in enumerate([*others, residual], start=6):
        by_form_times[..., i] = (by_form * one) @ low
    products = forms @ by_form_times
    normal[:, :5, :5] = products[..., :6] @ forms.transpose(0, 2, 1)
    normal[:, :5, 5 : 5 + plain] = products[..., 6:-1]
    normal[:, 5 : 5 + plain, :5] = products[..., 6:-1].transpose(0, 2, 1)
    right[:, :5] = products[..., -1]
    for i, one in enumerate(others, start=5):
        right[:, i] = _dot(one, residual)
        for j in range(5, i + 1):
            normal[:, i, j] = normal[:, j, i] = _dot(one, others[j - 5])
    if used > 5 + plain:
        even = np.divide(model, np.maximum(light, _DIM), dtype=np.float32)
        _add_light(parameters, table, normal, right, forms, by_form, others, even, residual)
    return normal, right, _dot(residual, residual)


def _add_light(
    parameters: Floats,
    table: Single,
    normal: Floats,
    right: Floats,
    forms: Floats,
    by_form: Single,
    others: list[Single],
    plain: Single,
    residual: Single,
) -> None:
    """The rows of the light's growth: derivatives are `plain`, grey levels under even light, times (p - centre)."""
    shift = np.zeros((len(parameters), 2, 6))
    shift[:, 0, 1] = shift[:, 1, 2] = 1.0
    shift[:, :, 0] = -parameters[:, :2]
    low = table[:6].T
    product = ((plain * by_form) @ table.T)[:, _PRODUCT]
    normal[:, 8:, :5] = shift @ product @ forms.transpose(0, 2, 1)
    for i, one in enumerate(others, start=5):
        normal[:, 8:, i] = (shift @ ((plain * one) @ low)[..., None])[..., 0]
    normal[:, 8:, 8:] = shift @ ((plain * plain) @ table.T)[:, _PRODUCT] @ shift.transpose(0, 2, 1)
    right[:, 8:] = (shift @ ((plain * residual) @ low)[..., None])[..., 0]
    normal[:, :8, 8:] = normal[:, 8:, :8].transpose(0, 2, 1)


def _dot(one: Single, other: Single) -> Floats:
    return np.asarray(np.einsum("nk,nk->n", one, other), dtype=np.float64)


def _depths(p: Floats, table: Single) -> tuple[Single, Single]:
    """The distance inside and 1 / the quadratic form's half gradient."""
    xx, xy, yy = p[:, 2], p[:, 3], p[:, 4]
    root = _form(p, xx, xy, yy) @ table[:6]
    slope = _form(p, xx * xx + xy * xy, xy * (xx + yy), xy * xy + yy * yy) @ table[:6]
    np.sqrt(np.maximum(root, _TINY, out=root), out=root)
    np.sqrt(np.maximum(slope, _FLAT, out=slope), out=slope)
    np.reciprocal(slope, out=slope)
    depth = np.float32(1.0) - root
    depth *= root
    depth *= slope
    return depth, slope


def _form(p: Floats, xx: Floats, xy: Floats, yy: Floats) -> Single:
    """The coefficients (n, 6) of a quadratic form of the pixels' place relative to the centre."""
    x, y = p[:, 0], p[:, 1]
    u, v = xx * x + xy * y, xy * x + yy * y
    return np.array([u * x + v * y, -2.0 * u, -2.0 * v, xx, 2.0 * xy, yy], dtype=np.float32).T


def _light(p: Floats) -> Single:
    """The coefficients (n, 3) of the light relative to that at the centre."""
    constant = 1.0 - (p[:, 8:] * p[:, :2]).sum(axis=1)
    return np.array([constant, p[:, 8], p[:, 9]], dtype=np.float32).T


def _form_derivatives(p: Floats) -> Floats:
    """The derivatives (n, 5, 6) of the quadratic form's coefficients by the centre and the conic."""
    x, y, xx, xy, yy = p[:, :5].T
    out = np.zeros((len(p), 5, 6))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = 2.0 * (xx * x + xy * y), -2.0 * xx, -2.0 * xy
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2.0 * (xy * x + yy * y), -2.0 * xy, -2.0 * yy
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 3] = x * x, -2.0 * x, 1.0
    out[:, 3, 0], out[:, 3, 1], out[:, 3, 2], out[:, 3, 4] = 2.0 * x * y, -2.0 * y, -2.0 * x, 2.0
    out[:, 4, 0], out[:, 4, 2], out[:, 4, 5] = y * y, -2.0 * y, 1.0
    return out


def _normal_share(z: Single, bell: Single) -> Single:
    """The normal distribution's function at z, given exp(-z^2 / 2), to 1e-5 (Abramowitz and Stegun 26.2.16)."""
    t = np.abs(z)
    t *= np.float32(0.33267)
    t += np.float32(1.0)
    np.reciprocal(t, out=t)
    series: Any = t * np.float32(0.9372980)
    for coefficient in (-0.1201676, 0.4361836):
        series += np.float32(coefficient)
        series *= t
    series *= bell
    series *= _BELL
    # 1 - series where z > 0: copysign makes it 1/2 + (1/2 - series) there and 1/2 - (1/2 - series) elsewhere
    np.subtract(np.float32(0.5), series, out=series)
    np.copysign(series, z, out=series)
    series += np.float32(0.5)
    return np.asarray(series)
