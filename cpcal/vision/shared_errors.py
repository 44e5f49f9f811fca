"""What errors that all images share do to a pose: those of the camera, of the plate's scale, of the places of its dots.

By A, the derivatives of the whitened centres by the pose, and B, those by the errors, each of deviation 1, errors e
move the pose by -(A' A)^-1 A' B e and leave the residuals M e, M = B - A (A' A)^-1 A' B. For e of unit covariance the
chi-square of residuals r is r' (I + M M')^-1 r.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot import Pose
from cpcal.vision.camera import Camera
from cpcal.vision.dot_model import Prediction, predict
from cpcal.vision.pose_fit import PoseFit
from cpcal.vision.target import Target


def shared_part(
    found: PoseFit,
    dots: Floats,
    target: Target,
    camera: Camera,
    covariance: Floats | None,
    whitened: Callable[[Floats], Floats],
) -> tuple[Floats, float]:
    """The part (6, 6) of the pose's covariance that shared errors make, and the chi-square of its residuals under them.

    dots        (m, 2) mm, those that the fit rests on
    covariance  (9, 9) of the camera's numbers, or None where the camera is exact
    whitened    pixels (m, 2, k) in standard deviations of the dots
    """
    if covariance is None and not target.scale_sigma and not target.dot_sigma:
        return np.zeros((6, 6)), found.chi_square
    prediction = predict(
        dots, target.radius, camera, found.pose, by_camera=covariance is not None, by_dots=target.dot_sigma > 0.0
    )
    by_pose = whitened(prediction.by_pose).reshape(-1, 6)
    sources = _sources(prediction, found.pose, dots, target, covariance)
    by_errors = np.concatenate([whitened(source).reshape(len(by_pose), -1) for source in sources], axis=1)
    moved = np.linalg.solve(by_pose.T @ by_pose, by_pose.T @ by_errors)
    left = by_errors - by_pose @ moved
    against = found.residuals @ left
    explained = against @ np.linalg.solve(np.eye(len(against)) + left.T @ left, against)
    return np.asarray(moved @ moved.T), float(found.chi_square - explained)


def _sources(
    prediction: Prediction, pose: Pose, dots: Floats, target: Target, covariance: Floats | None
) -> Iterator[Floats]:
    """Derivatives (m, 2, k) of the centres by k errors of deviation 1."""
    if prediction.by_camera is not None and covariance is not None:
        values, vectors = np.linalg.eigh(covariance)
        yield prediction.by_camera @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    if target.scale_sigma:
        outward = dots @ pose.rotation[:, :2].T  # mm, where a larger plate has its dots
        yield target.scale_sigma * prediction.by_pose[..., :3] @ outward[..., None]
    if prediction.by_dots is not None:
        count = len(dots)
        each = np.zeros((count, 2, count, 2))
        each[np.arange(count), :, np.arange(count)] = target.dot_sigma * prediction.by_dots
        yield each.reshape(count, 2, 2 * count)
