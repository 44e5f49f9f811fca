"""Legs, kinematics, pose and rotation, campaign and study files, simulated campaigns and studies."""

from cpcal.robot.campaign import (
    Campaign,
)
from cpcal.robot.kinematics import (
    ForwardPoses,
    KinematicsError,
    Pose,
    central_pose,
    forward_kinematics,
    forward_poses,
    inverse_kinematics,
    leg_vectors,
    pose_jacobian,
)
from cpcal.robot.mechanisms import (
    Mechanisms,
)
from cpcal.robot.model_choice import (
    ModelChoice,
)
from cpcal.robot.motion import (
    compose,
    inverse,
    transformed,
)
from cpcal.robot.proved_pose import (
    ProvedPose,
    prove_pose,
)
from cpcal.robot.robot import (
    DELTALAB,
    ROBOTS,
    Robot,
    known_robot,
)
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
from cpcal.robot.study import (
    PoseTable,
    Study,
    Truth,
)
from cpcal.robot.uncertainty import (
    Uncertainty,
)

__all__ = [
    "DELTALAB",
    "ROBOTS",
    "Campaign",
    "ForwardPoses",
    "KinematicsError",
    "Mechanisms",
    "ModelChoice",
    "Pose",
    "PoseTable",
    "ProvedPose",
    "Robot",
    "Study",
    "Truth",
    "Uncertainty",
    "central_pose",
    "compose",
    "forward_kinematics",
    "forward_poses",
    "inverse",
    "inverse_kinematics",
    "known_robot",
    "leg_vectors",
    "normalised",
    "pose_jacobian",
    "prove_pose",
    "quaternion_conjugate",
    "quaternion_from_matrix",
    "quaternion_from_rotation_vector",
    "quaternion_product",
    "rotation_matrix",
    "rotation_vector",
    "small_rotation",
    "transformed",
]
