"""Residuals of a plate's dots in one camera of a rig, in standard deviations, and minus their derivatives.

The plate's pose P is in the first camera's frame, C is that frame seen by the camera, and Q = C P. Steps are (dp, w) of
P with R(w) R_P, and (dt, v) of C with R(v) R_C. So Q moves by R_C dp + dt + v x (R_C p), and turns by R_C w + v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot import Pose
from cpcal.vision.dot_model import predict
from cpcal.vision.pose_fit import Pixels
from cpcal.vision.rig.rig import EACH, Rig, SeenPlate
from cpcal.vision.target import Target


@dataclass(frozen=True, eq=False)
class ViewEquations:
    """Of one camera at one moment, m dots: residuals (2 m,); minus their derivatives by the plate's pose (2 m, 6), by
    the camera's numbers (2 m, 15), by the relative size of the plate (2 m, 1), by each dot's place (m, 2, 2)."""

    residuals: Floats
    by_plate: Floats
    by_camera: Floats
    by_scale: Floats
    by_dots: Floats

    @classmethod
    def of(cls, rig: Rig, seen: SeenPlate, plate: Pose, target: Target) -> ViewEquations:
        camera = rig.cameras[seen.camera]
        dots = target.dots[seen.numbers]
        factors: Floats = np.asarray(np.linalg.cholesky(seen.covariance), dtype=np.float64)
        model = Pixels(dots, seen.centers, factors, target.radius, camera)
        own = Pose(rig.position[seen.camera], rig.quaternion[seen.camera])
        placed = rig.seen_by(seen.camera, plate)
        found = predict(dots, target.radius, camera, placed, by_camera=True, by_dots=True)
        by_pose = model.whitened(found.by_pose).reshape(-1, 6)
        turn, arm = own.rotation, own.rotation @ plate.position
        plate_step, camera_step = np.zeros((6, 6)), np.eye(6)
        plate_step[:3, :3] = plate_step[3:, 3:] = turn
        camera_step[:3, 3:] = np.array(
            [[0.0, arm[2], -arm[1]], [-arm[2], 0.0, arm[0]], [arm[1], -arm[0], 0.0]]
        )  # v x arm
        by_camera = np.empty((len(by_pose), EACH))
        by_camera[:, :6] = by_pose @ camera_step
        assert found.by_camera is not None
        assert found.by_dots is not None
        by_camera[:, 6:] = model.whitened(found.by_camera).reshape(len(by_pose), -1)
        outward = dots @ placed.rotation[:, :2].T
        by_scale = model.whitened(found.by_pose[..., :3] @ outward[..., None]).reshape(-1, 1)
        residuals = model.whitened((seen.centers - found.centers)[..., None]).ravel()
        return cls(residuals, by_pose @ plate_step, by_camera, by_scale, model.whitened(found.by_dots))
