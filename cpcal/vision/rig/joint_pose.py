"""The pose of a plate from all cameras of a rig together: least squares on the pixels of all.

Errors of the rig (its cameras and their places) and of the plate move the residuals of all dots together, so they are
part of the residuals' covariance: a camera that is known well counts for more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from cpcal.common.arrays import Floats
from cpcal.robot import Pose, normalised, quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.pose import POOR, PoseEstimate
from cpcal.vision.pose_fit import NoPose
from cpcal.vision.rig.rig import EACH, Rig, SeenPlate
from cpcal.vision.rig.view_equations import ViewEquations
from cpcal.vision.target import Target

_STEPS = 30
_SMALL = 1e-3  # standard deviations: a step that ends the fit


def joint_pose(seen: Sequence[SeenPlate], rig: Rig, target: Target) -> PoseEstimate:
    """The pose in the first camera's frame that fits what one or more cameras see. Its shared part holds the errors
    of the rig (cameras and their places) and of the plate; `rival` is inf, as each view was clear alone.

    Raises NoPose where nothing is seen, or the fit does not end.
    """
    if not seen:
        raise NoPose("no camera sees the plate")
    plate = in_first(rig, seen[0])
    for _ in range(_STEPS):
        parts = [ViewEquations.of(rig, one, plate, target) for one in seen]
        slope = np.concatenate([part.by_plate for part in parts])
        residuals = np.concatenate([part.residuals for part in parts])
        errors = _shared(parts, seen, rig, target)
        believed = _believed(errors, slope)
        normal = slope.T @ believed
        step = np.linalg.solve(normal, believed.T @ residuals)
        plate = stepped(plate, step)
        if step @ normal @ step < _SMALL**2:
            left = residuals - slope @ step
            chi_square = float(left @ _believed(errors, left))
            gain = np.linalg.solve(normal, believed.T @ errors)
            factors = np.linalg.cholesky(np.concatenate([one.covariance for one in seen]))
            pixels = (factors @ left.reshape(-1, 2, 1))[..., 0]
            return _estimate(
                plate,
                pixels,
                chi_square,
                np.asarray(np.linalg.inv(normal)),
                np.asarray(gain @ gain.T, dtype=np.float64),
            )
    raise NoPose(f"the fit to all cameras has not ended after {_STEPS} steps")


def _believed(errors: Floats, values: Floats) -> Floats:
    """The inverse covariance I + B B' of residuals under shared errors, B (k, e), times values (k, ...)."""
    return np.asarray(values - errors @ np.linalg.solve(np.eye(errors.shape[1]) + errors.T @ errors, errors.T @ values))


def _estimate(plate: Pose, pixels: Floats, chi_square: float, covariance: Floats, shared: Floats) -> PoseEstimate:
    degrees = pixels.size - 6
    p_value = float(chdtrc(degrees, chi_square))
    scale = chi_square / degrees if p_value < POOR else 1.0
    return PoseEstimate(
        pose=plate,
        covariance=scale * (covariance - shared) + shared,
        shared_part=shared,
        residuals=pixels,
        outliers=np.zeros(len(pixels), dtype=bool),
        rms=float(np.sqrt((pixels**2).mean())),
        chi_square=chi_square,
        degrees=degrees,
        p_value=p_value,
        scale=scale,
        rival=np.inf,
    )


def in_first(rig: Rig, seen: SeenPlate) -> Pose:
    """The pose that a camera alone sees, in the first camera's frame."""
    back = quaternion_conjugate(rig.quaternion[seen.camera])
    turn = Pose(np.zeros(3), back).rotation
    return Pose(turn @ (seen.pose.position - rig.position[seen.camera]), quaternion_product(back, seen.pose.quaternion))


def stepped(pose: Pose, step: Floats) -> Pose:
    """position + step[:3] and R(step[3:]) R."""
    turn = quaternion_from_rotation_vector(step[3:])
    return Pose(pose.position + step[:3], normalised(quaternion_product(turn, pose.quaternion)))


def _shared(parts: Sequence[ViewEquations], seen: Sequence[SeenPlate], rig: Rig, target: Target) -> Floats:
    """Minus the derivatives (k, e) of all residuals by e shared errors of deviation 1."""
    spread = np.sqrt(np.diagonal(rig.covariance))
    unit = np.where(spread > 0.0, spread, 1.0)
    values, vectors = np.linalg.eigh(rig.covariance / unit[:, None] / unit)
    roots = spread[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    rows = []
    for part, one in zip(parts, seen, strict=True):
        by_rig = part.by_camera @ roots[EACH * one.camera : EACH * (one.camera + 1)]
        by_dots = np.zeros((len(one.numbers), 2, len(target.dots), 2))
        if target.dot_sigma:
            by_dots[np.arange(len(one.numbers)), :, one.numbers] = target.dot_sigma * part.by_dots
        dots = by_dots.reshape(len(part.residuals), -1) if target.dot_sigma else np.zeros((len(part.residuals), 0))
        rows.append(np.concatenate([by_rig, target.scale_sigma * part.by_scale, dots], axis=1))
    return np.concatenate(rows)
