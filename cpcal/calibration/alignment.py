"""Calibrated joint centres laid on those of the drawing: where the drawing's frame is, and how well that is known.

A robot has no other base frame than its joints, and the drawing says where these are in it. So the frame is that of
the rigid motion that brings the calibrated centres nearest to the drawing's (least squares), and two uncertainties
belong to it. The centres are known to within the calibration's errors: that is how well the frame is known that the
robot's own joints define. And the joints are not where the drawing has them: how far off is told by what the motion
leaves over, with few degrees of freedom; that is how well the drawing's frame can be known, whatever is measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.frames import cross_matrix
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import about
from cpcal.common.values import Floats
from cpcal.robot import Pose, Robot, quaternion_from_matrix, transformed
from cpcal.robot.kinematics import nearest_rotation


@dataclass(frozen=True)
class FittedFrame:
    """The frame in which the centres were measured, seen in the drawing's: x_drawing = P + R(q) x_measured, P in mm.

    sigma            (6,) standard deviations of position (mm) and rotation vector (rad, drawing's frame), of the frame
                     that the joints define
    drawing_sigma    (6,) of the drawing's frame: with the drawing's own errors, estimated from the residuals
    drawing_error    mm: how far a coordinate of a joint centre is off its drawing (standard deviation)
    coverage_factor  k for 95 % with so few degrees of freedom, 3 n - 6 (Student)
    """

    position: tuple[float, ...]
    quaternion: tuple[float, ...]
    sigma: tuple[float, ...]
    drawing_sigma: tuple[float, ...]
    drawing_error: float
    coverage_factor: float

    def sentence(self, name: str) -> str:
        own, drawn = max(self.sigma[:3]), max(self.drawing_sigma[:3])
        return (
            f"{name}: the calibrated joint centres are {self.drawing_error:.2g} mm a coordinate off the "
            f"drawing's; the frame that they define is known to U = {2.0 * own:.2g} mm (k = 2), the drawing's to "
            f"{self.coverage_factor * drawn:.2g} mm (k = {self.coverage_factor:.2g}, 95 %)."
        )


def nearest_motion(measured: Floats, drawing: Floats) -> Pose:
    """The rigid motion that brings centres (n, 3) mm nearest to the drawing's.

    Raises InputError for fewer than three centres, and for centres on a line.
    """
    count, middle, drawn = len(measured), measured.mean(axis=0), drawing.mean(axis=0)
    sizes = np.linalg.svd(drawing - drawn, compute_uv=False) if count > 2 else np.zeros(3)
    if sizes[1] < 1e-9 * sizes[0] or sizes[0] == 0.0:
        what = f"are {count} on a line, or fewer than three: no frame follows from them"
        raise InputError([Problem("joint centres", what, "give three that are not on a line")])
    rotation = nearest_rotation((drawing - drawn).T @ (measured - middle))
    return Pose(drawn - rotation @ middle, quaternion_from_matrix(rotation))


def fitted_frame(measured: Floats, drawing: Floats, covariance: Floats, shared: Floats) -> FittedFrame:
    """Of centres (n, 3) mm with their covariance (3 n, 3 n) mm^2, centre by centre, and the drawing's.

    shared  (6,) standard deviations of an error of the frame that comes on top. Raises InputError as `nearest_motion`.
    """
    from scipy import special  # here: it takes a third of a second to load

    motion, count = nearest_motion(measured, drawing), len(measured)
    turned = measured @ motion.rotation.T
    residual = drawing - turned - motion.position
    columns = np.concatenate([np.tile(np.eye(3), (count, 1)), -cross_matrix(turned).reshape(-1, 3)], axis=1)
    back = np.linalg.pinv(columns) @ np.kron(np.eye(count), motion.rotation)
    own = back @ covariance @ back.T + np.diag(shared**2)
    freedom = 3 * count - 6
    error = float(np.sqrt(np.sum(residual**2) / freedom))
    of_drawing = error**2 * np.linalg.inv(columns.T @ columns) + own
    arrays = motion.position, motion.quaternion, np.sqrt(np.diagonal(own)), np.sqrt(np.diagonal(of_drawing))
    position, quaternion, sigma, drawing_sigma = (tuple(array.tolist()) for array in arrays)
    k = float(special.stdtrit(freedom, 0.975))
    return FittedFrame(position, quaternion, sigma, drawing_sigma, error, k)


# Parameters laid on the drawing, so that those of two fits can be compared: base and mobile centres each by the rigid
# motion that brings them nearest to the drawing's.

_STEP = 1e-3  # mm, of the difference quotients; the map is smooth over millimetres


def on_drawing(parameters: Floats, drawing: Robot) -> Floats:
    """Parameters (n, 7), mm, in the drawing's frames. Raises InputError as `nearest_motion` does."""
    parts = [
        transformed(nearest_motion(parameters[:, columns], centres), parameters[:, columns])
        for columns, centres in ((slice(0, 3), drawing.base), (slice(3, 6), drawing.mobile))
    ]
    return np.concatenate([*parts, parameters[:, 6:]], axis=1)


def on_drawing_errors(parameters: Floats, covariance: Floats, drawing: Robot) -> Floats:
    """(n, 7) mm: standard deviations of `on_drawing`, to first order, from the covariance (7 n, 7 n), leg by leg."""
    size = parameters.size
    steps = _STEP * np.eye(size).reshape(size, *parameters.shape)
    ahead, back = (
        np.stack([on_drawing(parameters + sign * step, drawing).ravel() for step in steps]) for sign in (1.0, -1.0)
    )
    slopes = ((ahead - back) / (2.0 * _STEP)).T
    variance = np.diagonal(slopes @ covariance @ slopes.T).reshape(parameters.shape)
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf))


# ------------------------------------------------------------------------------------------------------------------
# Errors of poses that all images share: what the camera's covariance and the target's deviations make of them.
#
# Repeats do not show them and no mean is free of them. If every pose is off by the same (dp, dr), a fit puts that
# into the frames: camera in base is off by dr and by dp + dr x d, d the way from the target to the camera; or target
# in mobile by dr and dp. The shared errors of different poses are not the same, so that each frame is off by less
# than this: what is added to the frames' deviations is an upper estimate, the same in all directions.


@dataclass(frozen=True)
class SharedError:
    """Standard deviations, mm and rad.

    pose      (6,) of a pose's position and rotation vector in the camera frame, root mean squares over a study's runs
    distance  mm, root mean square, from the camera to the target
    """

    pose: tuple[float, ...]
    distance: float

    def __post_init__(self) -> None:
        """Raises ValueError for what is not six deviations and a distance."""
        if len(self.pose) != 6 or not min(*self.pose, self.distance) >= 0.0:
            raise ValueError("a shared error is not six deviations and a distance")

    @classmethod
    def of(cls, shared: Floats, position: Floats) -> SharedError:
        """Of runs (N, 6), of targets at (N, 3) mm in the camera frame."""
        sigma = np.sqrt(np.mean(shared**2, axis=0))
        return cls(tuple(sigma.tolist()), float(np.sqrt(np.mean(np.sum(position**2, axis=1)))))

    def of_frames(self) -> tuple[Floats, Floats]:
        """(6,) that the frames of the camera and of the target may take of it."""
        moved, turned = max(self.pose[:3]), max(self.pose[3:])
        camera, target = (np.repeat([np.hypot(moved, arm * turned), turned], 3) for arm in (self.distance, 0.0))
        return camera, target

    @property
    def sentence(self) -> str:
        """What they are, and where they are counted."""
        moved, turned = about(max(self.pose[:3]), 2), about(float(np.degrees(max(self.pose[3:]))), 2)
        return (
            f"Errors of camera and target that all images share: up to {moved} mm and {turned} degrees (standard "
            "deviations) of a pose. No repeat shows them and no mean makes them smaller: reading sets and the frames' "
            "U hold them in full; the table of repeats, standard errors of the fits and what validation expects do not."
        )
