"""The stages of `pose_set`: dots seen through pyramids, a first box of poses, and what the constraints leave of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Indices
from cpcal.robot import Pose, quaternion_from_matrix
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, in_sequence, shrunk
from cpcal.solver.network import ConstraintNetwork
from cpcal.vision.pose_sets.motion_rows import first_motions
from cpcal.vision.pose_sets.pose_box import PoseBox, pose_box
from cpcal.vision.pose_sets.pose_frames import Motions
from cpcal.vision.pose_sets.pose_rows import pose_rows
from cpcal.vision.pose_sets.sight import Sight

Found = PoseBox | str | None  # what holds all poses; or why nothing is known; or that there are none

_PASSES = 8
_PAYS = 0.98  # a further pass is made where some width shrinks below this share
_HALF = 0.5  # and what is seen is found anew where some width shrinks below this share
_HALF_TURN = "the rotation is known too badly"


@dataclass(frozen=True)
class View:
    """What the stages need: what is seen, and what makes contractors of networks."""

    sight: Sight
    contractor: Callable[[ConstraintNetwork], Contractor]

    def part(self, chosen: Indices) -> View:
        """Of some of the dots."""
        return View(self.sight.part(chosen), self.contractor)


def contractor_of(names: Sequence[str]) -> Callable[[ConstraintNetwork], Contractor]:
    """What makes the named contractors, one after the other, for any network; the names are looked up once."""
    factories = [plugins.load(name) for name in names]

    def build(network: ConstraintNetwork) -> Contractor:
        parts = [factory(network, objective=None, arithmetic="float64") for factory in factories]
        return in_sequence(parts)

    return build


def enclosed(view: View) -> Found:
    """All poses that satisfy all of a view, about their middle."""
    start = first_box(view)
    return contracted(view, start) if isinstance(start, PoseBox) else start


def first_box(view: View) -> Found:
    """From the homography alone."""
    seen = view.sight.anywhere()
    motions = seen if isinstance(seen, str) else first_motions(view.sight, seen, view.contractor)
    return box_of(view, motions) if isinstance(motions, Motions) else motions


def box_of(view: View, motions: Motions) -> PoseBox | str:
    """Motions of the target in the camera frame as poses about their middle."""
    moved = view.sight.frames.mobile_in_base(motions)
    left, _, right = np.linalg.svd(moved.rotation.mid)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return pose_box(moved, Pose(moved.position.mid, quaternion_from_matrix(turn))) or _HALF_TURN


def contracted(view: View, box: PoseBox) -> Found:
    """What the constraints leave of a box, about its new middle."""
    seen, known = view.sight.about(box), box.unknowns.width
    for _ in range(_PASSES):
        before = box.unknowns
        if shrunk(known, before.width, _HALF):  # what was seen about a larger box holds for this one
            seen, known = view.sight.about(box), before.width
        if isinstance(seen, str):
            return seen
        rows = pose_rows(view.sight, seen, box, before)
        after = view.contractor(rows.network(before)).contract(rows.unknowns(before)).box
        if after.is_empty:
            return None
        narrower = box.with_unknowns(after)
        moved = narrower.about(narrower.middle)
        if moved is None:
            return _HALF_TURN
        box = moved
        if not shrunk(before.width, after.width[:6], _PAYS):
            break
    return box
