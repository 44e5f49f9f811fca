"""Sentences on an accuracy certificate: what is assumed, what is proved under it, what is only estimated."""

from __future__ import annotations

import math

from cpcal.accuracy.findings import Accuracy, AssumedError, WorkspaceAccuracy
from cpcal.common.names import listed
from cpcal.common.numbers import about, at_least, at_most, stated

BRANCH = "The platform stays on the assembly branch that the controller means."


def degrees_up(angle: float) -> str:
    """An angle in degrees, never less than it is."""
    return at_most(math.nextafter(math.degrees(angle), math.inf), 3)


def assumption(found: Accuracy) -> str:
    """The first line of every page and print."""
    each = [error.eps for error in found.assumed]
    size = stated(each[0]) if len(set(each)) == 1 else f"{about(min(each))} to {about(max(each))}"
    whence = "stated by the user" if found.assumed[0].stated else "suggested by the growth of the least error"
    return (
        f"ASSUMED: some parameters of each leg, within {stated(found.delta)} mm of the center of the run, satisfy its "
        f"equation to within {size} mm, at the calibration poses and at every pose spoken of here ({whence}). {BRANCH}"
    )


def sentences(found: Accuracy) -> list[str]:
    """What follows."""
    if found.refuted:
        legs = ", ".join(map(str, found.refuted))
        box = f"within {stated(found.delta)} mm of the center of the run"
        said = f"REFUTED: the campaign allows no parameters of leg {legs} {box} with so small an error."
        return [f"{said} Nothing is proved."]
    out = []
    if found.workspace is not None:
        out += _of_workspace(found.workspace)
    worst = found.worst_pose
    if worst is not None:
        count = len(found.proved_poses)
        out.append(
            f"PROVED under the assumption: at {count} of {len(found.poses)} poses the platform is within "
            f"{at_most(worst.position_bound)} mm and {degrees_up(max(p.rotation_bound for p in found.proved_poses))} "
            f"degrees of where the controller says; the worst is {worst.name}."
        )
    lost = [pose.name for pose in found.poses if not pose.proved]
    if lost:
        out.append(
            f"Nothing is proved at {len(lost)} poses (near a singularity, or the set is too wide): {listed(lost)}."
        )
    beyond = [pose.name for pose in found.poses if pose.beyond]
    if beyond:
        out.append(f"{len(beyond)} poses need leg readings beyond those that were measured: {listed(beyond)}.")
    out += _of_truth(found)
    return out


def _of_workspace(found: WorkspaceAccuracy) -> list[str]:
    out = []
    if len(found.left_out) < len(found.cells):
        end = "" if found.complete else " The search stopped at its limit of cells: more would narrow this bound."
        out.append(
            f"PROVED under the assumption: anywhere in the workspace{' but the cells left out' * bool(found.left_out)} "
            f"the platform is within {at_most(found.position_bound)} mm and {degrees_up(found.rotation_bound)} degrees "
            f"of where the controller says. At the worst pose met the bound is {at_least(found.worst_pose_bound)} mm."
            f"{end}"
        )
    if found.left_out:
        out.append(
            f"LEFT OUT: {len(found.left_out)} of {len(found.cells)} cells, of which nothing is proved; the platform is "
            "singular or nearly so there, or the cells are still too large. They are listed below."
        )
    return out


def _of_truth(found: Accuracy) -> list[str]:
    if not found.truth_known:
        return []
    if found.violated:
        names = listed([pose.name for pose in found.violated])
        return [
            f"THE ASSUMPTION FAILS: the simulator's truth violates the bound at {len(found.violated)} poses: {names}."
        ]
    true = max(p.estimated.true_position or 0.0 for p in found.poses)
    return [f"The simulator's truth is inside at every pose; its largest error is {about(true)} mm."]


def growth_rows(errors: tuple[AssumedError, ...]) -> list[tuple[str, ...]]:
    """For each leg the least errors of more and more poses, what the campaign refutes, and what is assumed; mm."""
    return [
        (
            str(e.leg),
            *(about(v) for v in e.growth),
            at_least(e.refuted_below),
            stated(e.eps) if e.stated else about(e.eps),
        )
        for e in errors
    ]
