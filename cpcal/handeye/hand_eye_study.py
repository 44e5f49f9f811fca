"""A hand-eye study: poses of a robot's hand, and what a camera saw of a target in each.

    x_ij = E H_i F p_j          point j of image i in the camera frame, mm

| setup | E | H_i | F |
| --- | --- | --- | --- |
| eye-in-hand | hand in the camera frame | base in the hand frame, the inverse of the stated pose | target in the base |
| eye-to-hand | base in the camera frame | hand in the base frame, the stated pose | target in the hand |

"A in the B frame" is the motion that maps coordinates of A to those of B.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Value, frozen_array
from cpcal.robot import Pose, rotation_matrix
from cpcal.vision.camera import Camera

Setup = Literal["eye-in-hand", "eye-to-hand"]
SETUPS: tuple[Setup, ...] = ("eye-in-hand", "eye-to-hand")


@dataclass(frozen=True, eq=False, kw_only=True)
class HandEyeStudy(Value):
    """Poses (n) of the hand in the base frame and points (N) that were seen.

    images      their n names
    poses       (n, 3) mm and (n, 4): hand in base
    image       (N,) whole numbers, the image of each point
    names       (N,) of the points
    pixels      (N, 2) as measured, with the lens's distortion
    points      (N, 3) mm in the target frame
    half_width  (N,) px: the true pixel lies that near to the measured one; 0 where it is taken as exact
    pose_half_width  (n, 6) mm and rad: the true pose is position + d, R(1, s) R(q) with |d| and |2 s| at most that on
                each axis of the base frame; 0 where poses are taken as exact

    Raises InputError for arrays that do not belong together.
    """

    setup: Setup
    camera: Camera
    images: tuple[str, ...]
    poses: Pose
    image: Indices
    names: tuple[str, ...]
    pixels: Floats
    points: Floats
    half_width: Floats = field(default_factory=lambda: np.zeros(0))
    pose_half_width: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        count = len(self.image)
        if self.setup not in SETUPS:
            raise InputError([Problem("setup", f"is {self.setup!r}", f"give one of {', '.join(SETUPS)}")])
        object.__setattr__(self, "pixels", frozen_array(self.pixels))
        object.__setattr__(self, "points", frozen_array(self.points))
        width = self.half_width if np.size(self.half_width) else np.zeros(count)
        object.__setattr__(self, "half_width", frozen_array(width))
        wide = self.pose_half_width if np.size(self.pose_half_width) else np.zeros((len(self.images), 6))
        object.__setattr__(self, "pose_half_width", frozen_array(wide))
        places = np.array(self.image, dtype=np.intp)
        places.setflags(write=False)
        object.__setattr__(self, "image", places)
        shapes = (self.pixels.shape, self.points.shape, self.half_width.shape)
        by_image = (self.poses.position.shape, self.pose_half_width.shape)
        n = len(self.images)
        if shapes != ((count, 2), (count, 3), (count,)) or by_image != ((n, 3), (n, 6)):
            raise InputError([Problem("study", "has arrays that do not belong together", "see HandEyeStudy")])
        if count and not 0 <= places.min() <= places.max() < len(self.images):
            raise InputError([Problem("study", "has a point of an image without pose", "name the images by number")])

    @property
    def planar(self) -> bool:
        """Whether all points have Z = 0."""
        return not self.points[:, 2].any()

    @property
    def rays(self) -> Floats:
        """(N, 2) pixels without the lens's distortion: what a pinhole of the same focal lengths and centre shows."""
        return np.asarray(self.camera.center + self.camera.focal * self.camera.normalised(self.pixels))

    @property
    def motions(self) -> tuple[Floats, Floats]:
        """Rotations (n, 3, 3) and translations (n, 3), mm, of H_i, in float64."""
        turn, shift = rotation_matrix(self.poses.quaternion), self.poses.position
        if self.setup == "eye-to-hand":
            return turn, shift
        back = np.swapaxes(turn, -1, -2)
        return back, -np.einsum("nij,nj->ni", back, shift)

    def part(self, chosen: Indices) -> HandEyeStudy:
        """The study of some of the images, in their order."""
        new = np.full(len(self.images), -1)
        new[chosen] = np.arange(len(chosen))
        kept = np.flatnonzero(new[self.image] >= 0)
        return HandEyeStudy(
            setup=self.setup,
            camera=self.camera,
            images=tuple(self.images[k] for k in chosen),
            poses=Pose(self.poses.position[chosen], self.poses.quaternion[chosen]),
            image=new[self.image[kept]],
            names=tuple(self.names[k] for k in kept),
            pixels=self.pixels[kept],
            points=self.points[kept],
            half_width=self.half_width[kept],
            pose_half_width=self.pose_half_width[chosen],
        )


@dataclass(frozen=True, eq=False)
class HandEyeFrames(Value):
    """E and F: rotations (3, 3), translations (3,) mm."""

    e_rotation: Floats
    e_translation: Floats
    f_rotation: Floats
    f_translation: Floats

    def __post_init__(self) -> None:
        for name in ("e_rotation", "e_translation", "f_rotation", "f_translation"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    def in_camera(self, study: HandEyeStudy) -> Floats:
        """x_ij (N, 3), mm."""
        turn, shift = study.motions
        on_target = study.points @ self.f_rotation.T + self.f_translation
        moved = np.einsum("nij,nj->ni", turn[study.image], on_target) + shift[study.image]
        return np.asarray(moved @ self.e_rotation.T + self.e_translation)

    def residuals(self, study: HandEyeStudy) -> Floats:
        """(N, 2) px: where a pinhole shows the points, less the undistorted pixels."""
        x = self.in_camera(study)
        return np.asarray(study.camera.center + study.camera.focal * x[:, :2] / x[:, 2:] - study.rays)
