"""The checker: accepts what a certificate proves, in exact arithmetic. Standard library only; imports nobody.

docs/certificate-format.md is the specification. `check` has the certificates, `check_run` whole runs.
"""

from __future__ import annotations

from .campaign import ExactCampaign
from .certificate import FORMAT, check
from .claims import Accepted, Claims, Point
from .command import INTERNAL, PROVED, REFUSED, UNUSABLE, main
from .refusal import Refused, Unusable
from .run import LegChecked, check_run
from .strict import WORK

__all__ = [
    "FORMAT",
    "INTERNAL",
    "PROVED",
    "REFUSED",
    "UNUSABLE",
    "WORK",
    "Accepted",
    "Claims",
    "ExactCampaign",
    "LegChecked",
    "Point",
    "Refused",
    "Unusable",
    "check",
    "check_run",
    "main",
]
