"""By how much the centre of a dot's image may differ from the image of the dot's centre: bounded, not estimated.

The centre of a dot's image is the centroid of its area, a definite point. (The centre of a conic fitted to its outline,
which is what is measured, differs from it by the fourth order of the dot's size: see `dot_model`.)

Perspective. With tau = radius / Z, x = (X / Z, Y / Z) and n the plate's normal in the camera frame the image is, before
the lens, an ellipse E about x + e with the moments S / 4, q = 1 - tau^2 (1 - n_z^2),

    e_k = tau^2 (n_k n_z + x_k (1 - n_z^2)) / q
    S   = tau^2 (I - n n') / q + tau^2 ((1 - n_z^2) x x' + n_z (x n' + n x') + tau^2 n_z^2 n n') / q^2

Lens. At c + h, h in E - c, d = d(c) + J h + H(xi)[h, h] / 2 and the density of area w = det d' = w(c) + G(xi) . h.
Means over the image are means over E with the weight w / mean(w), and |mean of a weight's product with f, less that of
f| is at most (w_max / w_min - 1) mean |f|. So the centroid is

    d(c) + J a + b / 2,     a_i = mean(w h_i) / mean(w) = sum_j mean(G_j(xi) h_j h_i) / mean(w),
                            b = weighted mean of H(xi)[h, h]

where mean(h_i h_j) = S_ij / 4 and mean |h_i h_j| <= sqrt(S_ii S_jj) / 4; a coefficient that varies counts with its
middle for the first, and with its radius for the second.
"""

from __future__ import annotations

import numpy as np

from cpcal.solver.interval import IntervalArray
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, stacked
from cpcal.vision.pose_sets.lens_bounds import LensBounds, curvatures_over, lens_over
from cpcal.vision.pose_sets.uncertain import CameraSet

_ONE, _QUARTER, _HALF = (exact(v) for v in (1.0, 0.25, 0.5))
_PAIRS = ((0, 0), (0, 1), (1, 1))
_THIRD = np.array([[0, 1, 2], [1, 2, 3]])  # curvature of component k by the pair


def center_bias(
    x: IntervalArray, tau: IntervalArray, normal: IntervalArray, cameras: CameraSet
) -> IntervalArray | None:
    """Enclosures (m, 2), pixels, of centroid less image of the centre.

    x (m, 2), tau (m,) and normal (m, 3) as above. None where the lens may turn back within
    a dot's image.
    """
    e = ENGINE
    away, spread = _ellipse(x, tau, normal)
    center = e.add(x, away)
    size = stacked([e.sqrt(spread[..., 0]), e.sqrt(spread[..., 2])])
    extent = IntervalArray.around(np.zeros(size.shape), size.hi)
    at, around = lens_over(center, cameras), lens_over(e.add(center, extent), cameras)
    if not (around.least_slope.lo > 0.0).all():
        return None
    way = lens_over(e.add(x, e.mul(away, IntervalArray(np.zeros(1), np.ones(1)))), cameras).jacobian
    moved = e.sum(e.mul(way, away[..., None, :]), -1)
    bent = _bent(at, around, curvatures_over(e.add(center, extent), cameras), spread, size)
    return e.mul(cameras.numbers[:2], e.add(moved, bent))


def _ellipse(x: IntervalArray, tau: IntervalArray, normal: IntervalArray) -> tuple[IntervalArray, IntervalArray]:
    """e (m, 2) and S (m, 3): xx, xy, yy."""
    e = ENGINE
    square = e.sqr(tau)
    nz = normal[..., 2]
    lean = e.sub(_ONE, e.sqr(nz)).intersect(IntervalArray(np.zeros(nz.shape), np.ones(nz.shape)))
    q = e.sub(_ONE, e.mul(square, lean))
    first, second = e.div(square, q), e.div(square, e.sqr(q))
    across = normal[..., :2]
    away = e.mul(first[..., None], e.add(e.mul(across, nz[..., None]), e.mul(x, lean[..., None])))
    parts = []
    for i, j in _PAIRS:
        ni, nj, xi, xj = normal[..., i], normal[..., j], x[..., i], x[..., j]
        nn, xx = (e.sqr(ni), e.sqr(xi)) if i == j else (e.mul(ni, nj), e.mul(xi, xj))
        round_part = e.mul(first, e.sub(exact(float(i == j)), nn))
        mixed = e.mul(nz, e.add(e.mul(xi, nj), e.mul(xj, ni)))
        rest = e.add(e.add(e.mul(lean, xx), mixed), e.mul(e.mul(square, e.sqr(nz)), nn))
        whole = e.add(round_part, e.mul(second, rest))
        parts.append(IntervalArray(np.maximum(whole.lo, 0.0), whole.hi) if i == j else whole)
    return away, stacked(parts)


def _bent(
    at: LensBounds, around: LensBounds, curves: IntervalArray, spread: IntervalArray, size: IntervalArray
) -> IntervalArray:
    """J a + b / 2."""
    e = ENGINE
    xx, xy, yy = (around.slopes[..., k] for k in range(3))
    xxx, xxy, xyy, yyy = (curves[..., k] for k in range(4))
    two = exact(2.0)
    weight = e.sub(e.mul(xx, yy), e.sqr(xy))
    weight = IntervalArray(np.maximum(weight.lo, e.sqr(around.least_slope).lo), weight.hi)
    by_x = e.sub(e.add(e.mul(xxx, yy), e.mul(xx, xyy)), e.mul(two, e.mul(xy, xxy)))
    by_y = e.sub(e.add(e.mul(xxy, yy), e.mul(xx, yyy)), e.mul(two, e.mul(xy, xyy)))
    ratio = e.div(exact(weight.hi), exact(weight.lo))
    most = stacked([e.mul(_QUARTER, e.mul(size[..., i], size[..., j])) for i, j in _PAIRS])  # mean |h_i h_j|
    mean = e.mul(_QUARTER, spread)
    pair = ((0, 1), (1, 2))  # where h_j h_i stands among the pairs
    a = []
    for i in range(2):
        terms = [_mean(slope, mean[..., pair[i][j]], most[..., pair[i][j]]) for j, slope in enumerate((by_x, by_y))]
        a.append(e.div(e.add(*terms), weight))
    shifted = e.sum(e.mul(at.jacobian, stacked(a)[..., None, :]), -1)
    doubled = (_ONE, two, _ONE)
    b = []
    for k in range(2):
        total = exact(np.zeros(weight.shape))
        for p in range(3):
            curve = curves[..., int(_THIRD[k, p])]
            held = _mean(curve, mean[..., p], most[..., p])
            lost = exact(e.mul(e.mul(exact(curve.mag), e.sub(ratio, _ONE)), most[..., p]).hi)
            held = e.add(held, IntervalArray(-lost.lo, lost.hi))
            total = e.add(total, e.mul(doubled[p], held))
        b.append(e.mul(_HALF, total))
    return e.add(shifted, stacked(b))


def _mean(coefficient: IntervalArray, mean: IntervalArray, most: IntervalArray) -> IntervalArray:
    """Of a coefficient that varies times a product with a mean, whose absolute value has a mean of at most `most`."""
    e = ENGINE
    loose = e.mul(exact(coefficient.rad), exact(most.hi)).hi
    return e.add(e.mul(exact(coefficient.mid), mean), IntervalArray(-loose, loose))
