"""What a result says, in sentences. The quantifier is part of every answer (DESIGN section 1)."""

from __future__ import annotations

import math

from cpcal.numbers import bracket_text
from cpcal.results import LegResult, Result
from cpcal.solver.contract import Verdict

QUANTIFIER = (
    "To satisfy the equations to within eps means: for every measurement there exists a reading in its set "
    "at which the leg equation is off by at most eps."
)
LONGER = "The model takes each leg to be longer than eps."


def leg_sentence(result: Result, leg: LegResult) -> str:
    """The answer for one leg, without its number, and whether nobody can check it again."""
    return _answer(result, leg) + ("" if leg.certified else f" Not certified: {leg.not_certified}.")


def _answer(result: Result, leg: LegResult) -> str:
    if result.options.eps is not None or leg.not_refuted or leg.verdict is Verdict.REFUTED:
        return leg.status
    lo, hi = bracket_text(leg.eps_lo, leg.eps_hi)
    if math.isfinite(leg.eps_hi):
        return f"The smallest model error lies between {lo} and {hi} mm. {leg.status}"
    return f"The smallest model error is at least {lo} mm. {leg.status}"


def center_sentence(result: Result, leg: LegResult) -> str | None:
    """What is proved of the middle of the box as a solution."""
    names = {"fit": "The least-squares fit", "plain": "The plain model's least-squares fit"}
    name = names.get(result.options.center, "The nominal parameter vector")
    return None if leg.verified is None else leg.verified.sentence(name)


def missing_legs(result: Result, legs: int) -> str | None:
    """A sentence on an interrupted run of a robot with so many legs; None for a run that ended by itself."""
    if not result.interrupted:
        return None
    done = {leg.leg for leg in result.legs}
    missing = ", ".join(str(leg) for leg in range(1, legs + 1) if leg not in done)
    text = "Interrupted: what is shown was proved until then."
    return f"{text} There is nothing on leg {missing}." if missing else text
