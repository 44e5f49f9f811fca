"""Campaigns that look as if units, orders or frames were mixed up, and the likely cause. Nothing here is a proof.

The nominal robot is off by manufacturing errors only, so its legs should be as long as the readings say to within a few
percent. Where they are not, `mistakes` looks for the cause.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.robot.campaign import Campaign
from cpcal.robot.given import Given
from cpcal.robot.mistakes import SHARE, likely_cause

TURN = 0.1  # rad: no camera is so bad
_NAMED = 3  # measurements in a sentence


def suspicions(campaign: Campaign) -> list[str]:
    """One sentence for each thing that looks wrong, with the likely cause; none for a campaign as it should be."""
    found = []
    given = Given.of(campaign)
    share, typical = given.share, given.typical
    if typical > SHARE:
        found.append(mixed_up(typical, likely_cause(given)))
    elif (rows := np.flatnonzero((share > SHARE).any(axis=1))).size:
        found.append(_odd_rows(campaign, share, rows))
    return found + sizes_in_question(campaign)


def sizes_in_question(campaign: Campaign) -> list[str]:
    """A sentence for each kind of half-widths that no instrument has."""
    found = []
    widest = float(campaign.rotation_radius.max())
    if widest > TURN:
        what = f"Some rotation is known to within {widest:.3g} rad only, which is {np.degrees(widest):.0f} degrees"
        found.append(f"{what}: likely cause: degrees are given where radians are meant.")
    size = float(np.median(np.abs(campaign.length + campaign.robot.offset)))
    for name, radius in (("position", campaign.position_radius), ("leg reading", campaign.length_radius)):
        if (wide := float(radius.max())) > SHARE * size > 0.0:
            what = f"Some {name} is known to within {wide:.3g} mm only, where legs are {size:.3g} mm long"
            found.append(f"{what}: likely cause: a unit other than mm.")
    return found


def mixed_up(typical: float, cause: str | None) -> str:
    """That drawing and readings disagree, and why, if it is known."""
    what = f"The drawing and the readings disagree by {_percent(typical)} of a leg's length"
    if cause is None:
        return f"{what}: check the units (mm), the order of the legs, the order qw,qx,qy,qz, and the frames."
    return f"{what}: likely cause: {cause}."


def _odd_rows(campaign: Campaign, share: Floats, rows: npt.NDArray[np.int64]) -> str:
    ids = campaign.measurement_ids
    named = ", ".join(ids[row] for row in rows[:_NAMED]) + (" and others" if len(rows) > _NAMED else "")
    worst = _percent(float(share[rows].max()))
    return (
        f"{len(rows)} of {len(ids)} measurements ({named}) disagree with the drawing by up to {worst} of a leg's "
        "length, the others do not: check their rows."
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share < 10.0 else f"{share:.3g} times"
