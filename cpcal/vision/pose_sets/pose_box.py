"""Boxes of poses about a centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.robot import Pose, normalised, quaternion_conjugate, quaternion_product
from cpcal.solver.interval import Box, IntervalArray
from cpcal.vision.pose_sets.enclosed import ENGINE, exact, half_vector, joined, rotation, transposed
from cpcal.vision.pose_sets.enclosed import quaternion_product as enclosed_product
from cpcal.vision.pose_sets.pose_frames import Motions

NAMES = ("W[0]", "W[1]", "W[2]", "s[0]", "s[1]", "s[2]")


@dataclass(frozen=True)
class PoseBox:
    """Poses P, R = R(1, s) R(q0) with P - P0 in `position` (3,) mm and s in `half_turn` (3,), q0 and P0 of `center`."""

    center: Pose
    position: IntervalArray
    half_turn: IntervalArray

    @property
    def unknowns(self) -> Box:
        """A box of (W, s) that holds all of its poses."""
        both = joined([ENGINE.mul(self.position, stretch(self.half_turn)), self.half_turn])
        return Box(NAMES, both.lo, both.hi)

    def with_unknowns(self, box: Box) -> PoseBox:
        """The poses of a box of (W, s), and perhaps more unknowns, about the same centre."""
        s = box.array[3:6]
        return PoseBox(self.center, ENGINE.div(box.array[:3], stretch(s)), s)

    def about(self, center: Pose) -> PoseBox | None:
        """A box that holds all of its poses about another centre; None where a half-turn may lie between."""
        e = ENGINE
        between = enclosed_product(exact(self.center.quaternion), exact(quaternion_conjugate(center.quaternion)))
        turned = enclosed_product(joined([exact([1.0]), self.half_turn]), between)
        if turned.lo[0] <= 0.0 <= turned.hi[0]:
            return None
        shift = e.sub(exact(self.center.position), exact(center.position))
        return PoseBox(center, e.add(self.position, shift), e.div(turned[1:], turned[0]))

    @property
    def middle(self) -> Pose:
        """The pose in its middle, as floats: a unit quaternion to rounding."""
        turn = np.concatenate([[1.0], self.half_turn.mid])
        quaternion = normalised(quaternion_product(turn, self.center.quaternion))
        return Pose(self.center.position + self.position.mid, quaternion)


def stretch(s: IntervalArray) -> IntervalArray:
    """1 + s.s"""
    return ENGINE.add(exact(1.0), ENGINE.sum(ENGINE.sqr(s), -1))


def pose_box(motions: Motions, center: Pose) -> PoseBox | None:
    """The motions as a box about a centre; None where a half-turn may lie between."""
    away = ENGINE.dot(motions.rotation, transposed(rotation(center.quaternion)))
    s = half_vector(away)
    return None if s is None else PoseBox(center, ENGINE.sub(motions.position, exact(center.position)), s)
