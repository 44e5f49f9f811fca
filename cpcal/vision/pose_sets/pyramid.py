"""Pixel boxes as viewing pyramids: the planes through the camera's centre that enclose what a box can show.

A pixel is F(x) = center + focal d(x) of the direction x = (X / Z, Y / Z), with d the lens. Directions that count lie in
the field of view, a disc r <= rho. Which of them have F(x) in a box of pixels, for some camera of the set?

The Jacobian of d is symmetric. If no eigenvalue of it is below m > 0 on the disc (or on a box N that holds x and x0),
then |x - x0| <= |d(x) - d(x0)| / m for any x0 of it: that bounds x from the values of d, and Newton's operator narrows
the bounds. The mean value theorem on such a box N makes it tight: with any J near F'(x0) and cameras c + S t,

    J (x - x0)  in  box - F_c(x0) - K t - e - (F'(N) - J) (N - x0),        K = dF/dc(x0) S,

e of second order in the cameras. With Z > 0 each of the four inequalities is a half-space g . (X, Y, Z) + Z k . t <= 0.
Everything is enclosed in interval arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.solver.interval import IntervalArray
from cpcal.vision.camera import Camera
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, inner, stacked
from cpcal.vision.pose_sets.field_of_view import field_of_view
from cpcal.vision.pose_sets.lens_bounds import lens_bounds, lens_over, number_slopes
from cpcal.vision.pose_sets.uncertain import CameraSet

ROUNDS = 3  # of narrowing a box of directions


@dataclass(frozen=True)
class Pyramids:
    """What m pixel boxes can show, of the directions in the camera's field.

    planes  (m, 4, 3), shared (m, 4, k): a point (X, Y, Z), Z > 0, that camera t shows in box i has
            planes[i] @ (X, Y, Z) + Z shared[i] @ t <= 0, in exact arithmetic on these floats; in pixels per unit of
            direction
    rays    (m, 2) directions x0
    lo, hi  (m, 2) bounds of the direction (X / Z, Y / Z)
    """

    planes: Floats
    shared: Floats
    rays: Floats
    lo: Floats
    hi: Floats


def pyramids(cameras: CameraSet, pixels: IntervalArray, rays: Floats | None = None) -> Pyramids:
    """The pyramids of boxes (m, 2) of pixels of dots' centres, about their middles' rays or those that are given.

    Raises InputError for a box that nothing in the field of view is shown in.
    """
    e, field = ENGINE, field_of_view(cameras)
    camera, numbers = cameras.camera, cameras.numbers
    if rays is None:
        rays = camera.normalised(pixels.mid)
    outside = ~(np.hypot(rays[:, 0], rays[:, 1]) <= field.radius)
    _refuse(outside)
    directions = directions_of(cameras, pixels, rays)
    near = camera.focal[:, None] * camera.distortion_jacobian(rays)
    slope = e.mul(numbers[:2][:, None], lens_over(directions, cameras).jacobian)
    x0, own = exact(rays), exact(camera.numbers)
    rest = inner(e.sub(slope, exact(near)), e.sub(directions, x0)[:, None, :])
    by_numbers = number_slopes(x0, own)
    shared = e.dot(by_numbers, exact(cameras.spread)) if cameras.size else exact(np.zeros((len(rays), 2, 0)))
    lost = e.add(exact(rest.mag), _second_order(cameras, by_numbers))
    lost = e.add(lost, e.sum(exact(shared.rad), -1)) if cameras.size else lost
    at = inner(exact(near), x0[:, None, :])
    middle = e.sub(at, e.add(own[2:4], e.mul(own[:2], lens_bounds(x0, own).value)))
    upper = e.add(e.add(exact(pixels.hi), middle), lost).hi
    lower = e.sub(e.add(exact(pixels.lo), middle), lost).lo
    above = np.concatenate([near, -upper[:, :, None]], axis=2)
    below = np.concatenate([-near, lower[:, :, None]], axis=2)
    return Pyramids(
        np.concatenate([above, below], axis=1),
        np.concatenate([shared.mid, -shared.mid], axis=1),
        rays,
        directions.lo,
        directions.hi,
    )


def _second_order(cameras: CameraSet, by_numbers: IntervalArray) -> IntervalArray:
    """(m, 2): what F_c+St(x0) - F_c(x0) - K t is at most: the change of the focal length times that of the lens."""
    if not cameras.size:
        return exact(np.zeros(by_numbers.shape[:2]))
    bent = cameras.most(ENGINE.dot(by_numbers[..., 4:], exact(cameras.spread[4:])))  # by the centre's focal length
    return ENGINE.mul(ENGINE.div(exact(cameras.reach[:2]), exact(cameras.camera.focal)), bent)


def directions_of(cameras: CameraSet, pixels: IntervalArray, rays: Floats) -> IntervalArray:
    """Boxes (m, 2) of the directions in the field that some camera shows in boxes of pixels, about rays in it."""
    e, numbers, x0 = ENGINE, cameras.numbers, exact(rays)
    away = e.sub(e.div(e.sub(pixels, numbers[2:4]), numbers[:2]), lens_over(x0, cameras).value)
    size = e.sqrt(e.sum(e.sqr(exact(away.mag)), -1))
    least: IntervalArray = exact(np.full(len(rays), field_of_view(cameras).least_slope))
    for _ in range(ROUNDS):
        radius = e.div(size, least).hi
        box = IntervalArray.around(rays, radius[:, None])
        here = lens_over(box, cameras).least_slope.lo
        least = exact(np.maximum(least.lo, here))
    box = IntervalArray.around(rays, e.div(size, least).hi[:, None])
    slopes = lens_over(box, cameras).jacobian
    back = exact(_inverse(slopes.mid))
    rest = e.sub(exact(np.eye(2)), stacked([inner(back, slopes[:, None, :, k]) for k in range(2)]))
    step = e.add(inner(back, away[:, None, :]), inner(rest, e.sub(box, x0)[:, None, :]))
    return box.intersect(e.add(x0, step))


def _inverse(matrices: Floats) -> Floats:
    """Of (m, 2, 2); any matrices are allowed where it is used."""
    a, b, c, d = (matrices[:, i, j] for i in (0, 1) for j in (0, 1))
    inverse = np.stack([np.stack([d, -b], axis=1), np.stack([-c, a], axis=1)], axis=1)
    return np.asarray(inverse / (a * d - b * c)[:, None, None])


def pixels_of(camera: Camera, x: IntervalArray) -> IntervalArray:
    """Enclosures (..., 2) of the pixels of directions (..., 2), as `Camera.pixels` defines them."""
    numbers = exact(camera.numbers)
    return ENGINE.add(numbers[2:4], ENGINE.mul(numbers[:2], lens_bounds(x, numbers).value))


def _refuse(wrong: npt.NDArray[np.bool_]) -> None:
    if wrong.any():
        what = "shows nothing of the camera's field of view"
        remedy = "give pixels inside the image of this camera"
        raise InputError([Problem(f"pixel box {k}", what, remedy) for k in np.flatnonzero(wrong)])
