"""Runs and certificates, checked again by the exact checker, and what it raises in the words of the command line."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cpcal.checker import Accepted, LegChecked, Refused, Unusable, check, check_run
from cpcal.common.errors import InputError, Problem
from cpcal.results import RESULT_NAME, Result, load_result


def checked_legs(run: Path) -> list[LegChecked] | str:
    """The legs of a run, or why it is refused as a whole. Raises InputError where there is nothing to check."""
    try:
        return check_run(run)
    except Refused as reason:
        return str(reason)
    except Unusable as reason:
        raise InputError([Problem(str(run), str(reason), "name the folder of a run")]) from None


def result_of(run: Path) -> Result | str:
    """What the result.json of a run states, or why it is none. Raises InputError where there is no such file."""
    try:
        return load_result(run)
    except InputError as error:
        if not (run / RESULT_NAME).is_file():
            raise
        return "; ".join(problem.what for problem in error.problems)


def checked_certificate(path: Path) -> Accepted | str:
    """What a certificate proves, or why it is refused. Raises InputError where there is nothing to check."""
    try:
        return check(path)
    except Refused as reason:
        return str(reason)
    except Unusable as reason:
        raise InputError([Problem(str(path), str(reason), "name the folder of a run, or a certificate")]) from None


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
