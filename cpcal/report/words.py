"""What a result says, in sentences. The quantifier is part of every answer (DESIGN section 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cpcal.common.numbers import about, stated
from cpcal.models import PLAIN
from cpcal.questions import (
    LegResult,
    LegVerdict,
    Result,
    Uncertified,
    proved_sentence,
    verdict_of,
)
from cpcal.robot import Campaign

QUANTIFIER = (
    "To explain the data, or satisfy the equations, to within eps means: for every measurement there exists a reading "
    "in its set at which the leg equation is off by at most eps."
)
LONGER = "The model takes each leg to be longer than eps."
SHORT_QUANTIFIER = "To fit: for every measurement some reading in its set is off by at most that."
FRAME = (
    "a: base joint centre, in the base frame of the campaign's poses; b: mobile joint centre, in their mobile frame; "
    "l: length offset."
)


@dataclass(frozen=True)
class Overall:
    """The verdict on the robot: its `kind` is that of a leg's verdict."""

    kind: str
    word: str


def overall(result: Result) -> Overall | None:
    """Pass or fail of all legs together; None where no tolerance was given."""
    if result.options.tolerance is None or not result.legs:
        return None
    verdicts = [verdict_of(result, leg) for leg in result.legs]
    if any(verdict.kind == "unexplained" for verdict in verdicts):
        return Overall("unexplained", "FAIL")
    if all(verdict.passes for verdict in verdicts) and not result.interrupted:
        return Overall("explained", "PASS")
    return Overall("undecided", "UNDECIDED")


def leg_sentence(result: Result, leg: LegResult) -> str:
    """The answer for one leg, without its number: the verdict, what was proved, and whether that can be checked."""
    verdict = verdict_of(result, leg)
    said = [verdict.sentence]
    if verdict.found != "undetermined":
        said.append(proved_sentence(result.options, leg))
    if leg.not_certified:
        said.append(f"Not certified: {leg.not_certified}.")
    return " ".join(said)


def short_fit(verdict: LegVerdict) -> str:
    """The verdict in a few words, for a line of a terminal."""
    if verdict.kind in ("uncompared", "undecided"):
        return f"{verdict.word}, {verdict.range}"
    if verdict.kind == "undetermined":
        return f"undetermined: {', '.join(verdict.names) or 'too few measurements'}"
    if verdict.kind != "unexplained":
        return f"{'' if verdict.tolerance is None else 'pass, '}fits {verdict.within}"
    word = "does not fit" if verdict.tolerance is None else "fail"
    if verdict.beyond is not None:
        return f"{word} {verdict.error}"
    return f"{word}, {verdict.no_better}" if math.isfinite(verdict.lo) else word


def center_sentence(result: Result, leg: LegResult) -> str | None:
    """What is proved of the middle of the box as a solution."""
    names = {"fit": "The least-squares fit", "plain": "The plain model's least-squares fit"}
    name = names.get(result.options.center, "The nominal parameter vector")
    return None if leg.verified is None else leg.verified.sentence(name)


def notices(result: Result, legs: int) -> str | None:
    """What stands above all answers: sentences on a user-defined model, on an interrupted run, and on legs of so many
    that nothing was asked of; None where there is nothing to say."""
    done, every = {leg.leg for leg in result.legs}, range(1, legs + 1)
    asked = result.options.legs or every
    said = [] if result.model.is_ours else [result.model.not_compared]
    if result.interrupted:
        said.append("Interrupted: what is shown was proved until then.")
        missing = ", ".join(str(leg) for leg in asked if leg not in done)
        said += [f"There is nothing on leg {missing}."] if missing else []
    others = ", ".join(str(leg) for leg in every if leg not in asked)
    said += [f"Not asked about, and not judged: leg {others}."] if others else []
    return " ".join(said) or None


def uncertified_legs(result: Result) -> str | None:
    """A sentence on the legs whose certificate was asked for and is missing, and why; None where there is none."""
    without = [leg for leg in result.legs if not leg.certified and leg.not_certified is not Uncertified.NOT_ASKED]
    each = ", ".join(f"leg {leg.leg} ({leg.not_certified})" for leg in without)
    return f"Not certified: {each}." if without else None


# ------------------------------------------------------------------------------------------------------------------
# What a result rests on, in words: the model, the box, the reading sets.

_CENTERS = {
    "fit": "the leg's least-squares fit",
    "plain": "the leg's least-squares fit of the plain model",
    "nominal": "the nominal parameters in the campaign",
}


def assumptions(campaign: Campaign, result: Result) -> dict[str, str]:
    """Paragraphs by their headings."""
    asked = result.options
    center = _CENTERS.get(asked.center, "the center listed with it")
    extra = ", ".join(f"{p.name} within ±{stated(p.half_width)} {p.unit}" for p in result.model.extra)
    return {
        "Model": _model(result),
        "Reading sets": _readings(campaign),
        "Parameters": (
            f"{FRAME} Each of the seven parameters of a leg is looked for within ±{stated(asked.delta)} mm of "
            f"{center}{f', and the extra parameters about 0: {extra}' if extra else ''}. Nothing is said of parameters "
            "outside this box."
        ),
        "Arithmetic": (
            f"Every bound is derived in outward-rounded arithmetic ({asked.arithmetic}) by the contractors "
            f"{', '.join(asked.contractors)}; no answer of a linear-programming solver is trusted. Lower bounds are "
            "printed rounded down and upper bounds rounded up. Figures are drawn in plain floating point."
        ),
    }


def _model(result: Result) -> str:
    if not result.model.is_ours:  # no formula is known to be its own
        return f"{result.model.not_compared} Its error eps is how far they are from being met, in mm. {LONGER}"
    if result.model.name == PLAIN.name:
        said = (
            "A leg with base joint centre a, mobile joint centre b and length offset l satisfies "
            "‖P + R b − a‖ = L + l at every pose (P, R) and reading L."
        )
    else:
        said = (
            f"{result.model.name}: with v = P + R b − a, the vector from a leg's base joint centre a to its mobile one "
            f"b, the length ‖v‖ is {result.model.summary}."
        )
    return f"{said} Its error eps is the largest difference of the two sides, in mm. {LONGER}"


def _readings(campaign: Campaign) -> str:
    if campaign.exact:
        return "Every reading (position, rotation, length) is taken as exact: each set is one point."
    radii = campaign.position_radius, campaign.rotation_radius, campaign.length_radius
    position, rotation, length = (
        ", ".join(
            about(lo) if lo == hi else f"{about(lo)} to {about(hi)}"
            for lo, hi in zip(of.min(axis=0), of.max(axis=0), strict=True)
        )
        for of in radii
    )
    sets = campaign.uncertainty
    how = "" if sets is None or sets.factor is None else f", which are {stated(sets.factor)} stated standard deviations"
    return (
        f"Position: the stated one ± ({position}) mm in x, y, z. Rotation: the stated one turned by a "
        f"rotation vector within ± ({rotation}) rad in the base frame. Leg lengths: the stated ones "
        f"± ({length}) mm, leg by leg. (Rounded here; the campaign has the exact half-widths{how}.)"
    )
