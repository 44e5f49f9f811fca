"""What a result says, in sentences. The quantifier is part of every answer (DESIGN section 1)."""

from __future__ import annotations

from cpcal.results import LegResult, Result, Undetermined, proved_sentence, verdict_of

QUANTIFIER = (
    "To explain the data, or satisfy the equations, to within eps means: for every measurement there exists a reading "
    "in its set at which the leg equation is off by at most eps."
)
LONGER = "The model takes each leg to be longer than eps."


def leg_sentence(result: Result, leg: LegResult) -> str:
    """The answer for one leg, without its number: the verdict, what was proved, and whether that can be checked."""
    verdict = verdict_of(result, leg)
    said = [verdict.sentence]
    if not isinstance(verdict, Undetermined):
        said.append(proved_sentence(result.options, leg))
    if leg.not_certified:
        said.append(f"Not certified: {leg.not_certified}.")
    return " ".join(said)


def summary(result: Result) -> str:
    """The verdicts in one line, the same ones together."""
    legs: dict[str, list[str]] = {}
    for leg in result.legs:
        legs.setdefault(verdict_of(result, leg).word, []).append(str(leg.leg))
    return " ".join(f"Leg {', '.join(numbers)}: {word}." for word, numbers in legs.items())


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
