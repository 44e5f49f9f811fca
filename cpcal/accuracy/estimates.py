"""Beside what is proved: the expanded uncertainty of least squares, and the simulator's truth. Floating point."""

from __future__ import annotations

import json

import numpy as np

from cpcal.calibration import fit
from cpcal.common.arrays import Floats
from cpcal.common.errors import CpcalError
from cpcal.robot import (
    Campaign,
    Mechanisms,
    Pose,
    Robot,
    inverse_kinematics,
    leg_vectors,
    pose_jacobian,
    quaternion_conjugate,
    quaternion_product,
    rotation_vector,
)
from cpcal.robot.mechanisms import joint_phases
from cpcal.simulate.assembly import assembled_with
from cpcal.simulate.campaigns import streams, true_robot

COVERAGE = 2.0  # k


def expanded_uncertainty(campaign: Campaign, poses: Pose) -> tuple[Floats, Floats]:
    """U of position, mm, and of rotation, rad, (K,) both: k = 2 times the root of the covariance's trace.

    From the residuals of the plain fit: what they scatter is taken for noise, model error too. nan where the data do
    not determine the parameters.
    """
    found = fit(campaign, covariance="residuals")
    robot = Robot.from_parameters(campaign.robot.name, found.parameters)
    vector = leg_vectors(robot, poses)
    unit = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    back = np.einsum("kji,knj->kni", poses.rotation, unit)
    form = np.concatenate([-unit, back, -np.ones((*unit.shape[:2], 1))], axis=-1)  # (K, n, 7)
    inverse = np.linalg.pinv(pose_jacobian(robot, poses))  # (K, 6, n)
    count, legs = form.shape[:2]
    moves = (inverse[..., None] * form[:, None]).reshape(count, 6, 7 * legs)
    variance = np.einsum("kiu,uv,kiv->ki", moves, found.covariance, moves)
    out = COVERAGE * np.sqrt(np.stack([variance[:, :3].sum(axis=1), variance[:, 3:].sum(axis=1)]))
    return out[0], out[1]


def true_poses(campaign: Campaign, controller: Robot, poses: Pose) -> Pose | None:
    """Where a simulated platform really is when the controller commands K poses; None where the truth is not known."""
    robot = true_robot(campaign)
    if robot is None:
        return None
    try:
        options = json.loads(campaign.provenance["options"])
        reference = 0.5 * sum(options["stroke"])
        stream = streams(int(options["seed"]))[1]
        error = float(options["joint_error"])
        mechanisms = Mechanisms.sampled(
            robot.legs, np.random.default_rng(0), stream, joint_error=error, reference=reference
        )
    except (KeyError, TypeError, ValueError, CpcalError):
        return None
    assert np.array_equal(mechanisms.joint_phase, joint_phases(robot.legs, streams(int(options["seed"]))[1]))
    return assembled_with(robot, mechanisms, inverse_kinematics(controller, poses), poses)


def distances(one: Pose, other: Pose) -> tuple[Floats, Floats]:
    """Between K poses: mm, and the angle in rad."""
    turn = quaternion_product(one.quaternion, quaternion_conjugate(other.quaternion))
    return np.linalg.norm(one.position - other.position, axis=-1), np.linalg.norm(rotation_vector(turn), axis=-1)
