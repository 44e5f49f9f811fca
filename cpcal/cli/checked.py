"""Runs and certificates, checked again by the exact checker, and what it raises in the words of the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from cpcal.checker import RESULT_NAME, Accepted, LegChecked, Refused, Unusable, check, leg_checks
from cpcal.common.errors import InputError, Problem
from cpcal.execution.forked import side_by_side

if TYPE_CHECKING:
    from cpcal.results import Result


Legs = list[LegChecked] | str  # or why the run is refused as a whole


@contextmanager
def legs_beside(run: Path) -> Iterator[Callable[[], Legs]]:
    """The legs of a run are checked, on all processors, while in the block; what is given waits for what is found.

    It raises InputError where there is nothing to check.
    """
    try:
        checks = leg_checks(run)
    except Refused as reason:
        refused = str(reason)
        yield lambda: refused
        return
    except Unusable as reason:
        unusable = InputError([Problem(str(run), str(reason), "name the folder of a run")])

        def refuse() -> Legs:
            raise unusable

        yield refuse
        return
    with side_by_side(checks) as answers:
        yield answers


def checked_legs(run: Path) -> Legs:
    """The legs of a run. Raises InputError where there is nothing to check."""
    with legs_beside(run) as legs:
        return legs()


def result_of(run: Path) -> Result | str:
    """What the result.json of a run states, or why it is none. Raises InputError where there is no such file."""
    from cpcal.results import load_result

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
