"""Legs, kinematics, pose and rotation, campaign files, simulated campaigns."""

from cpcal.robot.campaign import Campaign
from cpcal.robot.kinematics import (
    KinematicsError,
    Pose,
    central_pose,
    forward_kinematics,
    inverse_kinematics,
    leg_vectors,
    pose_jacobian,
)
from cpcal.robot.model_choice import ModelChoice
from cpcal.robot.reader import load_campaign
from cpcal.robot.robot import DELTALAB, ROBOTS, Robot, known_robot
from cpcal.robot.rotation import (
    normalised,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    rotation_vector,
    small_rotation,
)
from cpcal.robot.simulate import simulate, true_robot
from cpcal.robot.uncertainty import Uncertainty
from cpcal.robot.writer import save_campaign

__all__ = [
    "DELTALAB",
    "ROBOTS",
    "Campaign",
    "KinematicsError",
    "ModelChoice",
    "Pose",
    "Robot",
    "Uncertainty",
    "central_pose",
    "forward_kinematics",
    "inverse_kinematics",
    "known_robot",
    "leg_vectors",
    "load_campaign",
    "normalised",
    "pose_jacobian",
    "quaternion_conjugate",
    "quaternion_from_matrix",
    "quaternion_from_rotation_vector",
    "quaternion_product",
    "rotation_matrix",
    "rotation_vector",
    "save_campaign",
    "simulate",
    "small_rotation",
    "true_robot",
]
