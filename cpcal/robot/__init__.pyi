from .campaign import (
    Campaign,
)
from .kinematics import (
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
from .known_robots import (
    DELTALAB,
    ROBOTS,
    KnownRobot,
    PoseRange,
    known_robot,
)
from .mechanisms import (
    Mechanisms,
)
from .model_choice import (
    ModelChoice,
)
from .motion import (
    compose,
    inverse,
    transformed,
)
from .proved_pose import (
    ProvedPose,
    prove_pose,
)
from .robot import (
    Robot,
)
from .rotation import (
    normalised,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    rotation_vector,
    small_rotation,
)
from .study import (
    PoseTable,
    Study,
    Truth,
)
from .uncertainty import (
    EXACT_OR_NOT,
    Uncertainty,
)

__all__ = [
    "DELTALAB",
    "EXACT_OR_NOT",
    "ROBOTS",
    "Campaign",
    "ForwardPoses",
    "KinematicsError",
    "KnownRobot",
    "Mechanisms",
    "ModelChoice",
    "Pose",
    "PoseRange",
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
