"""Studies: what the paper's experiment delivers (sections 2.2 to 3.3), before the frames are known.

A camera sees a target on the mobile platform; neither the camera's place beside the base nor the target's place on
the platform is known. One table of poses serves calibration, another one validation. A study is a value: arrays are
private copies and read-only. cpcal.files has the files (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cpcal.common.errors import InputError, Problem, Problems
from cpcal.common.values import Floats, Value, fill, frozen_array, frozen_mapping
from cpcal.robot.campaign import provenance_problems, table_problems
from cpcal.robot.kinematics import Pose, compose, inverse
from cpcal.robot.robot import Robot

_ARRAYS = ("position", "quaternion", "length")


@dataclass(frozen=True, eq=False)
class PoseTable(Value):
    """N rows: the target frame seen in the camera frame, and the readings of n legs.

    pose, run   N names each: a configuration of the legs, and which of its repetitions
    position    (N, 3) mm; quaternion (N, 4) unit, scalar first: `x_camera = P + R(q) x_target`
    length      (N, n) mm, the readings L
    image       N names, or None where there is one row for each pose and run; the names of a row are unique
    shared      (N, 6) standard deviations, mm and rad (rotation vector in the camera frame), of that part of a pose's
                error which camera and target make: the same in all rows, so that no mean is free of it; None: no part

    Raises InputError, with every problem found, when the values make no table.
    """

    pose: tuple[str, ...]
    run: tuple[str, ...]
    position: Floats
    quaternion: Floats
    length: Floats
    image: tuple[str, ...] | None = None
    shared: Floats | None = None

    def __post_init__(self) -> None:
        arrays = [name for name in (*_ARRAYS, "shared") if getattr(self, name) is not None]
        fill(self, **{name: frozen_array(getattr(self, name)) for name in arrays})
        names = {name: tuple(some) for name in ("pose", "run", "image") if (some := getattr(self, name)) is not None}
        fill(self, **names)
        legs = self.length.shape[1] if self.length.ndim == 2 else 1
        widths = zip(_ARRAYS, (3, 4, max(legs, 1)), strict=True)
        deviations = {} if self.shared is None else {"shared deviation": (self.shared, 6)}
        values = {name: (getattr(self, name), width) for name, width in widths}
        Problems(table_problems("table", "row", names, values, deviations)).raise_any()

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return int(self.length.shape[1])

    @property
    def row_ids(self) -> list[str]:
        """`pose/run` of every row, or `pose/run/image`."""
        columns = (self.pose, self.run) if self.image is None else (self.pose, self.run, self.image)
        return ["/".join(names) for names in zip(*columns, strict=True)]

    @property
    def seen(self) -> Pose:
        """The poses (N) of the target frame in the camera frame."""
        return Pose(self.position, self.quaternion)

    def __len__(self) -> int:
        """The number of rows, N."""
        return len(self.pose)

    def __repr__(self) -> str:
        return f"<PoseTable: {len(self)} rows of {len(set(self.pose))} poses, {self.legs} legs>"


@dataclass(frozen=True, eq=False)
class Truth(Value):
    """What only a simulation knows.

    seed        of everything random in it
    robot       the true parameters, in the base frame and the mobile frame
    camera      the base frame seen in the camera frame: `x_camera = P + R x_base`, mm
    target      the target frame seen in the mobile frame: `x_mobile = P + R x_target`, mm
    """

    seed: int
    robot: Robot
    camera: Pose
    target: Pose

    def __post_init__(self) -> None:
        for name in ("camera", "target"):
            pose: Pose = getattr(self, name)
            fill(self, **{name: Pose(frozen_array(pose.position), frozen_array(pose.quaternion))})

    def mobile_in_base(self, table: PoseTable) -> Pose:
        """The poses (N) of the mobile frame in the base frame that the table's poses mean."""
        return compose(compose(inverse(self.camera), table.seen), inverse(self.target))


@dataclass(frozen=True, eq=False)
class Study(Value):
    """A robot's drawing and two tables of poses that a camera saw; use `load_study` or `simulate_study`.

    robot        nominal: joint centres in the base frame and in the mobile frame, mm
    calibration  the poses to fit to
    validation   the poses to judge the fit by
    truth        None where the study was measured
    provenance   free text

    Raises InputError when the tables do not have the robot's number of legs.
    """

    robot: Robot
    calibration: PoseTable
    validation: PoseTable
    truth: Truth | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        fill(self, provenance=frozen_mapping(self.provenance))
        problems = []
        for name in ("calibration", "validation"):
            found = getattr(self, name).legs
            if found != self.robot.legs:
                what = f"has readings of {found} legs, and the robot has {self.robot.legs}"
                problems.append(Problem(f"study {name}", what, "give one reading for each leg"))
        if self.truth is not None and self.truth.robot.legs != self.robot.legs:
            problems.append(Problem("study truth", "has another number of legs", "give as many as the robot has"))
        problems += provenance_problems("study", self.provenance)
        if problems:
            raise InputError(problems)

    def __repr__(self) -> str:
        rows = f"{len(self.calibration)} + {len(self.validation)} rows"
        return f"<Study of {self.robot.name!r}: {rows}, {self.robot.legs} legs>"
