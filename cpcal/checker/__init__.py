"""The checker: accepts what a certificate proves, in exact arithmetic. Standard library only; imports nobody.

docs/certificate-format.md is the specification. `check` has the certificates, `check_run` whole runs; claims of other
kinds, in `robust_claim` and `pose_claim`, are loaded by whoever has one.
"""

from .certificate import check
from .claims import Accepted, Claims, Point
from .exact_campaign import ExactCampaign
from .files import POSE_SET_SUFFIX, ROBUST_NAME, WORK
from .header import FORMAT
from .refusal import Refused, Unusable
from .run import RESULT_NAME, LegChecked, check_run, leg_checks

__all__ = ["FORMAT", "POSE_SET_SUFFIX", "RESULT_NAME", "ROBUST_NAME", "WORK", "Accepted", "Claims", "ExactCampaign"]
__all__ += ["LegChecked", "Point", "Refused", "Unusable", "check", "check_run", "leg_checks"]
