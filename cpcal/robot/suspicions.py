"""Campaigns that look as if units, orders or frames were mixed up, and the likely cause. Nothing here is a proof.

The nominal robot is off by manufacturing errors only, so its legs should be as long as the readings say to within a few
percent. Where they are not, the usual mix-ups are undone one by one; the one that makes the readings agree is named.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.robot.campaign import Campaign
from cpcal.robot.kinematics import Pose, leg_vectors
from cpcal.robot.motion import inverse
from cpcal.robot.robot import LARGEST, Robot
from cpcal.robot.rotation import quaternion_conjugate

SHARE = 0.05  # of the leg length: larger nominal residuals are suspicious
TURN = 0.1  # rad: no camera is so bad
_BETTER = 0.2  # a cause is named when it leaves at most this share of the residuals
_UNITS = {"metres": 1e3, "centimetres": 10.0, "inches": 25.4, "micrometres": 1e-3}
_NAMED = 3  # measurements in a sentence


def suspicions(campaign: Campaign) -> list[str]:
    """One sentence for each thing that looks wrong, with the likely cause; none for a campaign as it should be."""
    found = []
    pose = Pose(campaign.position, campaign.quaternion)
    share = _share(campaign.robot, pose, campaign.length)
    typical = _typical(share)
    if typical > SHARE:
        found.append(_sentence(typical, _cause(campaign, pose, typical)))
    elif (rows := np.flatnonzero((share > SHARE).any(axis=1))).size:
        found.append(_odd_rows(campaign, share, rows))
    widest = float(campaign.rotation_radius.max())
    if widest > TURN:
        what = f"Some rotation is known to within {widest:.3g} rad only, which is {np.degrees(widest):.0f} degrees"
        found.append(f"{what}: likely cause: degrees are given where radians are meant.")
    return found


def _share(robot: Robot, pose: Pose, length: Floats) -> Floats:
    """|nominal residual| / nominal leg length, (N, n)."""
    nominal = np.linalg.norm(leg_vectors(robot, pose), axis=-1)
    return np.asarray(np.abs(nominal - robot.offset - length) / np.maximum(nominal, np.finfo(np.float64).tiny))


def _typical(share: Floats) -> float:
    """The median over the measurements, of the worst leg: a few odd rows do not move it."""
    return float(np.median(share, axis=0).max())


def _sentence(typical: float, cause: str | None) -> str:
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


def _cause(campaign: Campaign, pose: Pose, typical: float) -> str | None:
    """The mix-up that, undone, leaves the smallest residuals, if they are small then."""
    best, cause = min(SHARE, _BETTER * typical), None
    with np.errstate(all="ignore"):
        for name, robot, turned, length in _undone(campaign, pose):
            left = _typical(_share(robot, turned, length))
            if left < best:
                best, cause = left, name
    return cause


def _undone(campaign: Campaign, pose: Pose) -> Iterator[tuple[str, Robot, Pose, Floats]]:
    """Each mix-up by name, and robot, poses and readings without it."""
    robot, length, place, quaternion = campaign.robot, campaign.length, pose.position, pose.quaternion
    for unit, factor in _UNITS.items():
        scaled, drawing = Pose(factor * place, quaternion), np.clip(factor * robot.parameters, -LARGEST, LARGEST)
        yield f"positions are in {unit}, not mm", robot, scaled, length
        yield f"leg readings are in {unit}, not mm", robot, pose, factor * length
        yield f"positions and leg readings are in {unit}, not mm", robot, scaled, factor * length
        yield f"the drawing is in {unit}, not mm", Robot.from_parameters(robot.name, drawing), pose, length
    swapped = "quaternions are in the order qx,qy,qz,qw, not qw,qx,qy,qz"
    yield swapped, robot, Pose(place, np.roll(quaternion, 1, axis=1)), length
    yield "rotations are from base to mobile frame", robot, Pose(place, quaternion_conjugate(quaternion)), length
    yield "poses are those of the base in the mobile frame", robot, inverse(pose), length
    yield "readings are whole leg lengths, to which the offset is added again", robot, pose, length - robot.offset
    yield "readings have the wrong sign", robot, pose, -length
    yield "the z axis points the other way", robot, Pose(place * [1.0, 1.0, -1.0], quaternion), length
    for shift in range(1, robot.legs):
        yield "the readings' columns are in another order than the legs", robot, pose, np.roll(length, shift, axis=1)
    yield "the readings' columns are in reverse order", robot, pose, length[:, ::-1]
