"""What an accuracy certificate says, as plain values: what is assumed, what is proved, what is estimated, apart.

`AssumedError` is assumed, `ProvedPose` and `ProvedCell` are proved under it, `Estimated` is neither. Lengths in mm,
angles in rad.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cpcal.files.codec import INFORMED, checked, load, save
from cpcal.questions import CampaignNote
from cpcal.robot import rotation_vector

FORMAT = "cpcal-accuracy/5"
ACCURACY_NAME = "accuracy.json"


@dataclass(frozen=True)
class AssumedError:
    """ASSUMED: some parameters of the leg satisfy its equation to within `eps` at the calibration poses, each for some
    reading in its set, and at every pose that is spoken of.

    `stated`: the user gave eps; else it was suggested by `growth`: least errors, readings as they are, of so many
    `poses`. `refuted_below`: proved, the campaign allows no smaller eps.
    """

    leg: int
    eps: float
    stated: bool
    refuted_below: float
    poses: tuple[int, ...]
    growth: tuple[float, ...]


@dataclass(frozen=True)
class CertifiedBox:
    """PROVED, by the `certificate`: all parameters (a, b, l) of the leg with a model error up to `eps` lie from `lo` to
    `hi`, mm; both are empty where there are none."""

    leg: int = field(metadata=checked("the certificate: each leg once"))
    eps: float = field(metadata=checked("the cap of the certificate"))
    lo: tuple[float, ...] = field(metadata=checked("the enclosure of the certificate"))
    hi: tuple[float, ...] = field(metadata=checked("the enclosure of the certificate"))
    certificate: str = field(metadata=checked("a file of the folder, which is accepted"))


@dataclass(frozen=True)
class Estimated:
    """Estimates for one pose, which prove nothing. `u_position`, `u_rotation`: expanded uncertainty with k = 2 of the
    least-squares fit. `true_position`, `true_rotation`: the simulator's own error; None where the truth is not known.
    """

    u_position: float
    u_rotation: float
    true_position: float | None = None
    true_rotation: float | None = None


_AGAIN = "computed again from the claims of the certificates"


@dataclass(frozen=True)
class PoseAccuracy:
    """One pose (P, R) that the controller commands.

    PROVED under the assumption, where `proved`: every pose `within` the box that was asked for which the legs allow is
    P + p, R(1, s) R with (p, 2 s) in `lo`, `hi` (6 each), ||p|| <= `position_bound` and the angle at most
    `rotation_bound`; infinite where nothing is proved. `shares`: to first order, by how much what is not known of each
    leg can move the platform. `beyond`: a leg's length at this pose lies outside of those that were measured.
    """

    name: str = field(metadata=INFORMED)
    position: tuple[float, float, float] = field(metadata=checked("the form of this pose in each certificate"))
    quaternion: tuple[float, float, float, float] = field(metadata=checked("the form in each certificate"))
    proved: bool = field(metadata=checked("`lo` to `rotation_bound` are proved"))
    lo: tuple[float, ...] = field(metadata=checked(_AGAIN, "proved"))
    hi: tuple[float, ...] = field(metadata=checked(_AGAIN, "proved"))
    position_bound: float = field(metadata=checked(_AGAIN, "proved"))
    rotation_bound: float = field(metadata=checked(_AGAIN, "proved"))
    shares: tuple[float, ...] = field(metadata=INFORMED)
    beyond: bool = field(metadata=INFORMED)
    estimated: Estimated = field(metadata=INFORMED)

    @property
    def rotation(self) -> tuple[float, float, float]:
        """As a rotation vector."""
        x, y, z = rotation_vector(np.array(self.quaternion)).tolist()
        return x, y, z

    @property
    def violated(self) -> bool:
        """Whether the simulator's truth lies outside of what is proved: then the assumption does not hold."""
        e = self.estimated
        if e.true_position is None or e.true_rotation is None or not self.proved:
            return False
        return e.true_position > self.position_bound or e.true_rotation > self.rotation_bound


@dataclass(frozen=True)
class CellAccuracy:
    """All poses P, R(1, S) with (P, 2 S) between `lo` and `hi`. PROVED as in PoseAccuracy, where `proved`."""

    lo: tuple[float, ...]
    hi: tuple[float, ...]
    proved: bool
    position_bound: float
    rotation_bound: float
    shares: tuple[float, ...]


@dataclass(frozen=True)
class WorkspaceAccuracy:
    """Cells that cover a workspace. `worst_pose` (6,) is one whose own bound is `worst_pose_bound`, the largest met;
    `complete`: the bound of all cells is within the gap asked for of it."""

    lo: tuple[float, ...]
    hi: tuple[float, ...]
    cells: tuple[CellAccuracy, ...]
    worst_pose: tuple[float, ...]
    worst_pose_bound: float
    complete: bool

    @property
    def left_out(self) -> tuple[CellAccuracy, ...]:
        """Cells of which nothing is proved."""
        return tuple(cell for cell in self.cells if not cell.proved)

    @property
    def position_bound(self) -> float:
        """PROVED under the assumption for every pose in the cells that are not left out."""
        return max((cell.position_bound for cell in self.cells if cell.proved), default=math.inf)

    @property
    def rotation_bound(self) -> float:
        """Likewise."""
        return max((cell.rotation_bound for cell in self.cells if cell.proved), default=math.inf)


@dataclass(frozen=True)
class NextPose:
    """A pose that would narrow what is not known most, and the worst bound expected then, mm: an estimate."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    by: str
    expected: float


@dataclass(frozen=True)
class Accuracy:
    """The answer: of which campaign and controller (a name, and (n, 7) parameters), under which assumptions.

    The parameters that are spoken of lie within `delta` mm of the center of the run, the poses `within` so many mm and
    rad (each component of a rotation vector) of those that are commanded."""

    campaign: CampaignNote
    version: str = field(metadata=INFORMED)
    controller: str = field(metadata=INFORMED)
    parameters: tuple[tuple[float, ...], ...] = field(metadata=checked("the forms of the certificates"))
    delta: float = field(metadata=checked("the box of each certificate"))
    within: tuple[float, float] = field(metadata=checked("what is computed again begins with it"))
    assumed: tuple[AssumedError, ...] = field(metadata=INFORMED)
    boxes: tuple[CertifiedBox, ...]  # around the sets of parameters
    # legs for which the campaign refutes what is assumed: nothing else is said then
    refuted: tuple[int, ...] = field(metadata=checked("the certificates that claim that there are no parameters"))
    poses: tuple[PoseAccuracy, ...]
    workspace: WorkspaceAccuracy | None = field(metadata=INFORMED)
    next_poses: tuple[NextPose, ...] = field(metadata=INFORMED)
    truth_known: bool = field(metadata=INFORMED)
    seconds: float = field(metadata=INFORMED)

    @property
    def proved_poses(self) -> tuple[PoseAccuracy, ...]:
        return tuple(pose for pose in self.poses if pose.proved)

    @property
    def worst_pose(self) -> PoseAccuracy | None:
        """Of the poses, that with the largest proved bound."""
        return max(self.proved_poses, key=lambda pose: pose.position_bound, default=None)

    @property
    def violated(self) -> tuple[PoseAccuracy, ...]:
        return tuple(pose for pose in self.poses if pose.violated)


def save_accuracy(found: Accuracy, folder: str | os.PathLike[str]) -> Path:
    """Write `accuracy.json` into the folder, all or nothing; its path. Raises InputError."""
    return save(found, Path(folder) / ACCURACY_NAME, FORMAT)


def load_accuracy(folder: str | os.PathLike[str]) -> Accuracy:
    """Read `accuracy.json` from the folder. Raises InputError."""
    return load(Accuracy, Path(folder) / ACCURACY_NAME, FORMAT, remedy="run cpcal accuracy again")
