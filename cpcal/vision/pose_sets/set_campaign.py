"""Campaigns whose reading sets come from pixels: a guaranteed pose set for every row instead of 3 sigma."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.robot import Campaign, Robot
from cpcal.vision.pose_sets.pose_set import PoseSet

# a page of such a campaign shows it among the campaign's provenance
NOT_ON_THE_PAGE = "checked by `cpcal verify` of their folder, from pixels on; the check on this page begins after them"


def campaign_of(
    sets: Sequence[PoseSet],
    lengths: npt.ArrayLike,
    robot: Robot,
    *,
    length_radius: npt.ArrayLike = 0.0,
    pose: Sequence[str] | None = None,
    run: Sequence[str] | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Campaign:
    """The campaign of N pose sets of the mobile frame in the base frame, and leg readings (N, n) mm.

    Row k states |P - P_k| <= p and |2 s| <= r with half-widths of its own, which hold the pose set of image k: what is
    certified of the campaign is true of every robot whose poses show the dots in their pixel boxes and whose leg
    readings are off by at most `length_radius` (broadcast to (N, n) mm). The frames were exact: what is not known of
    them (hand-eye calibration) is not in the sets. What the campaign's certificates and pages check begins at these
    boxes, not at the pixels; its `provenance` says so.

    Raises InputError for sets that are not proved, for frames that differ, and for what makes no campaign.
    """
    problems = [
        Problem(f"pose set {k}", one.status, "leave the image out, or give wider pixel boxes")
        for k, one in enumerate(sets)
        if one.pose is None
    ]
    if any(one.frames != sets[0].frames for one in sets):
        problems.append(Problem("pose sets", "have different frames", "enclose all with the same Frames"))
    if problems:
        raise InputError(problems)
    poses = [one.pose for one in sets if one.pose is not None]
    return Campaign.of(
        robot,
        np.array([one.position for one in poses]),
        np.array([one.quaternion for one in poses]),
        lengths,
        pose=pose,
        run=run,
        position_radius=np.array([one.position_radius for one in sets]),
        rotation_radius=np.array([one.rotation_radius for one in sets]),
        length_radius=length_radius,
        exact=length_radius is None,
        provenance={"pose sets": NOT_ON_THE_PAGE, **(provenance or {})},
    )
