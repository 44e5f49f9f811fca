"""What a result rests on, in words: the model, the box, the reading sets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.numbers import about, stated
from cpcal.legs import PLAIN
from cpcal.report.words import LONGER, QUANTIFIER
from cpcal.results import Result
from cpcal.robot import Campaign

_CENTERS = {
    "fit": "the leg's least-squares fit",
    "plain": "the leg's least-squares fit of the plain model",
    "nominal": "the nominal parameters in the campaign",
}


def assumptions(campaign: Campaign, result: Result) -> list[tuple[str, str]]:
    """Pairs of a heading and a paragraph."""
    asked = result.options
    return [
        ("Model", _model(result)),
        ("For which readings", QUANTIFIER),
        ("Reading sets", _readings(campaign)),
        (
            "Parameters",
            f"Each of the seven parameters (a, b, l) of a leg is looked for within ±{stated(asked.delta)} mm of "
            f"{_CENTERS.get(asked.center, 'the center listed with it')}{_extra(result)}. "
            "Nothing is said of parameters outside this box.",
        ),
        (
            "Arithmetic",
            f"Every bound is derived in outward-rounded arithmetic ({asked.arithmetic}) by the contractors "
            f"{', '.join(asked.contractors)}; no answer of a linear-programming solver is trusted. "
            "Tables print lower bounds rounded down and upper bounds rounded up; the figures are drawn in "
            "plain floating point.",
        ),
    ]


def _model(result: Result) -> str:
    plain = (
        "A leg with base joint centre a, mobile joint centre b and length offset l satisfies "
        "‖P + R b − a‖ = L + l at every pose (P, R) and reading L."
    )
    corrected = (
        f"{result.model.name}: with v = P + R b − a, the vector from a leg's base joint centre a to its mobile one b, "
        f"the length ‖v‖ is {result.model.summary}."
    )
    if not result.model.is_ours:  # no formula is known to be its own
        return f"{result.model.not_compared} Its error eps is how far they are from being met, in mm. {LONGER}"
    said = plain if result.model.name == PLAIN.name else corrected
    return f"{said} Its error eps is the largest difference of the two sides, in mm. {LONGER}"


def _extra(result: Result) -> str:
    """Where the extra parameters of the model are looked for."""
    each = [f"{p.name} within ±{stated(p.half_width)} {p.unit}" for p in result.model.extra]
    return f", and the extra parameters about 0: {', '.join(each)}" if each else ""


def _readings(campaign: Campaign) -> str:
    if campaign.exact:
        return "Every reading (position, rotation, length) is taken as exact: each set is one point."
    position, length = _axes(campaign.position_radius), _axes(campaign.length_radius)
    rotation = _axes(campaign.rotation_radius)
    sets = campaign.uncertainty
    how = (
        ""
        if sets is None or sets.factor is None
        else f" They are {stated(sets.factor)} times the standard deviations that the campaign states."
    )
    return (
        f"Position: the stated one ± ({position}) mm in x, y, z. Rotation: the stated one turned by a "
        f"rotation vector within ± ({rotation}) rad in the base frame. Leg lengths: the stated ones "
        f"± ({length}) mm, leg by leg. "
        f"(Rounded here; the campaign has the exact half-widths.){how}"
    )


def _axes(radius: npt.NDArray[np.float64]) -> str:
    """Half-widths (N, n) as n numbers, or ranges where measurements differ."""
    spans = zip(radius.min(axis=0), radius.max(axis=0), strict=True)
    return ", ".join(about(lo) if lo == hi else f"{about(lo)} to {about(hi)}" for lo, hi in spans)
