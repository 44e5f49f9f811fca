"""What a campaign states, as the search for mistakes sees it: a drawing, poses and readings that should agree."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.robot.campaign import Campaign
from cpcal.robot.kinematics import Pose, leg_vectors
from cpcal.robot.robot import LARGEST, Robot


@dataclass(frozen=True, eq=False)
class Given:
    """A robot, N poses and the readings (N, n) mm of its legs. All may be wrong."""

    robot: Robot
    pose: Pose
    length: Floats

    @classmethod
    def of(cls, campaign: Campaign) -> Given:
        return cls(campaign.robot, Pose(campaign.position, campaign.quaternion), campaign.length)

    def sampled(self, most: int) -> Given:
        """At most so many of its rows, spread evenly."""
        count = len(self.length)
        return self if count <= most else self.rows(np.linspace(0, count - 1, most).astype(np.intp))

    def rows(self, chosen: npt.NDArray[np.intp]) -> Given:
        pose = Pose(self.pose.position[chosen], self.pose.quaternion[chosen])
        return replace(self, pose=pose, length=self.length[chosen])

    def posed(self, position: Floats, quaternion: Floats) -> Given:
        return replace(self, pose=Pose(position, quaternion))

    def read(self, length: Floats) -> Given:
        return replace(self, length=length)

    def drawn(self, parameters: Floats) -> Given:
        """With another drawing, (n, 7) mm; absurd numbers are cut, so that any can be tried."""
        cut = np.clip(parameters, -LARGEST, LARGEST)
        return replace(self, robot=Robot.from_parameters(self.robot.name, cut))

    @property
    def nominal(self) -> Floats:
        """(N, n) mm, the leg lengths that the drawing and the poses give."""
        return np.asarray(np.linalg.norm(leg_vectors(self.robot, self.pose), axis=-1))

    @property
    def share(self) -> Floats:
        """(N, n): |nominal residual| / nominal leg length."""
        nominal = self.nominal
        off = np.abs(nominal - self.robot.offset - self.length)
        return np.asarray(off / np.maximum(nominal, np.finfo(np.float64).tiny))

    @property
    def typical(self) -> float:
        """The share's median over the measurements, of the worst leg: a few odd rows do not move it."""
        return float(np.median(self.share, axis=0).max())

    @property
    def most(self) -> float:
        """The share that four fifths of the measurements do not exceed, of the worst leg: to tell causes by."""
        return float(np.quantile(self.share, 0.8, axis=0).max())
