"""The checker: accepts what a certificate proves, in exact arithmetic. Standard library only; imports nobody.

docs/certificate-format.md is the specification. `check` has the certificates, `check_run` whole runs; what only some
need, `sight`, `lens`, `hand_eye` and `platform`, is loaded where there is one.
"""

from .certificate import FORMAT, Accepted, Claims, Point, check
from .files import POSE_SET_SUFFIX, WORK
from .leg import ExactCampaign
from .readers import Refused, Unusable
from .run import (
    RESULT_NAME,
    LegCertificates,
    LegChecked,
    RobustChecked,
    certificates_of,
    check_run,
    leg_checks,
)

__all__ = ["FORMAT", "POSE_SET_SUFFIX", "RESULT_NAME", "WORK", "Accepted", "Claims", "LegCertificates"]
__all__ += ["ExactCampaign", "LegChecked", "Point", "Refused", "RobustChecked", "Unusable"]
__all__ += ["certificates_of", "check", "check_run", "leg_checks"]
