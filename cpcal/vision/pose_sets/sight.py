"""What an image and what is known beforehand say of a pose: pyramids of the dots' centres, about a box of poses or any.

If the boxes of pixels hold the centres of the dots' images, the images of their centres lie in boxes that are moved by
the bias (`bias`), which depends on the pose: it is bounded over all poses at first, and then over a box of poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.interval import IntervalArray
from cpcal.vision.pose_sets.bias import center_bias
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, inner, rotation, times, transposed, turned_by
from cpcal.vision.pose_sets.field_of_view import BIAS_ROUNDS, NEAREST, field_of_view
from cpcal.vision.pose_sets.pixel_boxes import PixelBoxes
from cpcal.vision.pose_sets.pose_box import PoseBox
from cpcal.vision.pose_sets.pose_frames import Frames
from cpcal.vision.pose_sets.pyramid import Pyramids, directions_of, pyramids
from cpcal.vision.pose_sets.uncertain import CameraSet, TargetSet

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
