"""Pixel boxes as viewing pyramids: the planes through the camera's centre that enclose what a box can show.

A pixel is F(x) = center + focal d(x) of the direction x = (X / Z, Y / Z), with d the lens distortion. Which x have
F(x) in a box of pixels? By the mean value theorem, on any box N of directions with midpoint c,

    F(x) in F(c) + F'(N) (x - c)                for all x in N,

so that, first, cells of the field whose F misses the pixel box are left out, secondly Newton's interval operator
narrows what is left, C (F(x) - F(c)) being in C F'(N) (x - c), and at last, for any real matrix J in place of F'(N),

    J x  in  box - F(c) + J c - (F'(N) - J) (N - c),

which is tight to first order: the last term is of second order in the size of the pixel box. With Z > 0 each of the
four inequalities is a half-space g . (X, Y, Z) <= 0. Everything is enclosed in interval arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.solver.interval import IntervalArray
from cpcal.vision.camera import BROWN, Camera
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, inner, stacked

_MARGIN = 0.1  # of the field beyond the image's border, as a share of the distance from the axis
_RAYS, _STEPS = 97, 400
_WIDEST = 4.0  # tangent of the largest angle to the axis
_TURNS = 0.01  # determinant of the distortion's derivative, 1 on the axis, at which a lens is said to turn back
_CELLS = 32  # of the field, each way
_ROUNDS = 12  # of Newton's operator at most
_PAYS = 0.9  # it goes on while some box of directions shrinks below this share


@dataclass(frozen=True)
class Pyramids:
    """What m pixel boxes can show, of the directions in the camera's field.

    planes  (m, 4, 3): every point (X, Y, Z), Z > 0, that the camera shows in box i has planes[i] @ (X, Y, Z) <= 0, in
            exact arithmetic on these floats; rows are in pixels per unit of direction
    lo, hi  (m, 2) bounds of its direction (X / Z, Y / Z)
    """

    planes: Floats
    lo: Floats
    hi: Floats


@lru_cache(maxsize=8)
def field_of_view(camera: Camera) -> IntervalArray:
    """The directions that count, as cells (c, 2): what the image shows and a tenth more on every side.

    Along each ray from the axis the field ends where the image does, or where the lens model turns back (its
    polynomial is a model of the lens up to there): what is beyond is not taken for a direction that could be seen.
    """
    angle, radius = _rim(camera)
    rim = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cuts = np.linspace(rim.min(axis=0), rim.max(axis=0), _CELLS + 1)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(_CELLS), np.arange(_CELLS), indexing="ij"))
    lo, hi = np.stack([cuts[i, 0], cuts[j, 1]], axis=1), np.stack([cuts[i + 1, 0], cuts[j + 1, 1]], axis=1)
    middle = 0.5 * (lo + hi)
    reach = np.interp(np.arctan2(middle[:, 1], middle[:, 0]), angle, radius)
    within = np.linalg.norm(middle, axis=1) <= reach + np.linalg.norm(hi - middle, axis=1)
    return IntervalArray(lo[within], hi[within])


def _rim(camera: Camera) -> tuple[Floats, Floats]:
    """Angles from -pi to pi, and how far the field reaches there from the axis: radii in normalised coordinates."""
    angle = np.linspace(-np.pi, np.pi, _RAYS)
    radius = np.linspace(0.0, _WIDEST, _STEPS)
    rays = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    onward = np.linalg.det(camera.distortion_jacobian(rays)) > _TURNS
    pixels = camera.pixels(rays)
    shown = ((pixels >= -0.5) & (pixels <= [camera.width - 0.5, camera.height - 0.5])).all(axis=2)
    last = np.logical_and.accumulate(onward & shown, axis=0).sum(axis=0)
    return angle, (1.0 + _MARGIN) * radius[np.minimum(last, _STEPS - 1)]


def pyramids(camera: Camera, lo: Floats, hi: Floats) -> Pyramids:
    """The pyramids of pixel boxes lo, hi (m, 2).

    Raises InputError for a box that nothing in the field of view is shown in, and for a lens that is not enclosed yet.
    """
    if camera.model != BROWN:
        what = f"has a lens of the model {camera.model}"
        raise InputError([Problem("camera", what, f"pose sets are proved for the model {BROWN}: calibrate with it")])
    pixels = IntervalArray(lo, hi)
    directions = _narrowed(camera, pixels, _cells(camera, pixels))
    center = directions.mid
    slope = pixel_slopes(camera, directions)
    near = camera.focal[:, None] * camera.distortion_jacobian(center)
    e = ENGINE
    rest = inner(e.sub(slope, exact(near)), e.sub(directions, exact(center))[:, None, :])
    at = inner(exact(near), exact(center)[:, None, :])
    bound = e.sub(e.add(e.sub(pixels, pixels_of(camera, exact(center))), at), rest)
    above = np.concatenate([near, -bound.hi[:, :, None]], axis=2)
    below = np.concatenate([-near, bound.lo[:, :, None]], axis=2)
    return Pyramids(np.concatenate([above, below], axis=1), directions.lo, directions.hi)


def pixels_of(camera: Camera, x: IntervalArray) -> IntervalArray:
    """Enclosures (..., 2) of the pixels of directions (..., 2), as `Camera.pixels` defines them."""
    e = ENGINE
    k1, k2, p1, p2, k3 = (exact(float(k)) for k in camera.distortion)
    u, v = x[..., 0], x[..., 1]
    uu, vv, uv = e.sqr(u), e.sqr(v), e.mul(u, v)
    r2 = e.add(uu, vv)
    radial = e.add(exact(1.0), e.mul(r2, e.add(k1, e.mul(r2, e.add(k2, e.mul(r2, k3))))))
    two = exact(2.0)
    du = e.add(e.add(e.mul(u, radial), e.mul(e.mul(two, p1), uv)), e.mul(p2, e.add(r2, e.mul(two, uu))))
    dv = e.add(e.add(e.mul(v, radial), e.mul(e.mul(two, p2), uv)), e.mul(p1, e.add(r2, e.mul(two, vv))))
    return e.add(exact(camera.center), e.mul(exact(camera.focal), stacked([du, dv])))


def pixel_slopes(camera: Camera, x: IntervalArray) -> IntervalArray:
    """Enclosures (..., 2, 2) of the derivatives of pixels by direction, at all points of boxes (..., 2)."""
    e = ENGINE
    k1, k2, p1, p2, k3 = (exact(float(k)) for k in camera.distortion)
    u, v = x[..., 0], x[..., 1]
    uu, vv, uv = e.sqr(u), e.sqr(v), e.mul(u, v)
    r2 = e.add(uu, vv)
    two = exact(2.0)
    radial = e.add(exact(1.0), e.mul(r2, e.add(k1, e.mul(r2, e.add(k2, e.mul(r2, k3))))))
    slope = e.mul(two, e.add(k1, e.mul(r2, e.add(e.mul(two, k2), e.mul(r2, e.mul(exact(3.0), k3))))))
    p1u, p1v, p2u, p2v = e.mul(p1, u), e.mul(p1, v), e.mul(p2, u), e.mul(p2, v)
    mixed = e.add(e.mul(slope, uv), e.mul(two, e.add(p1u, p2v)))
    along = e.add(e.add(radial, e.mul(slope, uu)), e.mul(two, e.add(p1v, e.mul(exact(3.0), p2u))))
    down = e.add(e.add(radial, e.mul(slope, vv)), e.mul(two, e.add(p2u, e.mul(exact(3.0), p1v))))
    jacobian = stacked([stacked([along, mixed]), stacked([mixed, down])], axis=-2)
    return e.mul(exact(camera.focal[:, None]), jacobian)


def _cells(camera: Camera, pixels: IntervalArray) -> IntervalArray:
    """The hull (m, 2) of those cells of the field that may be shown in a pixel box."""
    cells, shown = field_of_view(camera), _shown(camera)
    below, above = shown.lo <= pixels.hi[:, None, :], shown.hi >= pixels.lo[:, None, :]
    meets = np.asarray((below & above).all(axis=2))
    _refuse(np.logical_not(meets.any(axis=1)))
    inside = meets[:, :, None]
    lo, hi = np.where(inside, cells.lo, np.inf), np.where(inside, cells.hi, -np.inf)
    return IntervalArray(lo.min(axis=1), hi.max(axis=1))


@lru_cache(maxsize=8)
def _shown(camera: Camera) -> IntervalArray:
    """Enclosures (c, 2) of the pixels at which the cells of the field are shown."""
    cells, e = field_of_view(camera), ENGINE
    center = exact(cells.mid)
    away = e.sub(cells, center)[:, None, :]
    return e.add(pixels_of(camera, center), inner(pixel_slopes(camera, cells), away))


def _narrowed(camera: Camera, pixels: IntervalArray, x: IntervalArray) -> IntervalArray:
    """Newton's operator c + C (box - F(c)) + (I - C F'(N)) (N - c), as long as it pays."""
    e = ENGINE
    for _ in range(_ROUNDS):
        center, slope = x.mid, pixel_slopes(camera, x)
        inverse = exact(_inverse(slope.mid))
        misfit = e.sub(pixels, pixels_of(camera, exact(center)))
        product = stacked([inner(inverse, _column(slope, k)) for k in range(2)])
        rest = e.sub(exact(np.eye(2)), product)
        step = e.add(inner(inverse, misfit[:, None, :]), inner(rest, e.sub(x, exact(center))[:, None, :]))
        new = x.intersect(e.add(exact(center), step))
        _refuse(np.asarray(new.empty.any(axis=1)))
        paid = bool((new.hi - new.lo < _PAYS * (x.hi - x.lo)).any())
        x = new
        if not paid:
            break
    return x


def _column(matrices: IntervalArray, k: int) -> IntervalArray:
    """Column k of matrices (m, 2, 2), as rows (m, 1, 2) to be multiplied with."""
    return matrices[:, None, :, k]


def _inverse(matrices: Floats) -> Floats:
    """Of (m, 2, 2); any matrix is allowed in Newton's operator, so a singular one is replaced by zero."""
    a, b, c, d = (matrices[:, i, j] for i in (0, 1) for j in (0, 1))
    determinant = a * d - b * c
    safe = np.where(determinant == 0.0, np.inf, determinant)
    return np.stack([np.stack([d, -b], axis=1), np.stack([-c, a], axis=1)], axis=1) / safe[:, None, None]


def _refuse(wrong: npt.NDArray[np.bool_]) -> None:
    if wrong.any():
        what = "shows nothing of the camera's field of view"
        remedy = "give pixels inside the image of this camera"
        raise InputError([Problem(f"pixel box {k}", what, remedy) for k in np.flatnonzero(wrong)])
