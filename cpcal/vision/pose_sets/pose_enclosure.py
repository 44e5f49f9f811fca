"""The stages of `pose_set`: dots seen through pyramids, a first box of poses, and what the constraints leave of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.robot import Pose, quaternion_from_matrix
from cpcal.solver import plugins
from cpcal.solver.contract import Contractor, in_sequence, shrunk
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.model import Network
from cpcal.solver.network import ConstraintNetwork
from cpcal.vision.pose_sets.pose_rows import Frames, PoseBox, pose_box, pose_rows
from cpcal.vision.pose_sets.proved_homography import Motions, first_motions
from cpcal.vision.pose_sets.pyramid import Pyramids

Found = PoseBox | str | None  # what holds all poses; or why nothing is known; or that there are none

_PASSES = 8
_PAYS = 0.98  # a further pass is made where some width shrinks below this share
_HALF_TURN = "the rotation is known too badly"


@dataclass(frozen=True)
class View:
    """What the stages need.

    dots        (m, 2) mm in the target frame, and their pyramids
    points      (m, 3) mm, the dots in the mobile frame
    contractor  makes contractors of networks
    """

    dots: Floats
    pyramids: Pyramids
    frames: Frames
    points: IntervalArray
    contractor: Callable[[ConstraintNetwork], Contractor]

    def part(self, chosen: Indices) -> View:
        """Of some of the dots."""
        seen = Pyramids(self.pyramids.planes[chosen], self.pyramids.lo[chosen], self.pyramids.hi[chosen])
        return View(self.dots[chosen], seen, self.frames, self.points[chosen], self.contractor)


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
    motions = first_motions(view.dots, view.pyramids, view.contractor)
    if not isinstance(motions, Motions):
        return motions
    moved = view.frames.mobile_in_base(motions)
    left, _, right = np.linalg.svd(moved.rotation.mid)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return pose_box(moved, Pose(moved.position.mid, quaternion_from_matrix(turn))) or _HALF_TURN


def contracted(view: View, box: PoseBox) -> Found:
    """What the constraints leave of a box, about its new middle."""
    for _ in range(_PASSES):
        before = box.unknowns
        after = view.contractor(pose_network(view, box, before)).contract(before).box
        if after.is_empty:
            return None
        narrower = box.with_unknowns(after)
        moved = narrower.about(narrower.middle)
        if moved is None:
            return _HALF_TURN
        box = moved
        if not shrunk(before.width, after.width, _PAYS):
            break
    return box


def pose_network(view: View, box: PoseBox, unknowns: Box) -> Network:
    """The constraints on a box of (W, s) about the centre of the poses."""
    return pose_rows(view.pyramids.planes, view.points, view.frames, box.center, unknowns).network(unknowns)
