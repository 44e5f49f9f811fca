"""Whether the checker can afford a certificate: nobody is given one that `cpcal verify` would refuse for its work.

A whole check costs as much as the search, so it is made only of certificates that may come near the limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction as F
from pathlib import Path
from typing import Any, BinaryIO

from cpcal.checker import Refused
from cpcal.checker import problem as exact
from cpcal.checker.certificate import check_lines
from cpcal.checker.files import WORK, Budget, Lines
from cpcal.checker.header import problem_of
from cpcal.checker.problem import Problem, Unknowns
from cpcal.common.errors import InputError
from cpcal.common.errors import Problem as Trouble
from cpcal.solver.interval import Box

_WORK_A_BYTE = 250  # of the steps; up to 200 were seen, with the leg model "linear" and uncertain readings
_SAMPLE = 4  # measurements
_NEAR = 2  # an estimate within this factor of the limit is not trusted


class UncheckableError(InputError):
    """The check of a certificate takes more than the checker spends; it was not written."""


def check_affordable(
    where: str, lines: BinaryIO, problem: Problem, domain: Box, claims: Mapping[str, Any], work: int | None = None
) -> None:
    """Raise UncheckableError where the checker would refuse these lines for the `work` of its check (default: its own).

    `where`: the file that they are for.
    """
    most = WORK if work is None else work
    if _NEAR * (_WORK_A_BYTE * lines.seek(0, 2) + _work_of_point(problem, claims)) <= most:
        return
    lines.seek(0)
    counted = Lines(lines, Budget(most))
    root = exact.Box(tuple(F(float(v)) for v in domain.lo), tuple(F(float(v)) for v in domain.hi))

    def formed(header: dict[str, Any]) -> tuple[Problem, exact.Box]:
        return (problem, root) if "campaign" in header else problem_of(header, counted, Path(where), None)

    try:
        check_lines(counted, formed)
    except Refused as refused:
        if refused.code != "limit":
            raise
        remedy = "use fewer measurements or constraints, or a wider gap; or leave the certificate out"
        raise UncheckableError([Trouble(where, f"would be refused: {refused.reason}", remedy)]) from None


def _work_of_point(problem: Problem, claims: Mapping[str, Any]) -> int:
    """About the work to show that the claimed point satisfies its measurements."""
    point = claims["point"]
    if point is None:
        return 0
    spent: list[int] = []
    at = tuple(F(float.fromhex(v)) for v in point["at"])
    x = Unknowns(exact.Box(at, at), spent.append)
    holds = problem.chosen if point["holds"] == "all" else point["holds"]
    sample = list(zip(holds, point["readings"] or [None] * len(holds), strict=True))[:: max(1, len(holds) // _SAMPLE)]
    problem.unproved(x, [(k, "0" * len(problem.radii(k)) if signs is None else signs) for k, signs in sample])
    return sum(spent) * len(holds) // max(1, len(sample))
