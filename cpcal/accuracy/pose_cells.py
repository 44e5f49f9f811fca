"""Cells of the workspace: all poses P + p, R(1, s) R(q) with (p, s) in a box around 0. A pose is a cell of no size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.accuracy.vectors import ENGINE, applied, cross, dot, joined, norm, point, product, rotation, total, turned
from cpcal.common.arrays import Floats
from cpcal.robot import Pose
from cpcal.solver.interval import IntervalArray


@dataclass(frozen=True, eq=False)
class Cells:
    """K cells: `center` holds K poses, exact numbers (R(q) divides by |q|^2); `reach` (K, 6) the boxes of (p, s)."""

    center: Pose
    reach: IntervalArray

    @classmethod
    def of_poses(cls, poses: Pose) -> Cells:
        """Each of K poses as a cell."""
        position, quaternion = np.atleast_2d(poses.position), np.atleast_2d(poses.quaternion)
        return cls(Pose(position, quaternion), point(np.zeros((len(position), 6))))

    @classmethod
    def of_boxes(cls, boxes: IntervalArray) -> Cells:
        """Boxes (K, 6) of (P, S): the poses P, R(1, S), P in mm and 2 S the rotation vector to second order."""
        middle = boxes.mid
        quaternion = np.concatenate([np.ones((len(middle), 1)), middle[:, 3:]], axis=1)
        away = ENGINE.sub(boxes, point(middle))
        c, d = point(middle[:, 3:]), away[:, 3:]
        # (1, c + d) (1, -c), divided by its scalar part: R(1, c + d) = R(1, s) R(1, c)
        scalar = ENGINE.add(ENGINE.add(point(1.0), total(ENGINE.sqr(c))), dot(c, d))
        s = ENGINE.div(ENGINE.sub(d, cross(d, c)), scalar[:, None])
        return cls(Pose(middle[:, :3], quaternion), joined([away[:, :3], s]))

    def __len__(self) -> int:
        return len(self.reach.lo)

    def __getitem__(self, rows: Floats) -> Cells:
        pose = Pose(self.center.position[rows], self.center.quaternion[rows])
        return Cells(pose, self.reach[rows])

    @property
    def centers(self) -> Cells:
        """The poses at the centers, alone."""
        return Cells(self.center, point(np.zeros(self.reach.shape)))


@dataclass(frozen=True, eq=False)
class LegVectors:
    """For K cells and n legs of the controller, over all poses of each cell: enclosures.

    rotation (K, 1, 3, 3): R. arm (K, n, 3): R b^. vector (K, n, 3): v = P + R b^ - a^, mm. length (K, n): ||v||.
    """

    rotation: IntervalArray
    arm: IntervalArray
    vector: IntervalArray
    length: IntervalArray


def leg_vectors_over(cells: Cells, controller: Floats) -> LegVectors:
    """The vectors of the controller's legs (n, 7)."""
    turn = product(turned(cells.reach[:, 3:]), rotation(point(cells.center.quaternion)))[:, None]
    arm = applied(turn, point(controller[None, :, 3:6]))
    position = ENGINE.add(point(cells.center.position), cells.reach[:, :3])
    vector = ENGINE.sub(ENGINE.add(position[:, None], arm), point(controller[None, :, :3]))
    return LegVectors(turn, arm, vector, norm(vector))
