"""The one place that knows how a certificate is checked."""

from __future__ import annotations

import time
from pathlib import Path

from cpcal.checker import check


def checked(certificate: Path) -> dict[str, float]:
    """Steps, size and checking time (reading the campaign.json beside it included).

    Raises what the checker raises.
    """
    began = time.perf_counter()
    accepted = check(certificate)
    return {
        "steps": accepted.steps,
        "size": certificate.stat().st_size / 1000,
        "check": time.perf_counter() - began,
    }
