"""What a certificate holds of an answer: all of it, its lower bound, or nothing. The certificate costs no answer."""

from __future__ import annotations

import os
from dataclasses import replace
from fractions import Fraction as F

from cpcal.checker import Refused
from cpcal.checker import problem as exact
from cpcal.checker.problem import Problem
from cpcal.common.errors import InputError
from cpcal.solver.certificate.recording import Claims, Recording, claims_of
from cpcal.solver.certificate.statement import free
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box
from cpcal.solver.optimize import Minimum

_NO_POINT = (
    "the certificate proves the bound, not the point: no certificate can say yet that equations have a solution nearby"
)


class UncertifiedError(InputError):
    """The certificate could not be written, or the checker refuses it; `answer` is what was found, not certified."""

    answer: Minimum


def certified(recording: Recording, path: str | os.PathLike[str], found: Minimum, domain: Box, name: str) -> Minimum:
    """What was found, once its certificate is written and checked. Raises UncertifiedError.

    A certificate says of a point that it satisfies every constraint exactly. A point that only stands for a solution of
    equations in the box around it does not: then the certificate claims the lower bound and the enclosure alone.
    """
    claims = claims_of(found, domain, name)
    why = _unsaid(recording.problem, claims)
    if why:
        found = _not_certified(found, why)
        claims |= {"point": None, "epsilon": claims["epsilon"] and claims["epsilon"] | {"hi": None}}
    try:
        recording.write(path, claims)
    except InputError as error:
        raised = UncertifiedError(error.problems)
        raised.answer = _not_certified(found, "; ".join(problem.what for problem in error.problems))
        raise raised from None
    return replace(found, contractors_used=recording.credited(found.contractors_used))


def _unsaid(problem: Problem, claims: Claims) -> str:
    """Why a certificate cannot say that the claimed point satisfies every constraint exactly; empty where it can."""
    if claims["point"] is None:
        return ""
    at = tuple(F(float.fromhex(v)) for v in claims["point"]["at"])
    x = exact.Unknowns(exact.Box(at, at), free)
    try:
        return "" if all(problem.holds(x, k, "") for k in problem.chosen) else _NO_POINT
    except Refused as refused:
        return f"the certificate proves the bound, not the point: {refused.reason}"


def _not_certified(found: Minimum, why: str) -> Minimum:
    """With what is missing in place of the proof."""
    if found.verdict is Verdict.UNKNOWN:
        return replace(found, status=f"{found.status} Not certified: {why}.")
    return replace(found, verdict=Verdict.NOT_CERTIFIED, status=f"The gap is closed, but not certified: {why}.")
