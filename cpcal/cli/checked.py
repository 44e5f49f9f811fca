"""Every certificate of a demo, checked again by the exact checker."""

from __future__ import annotations

import time
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

from cpcal.cli.verify import flint
from cpcal.proof.checker import check
from cpcal.proof.lines import Rational
from cpcal.proof.refusal import Refused


def check_all(certificates: Iterable[Path], campaign: Path, *, rational: Rational | None = None) -> tuple[bool, str]:
    """Whether all are accepted for the campaign folder, and a sentence; `rational` as in `check`, default: FLINT's."""
    began, steps, files = time.monotonic(), 0, list(certificates)
    numbers = flint() if rational is None else rational
    refused = []
    for path in files:
        try:
            steps += check(path, campaign, rational=numbers).steps
        except Refused as reason:
            refused.append(f"{path.name} ({reason})")
    of = f"{len(files)} certificates"
    how = f"{'FLINT' if numbers is not Fraction else 'Python'}'s exact rationals, no solver"
    if refused:
        return False, f"Of {of} the checker REFUSED {len(refused)}: {'; '.join(refused)}."
    seconds = time.monotonic() - began
    return True, f"The checker accepted all {of} ({how}): {steps:,} steps, {seconds:.1f} s."
