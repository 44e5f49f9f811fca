"""The checker: accepts what a certificate proves, in exact arithmetic. Standard library only; imports nobody.

docs/certificate-format.md is the specification. `check` checks a certificate, `check_run` a run of legs. Each other
kind of run has a module of its own, which is loaded for such a run only: `sight`, `hand_eye`, `platform`.
"""

from .certificate import FORMAT, Accepted, Claims, Point, check
from .files import POSE_SET_SUFFIX, WORK
from .leg import ExactCampaign
from .readers import Refused, Unusable
from .run import RESULT_NAME, LegCertificates, LegChecked, RobustChecked, certificates_of, check_run, leg_checks

__all__ = ["FORMAT", "POSE_SET_SUFFIX", "RESULT_NAME", "WORK", "Accepted", "Claims", "LegCertificates"]
__all__ += ["ExactCampaign", "LegChecked", "Point", "Refused", "RobustChecked", "Unusable"]
__all__ += ["certificates_of", "check", "check_run", "leg_checks"]
