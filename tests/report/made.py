"""Results for the pages' tests, without running the solver."""

import math
from typing import Any

import cpcal
from cpcal.files import campaign_sha256
from cpcal.questions import CampaignNote, Options, PassesFrom, Recommended
from cpcal.questions.result import LEAST_SQUARES
from tests.changed import leg_with


def made_leg(leg: int, *numbers: Any, **changes: Any) -> cpcal.LegResult:
    """`numbers`: eps_lo, eps_hi, point, center, enclosure, floor, support, nodes, programs, seconds.

    The point is what is recommended, as if readings were exact.
    """
    names = ("eps_lo", "eps_hi", "point", "center", "enclosure", "floor", "support", "nodes", "programs", "seconds")
    fields = {"verdict": cpcal.Verdict.PROVED}
    given = fields | dict(zip(names, numbers, strict=True)) | changes
    if given["point"] is not None and math.isfinite(given["eps_hi"]):
        point, eps = given["point"], given["eps_hi"]
        given = {"recommended": Recommended(point, LEAST_SQUARES, eps), "passes_from": PassesFrom(eps, point)} | given
    return leg_with(None, leg=leg, **given)


def made_result(campaign: cpcal.Campaign, *legs: cpcal.LegResult, **options: Any) -> cpcal.Result:
    """Of these legs; `interrupted` and `version` are fields of the result, all else options."""
    fields = {name: options.pop(name) for name in ("interrupted", "version") if name in options}
    note = CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign))
    return cpcal.Result(
        **({"campaign": note, "options": Options(**options), "version": "0.1.0", "legs": legs} | fields)
    )
