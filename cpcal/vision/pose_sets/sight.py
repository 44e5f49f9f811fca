"""What an image and what is known beforehand say of a pose: pyramids of the dots' centres, about a box of poses or any.

If the boxes of pixels hold the centres of the dots' images, the images of their centres lie in boxes that are moved by
the bias (`bias`), which depends on the pose: it is bounded over all poses at first, and then over a box of poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats, Indices, frozen_array
from cpcal.solver.interval import IntervalArray
from cpcal.vision.camera import Camera
from cpcal.vision.pose_sets.enclosed import (
    ENGINE,
    Frames,
    PoseBox,
    exact,
    inner,
    rotation,
    stacked,
    times,
    transposed,
    turned_by,
)
from cpcal.vision.pose_sets.uncertain import (
    BIAS_ROUNDS,
    NEAREST,
    CameraSet,
    TargetSet,
    center_bias,
    field_of_view,
    lens_bounds,
    lens_over,
    number_slopes,
)

# ------------------------------------------------------------------------------------------------------------------
# Where the dots of a target are in an image: to within stated boxes of pixels.


@dataclass(frozen=True, eq=False)
class PixelBoxes:
    """Where dots of a target are in an image.

    numbers  (m,) of the dots in the target, each once
    lo, hi   (m, 2) pixels: the projection of dot `numbers[i]` is stated to lie in lo[i] <= pixel <= hi[i]
    of_images  then it is the centre (the centroid of the area) of the dot's image that lies there, as it is measured:
             by how much it differs from the projection is bounded by proof

    Raises InputError when the arrays make no boxes.
    """

    numbers: Indices
    lo: Floats
    hi: Floats
    of_images: bool = False

    def __post_init__(self) -> None:
        numbers = np.array(self.numbers, dtype=np.intp)
        numbers.setflags(write=False)
        object.__setattr__(self, "numbers", numbers)
        object.__setattr__(self, "lo", frozen_array(self.lo))
        object.__setattr__(self, "hi", frozen_array(self.hi))
        shape = (len(numbers), 2) if numbers.ndim == 1 else None
        if shape is None or self.lo.shape != shape or self.hi.shape != shape:
            what = f"have shapes {numbers.shape}, {self.lo.shape} and {self.hi.shape}"
            raise InputError([Problem("pixel boxes", what, "give numbers (m,), lo (m, 2) and hi (m, 2)")])
        good = (self.lo <= self.hi).all(axis=1) & np.isfinite(self.lo).all(axis=1) & np.isfinite(self.hi).all(axis=1)
        problems = [
            Problem(f"pixel box {k}", "has no points, or infinitely many", "give finite lo <= hi")
            for k in np.flatnonzero(~good)
        ]
        if len(np.unique(numbers)) < len(numbers):
            problems.append(Problem("pixel boxes", "name a dot twice", "give one box for each dot"))
        if problems:
            raise InputError(problems)

    @classmethod
    def around(
        cls, numbers: npt.ArrayLike, centers: npt.ArrayLike, half_width: npt.ArrayLike, *, of_images: bool = False
    ) -> PixelBoxes:
        """`center +- half_width`, pixels: centers (m, 2), half_width a number, (2,), (m, 1) or (m, 2), >= 0."""
        middle = np.asarray(centers, dtype=np.float64)
        try:
            radius = np.broadcast_to(np.asarray(half_width, dtype=np.float64), middle.shape)
        except ValueError:
            what = f"is {np.shape(half_width)} for centres {middle.shape}"
            raise InputError([Problem("half_width", what, "give one number, or one for each coordinate")]) from None
        if not bool((radius >= 0.0).all()):
            raise InputError([Problem("half_width", "is negative or NaN", "give pixels >= 0")])
        boxes = IntervalArray.around(middle, radius)
        return cls(np.asarray(numbers, dtype=np.intp), boxes.lo, boxes.hi, of_images)

    def part(self, chosen: Indices) -> PixelBoxes:
        """Some of them."""
        return PixelBoxes(self.numbers[chosen], self.lo[chosen], self.hi[chosen], self.of_images)

    def __len__(self) -> int:
        return len(self.numbers)


# ------------------------------------------------------------------------------------------------------------------
# Pixel boxes as viewing pyramids: the planes through the camera's centre that enclose what a box can show.
#
# A pixel is F(x) = center + focal d(x) of the direction x = (X / Z, Y / Z), with d the lens. Directions that count
# lie in
# the field of view, a disc r <= rho. Which of them have F(x) in a box of pixels, for some camera of the set?
#
# The Jacobian of d is symmetric. If no eigenvalue of it is below m > 0 on the disc (or on a box N that holds x and x0),
# then |x - x0| <= |d(x) - d(x0)| / m for any x0 of it: that bounds x from the values of d, and Newton's operator
# narrows
# the bounds. The mean value theorem on such a box N makes it tight: with any J near F'(x0) and cameras c + S t,
#
#     J (x - x0)  in  box - F_c(x0) - K t - e - (F'(N) - J) (N - x0),        K = dF/dc(x0) S,
#
# e of second order in the cameras. With Z > 0 each of the four inequalities is a half-space g . (X, Y, Z) + Z k . t
# <= 0.
# Everything is enclosed in interval arithmetic.

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


TURNS_BACK = "the lens may turn back within the image of a dot"


@dataclass(frozen=True)
class Sight:
    """The m dots of `boxes`, the sets of camera and target, and the frames between which the pose stands."""

    boxes: PixelBoxes
    targets: TargetSet
    cameras: CameraSet
    frames: Frames

    def part(self, chosen: Indices) -> Sight:
        """Of some of the dots."""
        return Sight(self.boxes.part(chosen), self.targets, self.cameras, self.frames)

    def __len__(self) -> int:
        return len(self.boxes)

    @property
    def dots(self) -> Floats:
        """(m, 2) mm on the plate, their stated places."""
        return np.asarray(self.targets.target.dots[self.boxes.numbers])

    @property
    def widths(self) -> Floats:
        """(m, 3) mm"""
        return np.asarray(self.targets.half_widths[self.boxes.numbers])

    @property
    def nearest(self) -> float:
        """mm"""
        return NEAREST * self.targets.target.radius

    @property
    def points(self) -> IntervalArray:
        """(m, 3) mm in the mobile frame, dots off their places included."""
        at = np.concatenate([self.dots, np.zeros((len(self), 1))], axis=1)
        return self.frames.in_mobile(IntervalArray.around(at, self.widths))

    def anywhere(self) -> Pyramids | str:
        """Pyramids that hold for every pose; a text says why there are none."""
        pixels = IntervalArray(self.boxes.lo, self.boxes.hi)
        if not self.boxes.of_images:
            return pyramids(self.cameras, pixels)
        camera, field = self.cameras.camera, field_of_view(self.cameras)
        rays = camera.normalised(pixels.mid)
        if not (np.hypot(rays[:, 0], rays[:, 1]) <= field.radius).all():
            return pyramids(self.cameras, pixels)  # which says so
        any_normal = IntervalArray(np.full((len(self), 3), -1.0), np.ones((len(self), 3)))
        depth = IntervalArray(np.zeros(len(self)), np.full(len(self), 1.0 / NEAREST))
        bias = IntervalArray.around(np.zeros(pixels.shape), np.full(pixels.shape, field.bias))
        for _ in range(BIAS_ROUNDS):
            x = directions_of(self.cameras, ENGINE.sub(pixels, bias), rays)
            found = center_bias(x, depth, any_normal, self.cameras)
            if found is None:
                return TURNS_BACK
            bias = found.intersect(bias)
        return pyramids(self.cameras, ENGINE.sub(pixels, bias), rays)

    def about(self, box: PoseBox) -> Pyramids | str:
        """Pyramids that hold for the poses of a box."""
        if not self.boxes.of_images:
            return pyramids(self.cameras, IntervalArray(self.boxes.lo, self.boxes.hi))
        points, normal = self.placed(box)
        depth = points[:, 2].intersect(IntervalArray(np.full(len(self), self.nearest), np.full(len(self), np.inf)))
        if depth.empty.any():
            return "a dot is too near to the camera's plane"
        x = ENGINE.div(points[:, :2], depth[:, None])
        tau = ENGINE.div(exact(self.targets.target.radius), depth)
        everywhere = IntervalArray(*(np.tile(side, (len(self), 1)) for side in (normal.lo, normal.hi)))
        bias = center_bias(x, tau, everywhere, self.cameras)
        if bias is None:
            return TURNS_BACK
        return pyramids(self.cameras, ENGINE.sub(IntervalArray(self.boxes.lo, self.boxes.hi), bias))

    def with_scale(self, box: PoseBox) -> PoseBox:
        """The poses of a box if the plate may be 1 + tau times as large: one that is so much farther away, and turned
        alike, looks the same. So the target's origin C'c + P + R p in the base frame moves by tau times itself."""
        if not self.targets.scale:
            return box
        e, frames = ENGINE, self.frames
        arm = exact(frames.target.position)
        origin = e.add(exact(box.center.position), times(rotation(box.center.quaternion), arm))
        origin = e.add(origin, times(transposed(rotation(frames.camera.quaternion)), exact(frames.camera.position)))
        turned = e.mul(e.sum(exact(2.0 * box.half_turn.mag), 0), e.sum(exact(arm.mag), 0))  # at least |R p - R0 p|
        far = e.add(e.add(exact(origin.mag), exact(box.position.mag)), turned)
        moved = IntervalArray.around(np.zeros(3), e.mul(exact(self.targets.scale), far).hi)
        return PoseBox(box.center, e.add(box.position, moved), box.half_turn)

    def placed(self, box: PoseBox) -> tuple[IntervalArray, IntervalArray]:
        """Dots (m, 3) mm and the plate's normal (3,) in the camera frame, for the poses of a box."""
        e, frames = ENGINE, self.frames
        camera = rotation(frames.camera.quaternion)
        turned = e.dot(turned_by(box.half_turn), rotation(box.center.quaternion))
        origin = e.add(exact(box.center.position), box.position)
        points = e.add(origin, times(turned, self.points))
        seen = e.add(exact(frames.camera.position), times(camera, points))
        return seen, times(e.dot(camera, e.dot(turned, rotation(frames.target.quaternion))), exact([0.0, 0.0, 1.0]))


def plane_sizes(planes: Floats) -> Floats:
    """(...,) upper bounds of the lengths of vectors (..., 3)."""
    return ENGINE.sqrt(inner(exact(planes), exact(planes))).hi
