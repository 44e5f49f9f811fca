"""The checker: accepts what a certificate proves, in exact arithmetic. Standard library only; imports nobody.

docs/certificate-format.md is the specification. `check` has the certificates, `check_run` whole runs.
"""

from .certificate import check
from .claims import Accepted, Claims, Point
from .command import INTERNAL, PROVED, REFUSED, UNUSABLE, main
from .exact_campaign import ExactCampaign
from .files import WORK
from .header import FORMAT
from .pose_claim import POSE_SET_SUFFIX, PoseSetChecked, check_pose_set, check_pose_sets
from .refusal import Refused, Unusable
from .robust_claim import ROBUST_NAME, RobustChecked, check_robust
from .run import LegChecked, check_run

__all__ = ["FORMAT", "INTERNAL", "PROVED", "REFUSED", "UNUSABLE", "WORK", "Accepted", "Claims", "ExactCampaign"]
__all__ += [
    "POSE_SET_SUFFIX",
    "ROBUST_NAME",
    "LegChecked",
    "Point",
    "PoseSetChecked",
    "Refused",
    "RobustChecked",
    "Unusable",
    "check",
    "check_pose_set",
    "check_pose_sets",
    "check_robust",
    "check_run",
    "main",
]
