"""Measurements that repeat others: copied rows, and campaigns that show one pose only."""

from __future__ import annotations

import numpy as np

from cpcal.common.numbers import about
from cpcal.robot.campaign import Campaign
from cpcal.robot.rotation import quaternion_conjugate, quaternion_product, rotation_vector

_STILL = 1e-3  # of the leg length, and rad: poses this close are one pose for any purpose of calibration
_NAMED = 3  # pairs in a sentence


def copied_rows(campaign: Campaign) -> str | None:
    """A sentence on rows that hold the same numbers as an earlier one; sensors never read the same twice."""
    table = np.concatenate([campaign.position, campaign.quaternion, campaign.length], axis=1)
    whole = table.view(f"V{table.itemsize * table.shape[1]}")[:, 0]  # a row as one value: its bytes
    _, first, which = np.unique(whole, return_index=True, return_inverse=True)
    earlier = first[which]
    copies = np.flatnonzero(earlier != np.arange(len(table)))
    if not len(copies):
        return None
    ids = campaign.measurement_ids
    named = ", ".join(f"{ids[row]} as {ids[earlier[row]]}" for row in copies[:_NAMED])
    more = " and others" if len(copies) > _NAMED else ""
    some = "1 measurement holds" if len(copies) == 1 else f"{len(copies)} measurements hold"
    return f"{some} the same numbers as an earlier one ({named}{more}): take copies out, they count as evidence."


def single_pose(campaign: Campaign) -> str | None:
    """A sentence on a campaign whose poses are all the same."""
    if len(campaign) < 2:
        return None
    size = float(np.median(np.abs(campaign.length + campaign.robot.offset)))
    moved = float(np.abs(campaign.position - campaign.position[0]).max())
    turned = quaternion_product(campaign.quaternion, quaternion_conjugate(campaign.quaternion[0]))
    angle = float(np.abs(rotation_vector(turned)).max())
    if moved > _STILL * size or angle > _STILL:
        return None
    return (
        f"All {len(campaign)} measurements show the same pose (to within {about(moved, 2)} mm and "
        f"{about(np.degrees(angle), 2)} degrees): measure poses all over the workspace."
    )
