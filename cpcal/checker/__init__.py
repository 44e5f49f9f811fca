"""The checker: accepts what a certificate proves, in exact arithmetic. Standard library only; imports nobody.

docs/certificate-format.md is the specification. `check` checks a certificate, `check_run` a run of legs. Each other
kind of run has a module of its own, which is loaded for such a run only: `sight`, `hand_eye`, `platform`.
"""

from .certificate import FORMAT, Accepted, check
from .leg import ExactCampaign
from .readers import Refused, Unusable
from .run import check_run

__all__ = ["FORMAT", "Accepted", "ExactCampaign", "Refused", "Unusable", "check", "check_run"]
