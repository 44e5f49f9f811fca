"""Where the cameras of a rig are, from moments at which several of them see the plate.

Least squares on the pixels of all images: unknown are the plate's pose at each moment, each camera's pose but the
first's, and the cameras' nine numbers and the plate's size where their deviations are stated, with those as knowledge.
So the covariance of all of them holds what the cameras' calibrations leave open. The plates' poses are eliminated
moment by moment (Schur's complement).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from cpcal.common.arrays import Bools, Floats
from cpcal.common.errors import CpcalError, InputError, Problem
from cpcal.robot import Pose, normalised, quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product
from cpcal.vision.files.camera_file import CameraRecord
from cpcal.vision.pose import POOR
from cpcal.vision.rig.joint_pose import in_first, stepped
from cpcal.vision.rig.rig import EACH, Rig, SeenPlate
from cpcal.vision.rig.view_equations import ViewEquations
from cpcal.vision.target import Target

FEWEST = 3  # moments that a camera shares with others
_STEPS = 30
_SMALL = 1e-3  # standard deviations: a step that ends the fit

Moment = Sequence[SeenPlate]


class NoRigError(CpcalError):
    """The images do not determine the rig. Its text is the reason."""


@dataclass(frozen=True, eq=False)
class FoundRig:
    """A rig; how many moments tell of it; chi-square of all residuals over their number (1 when all is as stated)."""

    rig: Rig
    moments: int
    scale: float


def calibrate_rig(records: Mapping[str, CameraRecord], moments: Sequence[Moment], target: Target) -> FoundRig:
    """The rig of cameras of the given names, in whose order `SeenPlate.camera` counts.

    Raises NoRigError where a camera shares fewer than three moments with the others, or the fit does not end, and
    InputError for a target whose dots' places are uncertain one by one.
    """
    if target.dot_sigma:
        remedy = "refine the dots with `cpcal detect --calibrate --refine-dots`, and leave dot_sigma out"
        raise InputError([Problem("target dot_sigma", "cannot be taken into account when a rig is sought", remedy)])
    shared = [moment for moment in moments if len(moment) > 1]
    rig = _started(records, shared)
    known = np.zeros((EACH * len(records) + 1,) * 2)  # inverse covariances of what is known before
    free = _free(records, target)
    for k, record in enumerate(records.values()):
        if record.covariance is not None:
            place = slice(EACH * k + 6, EACH * (k + 1))
            known[place, place] = np.linalg.pinv(record.covariance, hermitian=True)
    if target.scale_sigma:
        known[-1, -1] = target.scale_sigma**-2
    return _fitted(rig, shared, target, known, free)


def _free(records: Mapping[str, CameraRecord], target: Target) -> Bools:
    """Which of the 15 c + 1 numbers move: poses but the first's, what has deviations, the plate's size likewise."""
    out = np.zeros(EACH * len(records) + 1, dtype=bool)
    for k, record in enumerate(records.values()):
        out[EACH * k : EACH * k + 6] = k > 0
        if record.covariance is not None:
            out[EACH * k + 6 : EACH * (k + 1)] = np.diagonal(record.covariance) > 0.0
    out[-1] = target.scale_sigma > 0.0
    return out


def _started(records: Mapping[str, CameraRecord], shared: Sequence[Moment]) -> Rig:
    """Each camera's pose by one moment that it shares with a camera whose pose is known."""
    count = len(records)
    poses: dict[int, Pose] = {0: Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))}
    numbers = np.bincount([one.camera for moment in shared for one in moment], minlength=count)
    for name, number in zip(records, numbers, strict=True):
        if number < FEWEST:
            raise NoRigError(f"camera {name} shares {number} images of the plate with others: give {FEWEST} or more")
    while len(poses) < count:
        before = len(poses)
        for moment in shared:
            told = next((one for one in moment if one.camera in poses), None)
            for one in moment:
                if told is not None and one.camera not in poses:
                    poses[one.camera] = _relative(one.pose, told.pose, poses[told.camera])
        if len(poses) == before:
            lost = [name for k, name in enumerate(records) if k not in poses]
            raise NoRigError(f"no image links {', '.join(lost)} with {next(iter(records))}, not even by other cameras")
    return Rig(
        tuple(records),
        tuple(record.camera for record in records.values()),
        np.array([poses[k].position for k in range(count)]),
        np.array([poses[k].quaternion for k in range(count)]),
        np.zeros((EACH * count, EACH * count)),
    )


def _relative(seen: Pose, other: Pose, known: Pose) -> Pose:
    """Camera C of the first frame by the plate's pose in it, in another camera, and that camera's: Q Q_o^-1 C_o."""
    turn = quaternion_product(seen.quaternion, quaternion_conjugate(other.quaternion))
    matrix = Pose(np.zeros(3), turn).rotation
    across = seen.position - matrix @ other.position
    return Pose(matrix @ known.position + across, normalised(quaternion_product(turn, known.quaternion)))


def _fitted(rig: Rig, shared: Sequence[Moment], target: Target, known: Floats, free: Bools) -> FoundRig:
    plates = [in_first(rig, moment[0]) for moment in shared]
    start = np.concatenate([np.concatenate([np.zeros(6), camera.numbers]) for camera in rig.cameras] + [np.ones(1)])
    off = np.zeros(len(start))  # of what was known before
    for _ in range(_STEPS):
        normal, side, parts, chi_square = known.copy(), -known @ off, [], float(off @ known @ off)
        for moment, plate in zip(shared, plates, strict=True):
            a, b, residuals = _of_moment(rig, moment, plate, _resized(target, 1.0 + off[-1]))
            own, mixed = a.T @ a, a.T @ b
            eliminated = np.linalg.solve(own, np.column_stack([mixed, a.T @ residuals]))
            normal += b.T @ b - mixed.T @ eliminated[:, :-1]
            side += b.T @ residuals - mixed.T @ eliminated[:, -1]
            parts.append((eliminated, len(residuals)))
            chi_square += float(residuals @ residuals)
        reduced = normal[np.ix_(free, free)]
        step = np.zeros(len(start))
        step[free] = np.linalg.solve(reduced, side[free])
        plates = [
            stepped(plate, eliminated[:, -1] - eliminated[:, :-1] @ step)
            for plate, (eliminated, _) in zip(plates, parts, strict=True)
        ]
        rig, off = _moved(rig, step), off + step
        if step @ normal @ step < _SMALL**2:
            count = sum(size for _, size in parts)
            return _result(rig, reduced, free, chi_square, count - 6 * len(shared) - 6 * (len(rig.names) - 1), shared)
    raise NoRigError(f"the fit of the rig has not ended after {_STEPS} steps")


def _resized(target: Target, size: float) -> Target:
    """The target, so many times as large."""
    return target if size == 1.0 else replace(target, dots=size * target.dots)


def _of_moment(rig: Rig, moment: Moment, plate: Pose, target: Target) -> tuple[Floats, Floats, Floats]:
    """Derivatives by the plate's pose (k, 6) and by the 15 c + 1 others, and the residuals (k,), of all cameras."""
    parts = [ViewEquations.of(rig, one, plate, target) for one in moment]
    others = []
    for part, one in zip(parts, moment, strict=True):
        rows = np.zeros((len(part.residuals), EACH * len(rig.names) + 1))
        rows[:, EACH * one.camera : EACH * (one.camera + 1)] = part.by_camera
        rows[:, -1:] = part.by_scale
        others.append(rows)
    by_plate = np.concatenate([part.by_plate for part in parts])
    return by_plate, np.concatenate(others), np.concatenate([part.residuals for part in parts])


def _moved(rig: Rig, step: Floats) -> Rig:
    steps = step[:-1].reshape(-1, EACH)
    turns = [quaternion_from_rotation_vector(one[3:6]) for one in steps]
    return Rig(
        rig.names,
        tuple(c.with_numbers(c.numbers + one[6:]) for c, one in zip(rig.cameras, steps, strict=True)),
        rig.position + steps[:, :3],
        np.array([normalised(quaternion_product(t, q)) for t, q in zip(turns, rig.quaternion, strict=True)]),
        rig.covariance,
    )


def _result(
    rig: Rig, normal: Floats, free: Bools, chi_square: float, degrees: int, shared: Sequence[Moment]
) -> FoundRig:
    scale = chi_square / degrees
    poor = float(chdtrc(degrees, chi_square)) < POOR
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = np.linalg.inv(normal) * (scale if poor else 1.0)
    sizes = np.concatenate([one.covariance for moment in shared for one in moment])
    rms = float(np.sqrt(scale * sizes[:, [0, 1], [0, 1]].mean()))
    symmetric = 0.5 * (covariance + covariance.T)[:-1, :-1]
    return FoundRig(
        Rig(rig.names, rig.cameras, rig.position, rig.quaternion, symmetric, rms), len(shared), float(scale)
    )
