"""Nobody is given a certificate that `cpcal verify` would refuse: it is checked before it is written.

A whole check costs as much as the search. Of legs and of poses, whose claims are of one kind, it is made only where its
work may come near the limit; of a minimisation of constraints that the certificate states itself, always.
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
    """The checker refuses the certificate, mostly because its check takes too much work; it was not written."""


def check_affordable(
    where: str, lines: BinaryIO, problem: Problem, domain: Box, claims: Mapping[str, Any], work: int | None = None
) -> None:
    """Raise UncheckableError where the checker would refuse these lines.

    `where`: the file that they are for; `work`: of the check, at most (default: what the checker spends).
    """
    most = WORK if work is None else work
    needed = _NEAR * (_WORK_A_BYTE * lines.seek(0, 2) + _work_of_point(problem, claims))
    if needed <= most and (problem.model is not None or problem.objective is None):
        return
    lines.seek(0)
    counted = Lines(lines, Budget(most))
    root = exact.Box(tuple(F(float(v)) for v in domain.lo), tuple(F(float(v)) for v in domain.hi))

    def formed(header: dict[str, Any]) -> tuple[Problem, exact.Box]:
        return (problem, root) if "campaign" in header else problem_of(header, counted, Path(where), None)

    try:
        check_lines(counted, formed)
    except Refused as refused:
        remedy = "use fewer measurements or constraints, or a wider gap; or leave the certificate out"
        if refused.code != "limit":
            remedy = "this is an error of ours, please report it; leave the certificate out"
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
