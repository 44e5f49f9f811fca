"""Certificates, checked again all at once by the exact checker."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cpcal.checker import Refused, Unusable, check


def check_all(certificates: Iterable[Path]) -> tuple[bool, str]:
    """Whether all certificates are accepted, each for the campaign.json beside it, and a sentence."""
    steps, files = 0, list(certificates)
    refused = []
    for path in files:
        try:
            steps += check(path).steps
        except (Refused, Unusable) as reason:
            refused.append(f"{path.name} ({reason})")
    of = f"{len(files)} certificates"
    if refused:
        return False, f"Of {of} the checker REFUSED {len(refused)}: {'; '.join(refused)}."
    return True, f"The checker accepted all {of} (exact arithmetic, no solver): {steps:,} steps."
