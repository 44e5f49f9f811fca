"""Residuals in pixels and their derivatives by twelve small motions of E and F."""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.hand_eye_study import HandEyeFrames, HandEyeStudy
from cpcal.robot import quaternion_from_rotation_vector, rotation_matrix

PARAMETERS = 12  # rotation vector of E (rad, camera frame), its translation, then those of F (frame of its values)


class PixelModel:
    """The residuals (2 N,) of frames, first all along u and then all along v; what the study alone decides is kept."""

    def __init__(self, study: HandEyeStudy) -> None:
        self.study, self.rays = study, study.rays
        turn, shift = study.motions
        self._turn, self._shift = turn[study.image], shift[study.image]
        self.size = PARAMETERS

    def __call__(self, frames: HandEyeFrames) -> Floats:
        """(2 N,) px; infinite where a point is not in front of the camera."""
        x = self._in_camera(frames)[0]
        camera = self.study.camera
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = camera.center + camera.focal * x[:, :2] / x[:, 2:]
        return np.where(x[:, 2:] > 0.0, seen - self.rays, np.inf).T.ravel()

    def _in_camera(self, frames: HandEyeFrames) -> tuple[Floats, Floats, Floats]:
        turned = self.study.points @ frames.f_rotation.T
        moved = np.einsum("nij,nj->ni", self._turn, turned + frames.f_translation) + self._shift
        on = moved @ frames.e_rotation.T
        return on + frames.e_translation, on, turned

    def moved(self, frames: HandEyeFrames, step: Floats) -> HandEyeFrames:
        return moved(frames, step)

    def reach(self, frames: HandEyeFrames) -> Floats:
        """A turn of 1 rad, and the way that it moves a point: (12,)."""
        way = float(np.linalg.norm(frames.in_camera(self.study), axis=1).mean())
        return np.tile(np.repeat([1.0, way], 3), 2)

    def room(self, frames: HandEyeFrames) -> tuple[Floats, Floats]:
        """No step is too far."""
        return np.full(PARAMETERS, -np.inf), np.full(PARAMETERS, np.inf)

    def jacobian(self, frames: HandEyeFrames) -> Floats:
        """(2 N, 12) of the residuals by the motions of `moved`."""
        _, on, turned = self._in_camera(frames)
        of_f = frames.e_rotation @ self._turn  # (N, 3, 3)
        by = np.concatenate([-cross(on), np.broadcast_to(np.eye(3), of_f.shape), -of_f @ cross(turned), of_f], axis=2)
        return self.of_points(frames, by)

    def of_points(self, frames: HandEyeFrames, by: Floats) -> Floats:
        """(2 N, K) of the residuals, from derivatives (N, 3, K) of the points in the camera frame."""
        x = self._in_camera(frames)[0]
        focal, depth = self.study.camera.focal, x[:, 2]
        rows = [focal[a] * (by[:, a] - (x[:, a] / depth)[:, None] * by[:, 2]) / depth[:, None] for a in (0, 1)]
        return np.concatenate(rows)


def cross(vectors: Floats) -> Floats:
    """[v]x (N, 3, 3)."""
    x, y, z = vectors.T
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], axis=1)


def moved(frames: HandEyeFrames, step: Floats) -> HandEyeFrames:
    """Frames turned and moved by a step (12,)."""

    def turned(matrix: Floats, vector: Floats) -> Floats:
        return np.asarray(rotation_matrix(quaternion_from_rotation_vector(vector)) @ matrix)

    return HandEyeFrames(
        turned(frames.e_rotation, step[:3]),
        frames.e_translation + step[3:6],
        turned(frames.f_rotation, step[6:9]),
        frames.f_translation + step[9:],
    )
