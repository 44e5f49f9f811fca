"""Certificates, checked again all at once by the exact checker."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import cast

from cpcal.checker.checker import check
from cpcal.checker.lines import Rational
from cpcal.checker.refusal import Refused


def check_all(pairs: Iterable[tuple[Path, Path]], *, rational: Rational | None = None) -> tuple[bool, str]:
    """Whether all certificates are accepted, each for the campaign folder beside it, and a sentence.

    `rational` as in `check`, default: FLINT's.
    """
    steps, files = 0, list(pairs)
    numbers = flint() if rational is None else rational
    refused = []
    for path, campaign in files:
        try:
            steps += check(path, campaign, rational=numbers).steps
        except Refused as reason:
            refused.append(f"{path.name} ({reason})")
    of = f"{len(files)} certificates"
    how = f"{'FLINT' if numbers is not Fraction else 'Python'}'s exact rationals, no solver"
    if refused:
        return False, f"Of {of} the checker REFUSED {len(refused)}: {'; '.join(refused)}."
    return True, f"The checker accepted all {of} ({how}): {steps:,} steps."


def flint() -> Rational:
    """FLINT's exact rationals."""
    from flint import fmpq  # the checker itself never needs it

    return cast(Rational, fmpq)
