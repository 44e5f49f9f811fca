"""Robots whose dimensions are published, each with its source. A user's own robot stands in a campaign.toml.

Frames and units are cpcal's: mm, the pose maps the mobile frame to the base frame. What was changed to get there is
said with each robot.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Value, frozen_array
from cpcal.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class PoseRange(Value):
    """A box of poses: where a robot is measured when its legs cannot simply be commanded.

    low, high  (3,) mm, the position P in the base frame
    turn       (3,) rad, the largest components of the rotation vector, both signs

    A coordinate whose range is a single number is fixed: it does not vary, and is known without error.
    InputError where a range is empty or not finite.
    """

    low: Floats
    high: Floats
    turn: Floats

    def __post_init__(self) -> None:
        for name in ("low", "high", "turn"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        bounds = self.bounds if all(a.shape == (3,) for a in (self.low, self.high, self.turn)) else None
        if bounds is None or not np.isfinite(bounds).all() or (bounds[0] > bounds[1]).any():
            remedy = "give low <= high (3,) in mm and turn >= 0 (3,) in rad"
            raise InputError([Problem("workspace", "is no box of poses", remedy)])

    @property
    def bounds(self) -> Floats:
        """(2, 6): least and largest x, y, z (mm) and components of the rotation vector (rad)."""
        return np.stack([np.concatenate([self.low, -self.turn]), np.concatenate([self.high, self.turn])])

    @property
    def free(self) -> npt.NDArray[np.bool_]:
        """(6,): which of them vary."""
        low, high = self.bounds
        return np.asarray(low < high)


@dataclass(frozen=True)
class KnownRobot:
    """A robot of the catalogue.

    robot      its nominal dimensions
    source     where they are published, and what was changed
    stroke     mm, shortest and longest reading of a leg
    workspace  the poses to measure; None where six legs are commanded to readings within the stroke
    """

    robot: Robot
    source: str
    stroke: tuple[float, float]
    workspace: PoseRange | None = None


# The paper's Table 1: a_x a_y a_z b_x b_y b_z l, in mm. Legs run from 345 to 485 mm: readings from 0 to 140.
DELTALAB = Robot.from_parameters(
    "DeltaLab Table of Stewart",
    [
        [-223.1792, -151.9573, 0.0, -19.9938, -193.9723, 0.0, 345.0],
        [223.1792, -151.9573, 0.0, 19.9938, -193.9723, 0.0, 345.0],
        [243.1885, -117.3002, 0.0, 177.9818, 79.6710, 0.0, 345.0],
        [20.0093, 269.2575, 0.0, 157.9880, 114.3013, 0.0, 345.0],
        [-20.0093, 269.2575, 0.0, -157.9880, 114.3013, 0.0, 345.0],
        [-243.1885, -117.3002, 0.0, -177.9818, 79.6710, 0.0, 345.0],
    ],
)

_RUBIN_LOWER = [
    [-227.647, 653.753, 0.0],
    [227.647, 653.753, 0.0],
    [679.990, -129.728, 0.0],
    [452.343, -524.025, 0.0],
    [-452.343, -524.025, 0.0],
    [-679.990, -129.728, 0.0],
]
_RUBIN_UPPER = [  # less the height of their plane, 403.918 mm, which is the pose's z when the hexapod is at rest
    [-472.917, 512.146, 0.0],
    [472.917, 512.146, 0.0],
    [679.990, 153.485, 0.0],
    [207.073, -665.631, 0.0],
    [-207.073, -665.631, 0.0],
    [-679.990, 153.485, 0.0],
]
_RUBIN_HEIGHT = 403.918

_COGIRO_FRAME = [
    [-7177.5, -5436.1, 5391.1],
    [-7459.4, -5150.4, 5399.9],
    [-7391.1, 5194.0, 5397.6],
    [-7102.6, 5475.3, 5409.4],
    [7239.8, 5375.9, 5409.3],
    [7520.8, 5085.1, 5420.0],
    [7446.1, -5253.9, 5387.4],
    [7160.8, -5534.2, 5397.3],
]
_COGIRO_PLATFORM = [
    [503.2, -492.8, 0.0],
    [-509.7, 350.8, 997.6],
    [-503.2, -270.0, 0.0],
    [496.0, 356.1, 999.6],
    [-503.2, 492.8, 0.0],
    [499.8, -340.4, 999.1],
    [502.1, 275.0, -0.7],
    [-504.5, -346.3, 997.6],
]

_PLANAR_BASE = [[600.0, 1039.230484541327, 0.0], [0.0, 0.0, 0.0], [1200.0, 0.0, 0.0]]
_PLANAR_PLATFORM = [
    [-0.066580445834, 106.954081945581, 0.0],
    [-92.751709777083, -53.477040972790, 0.0],
    [92.818290222917, -53.477040972790, 0.0],
]


def _rubin() -> Robot:
    lower, upper = np.array(_RUBIN_LOWER), np.array(_RUBIN_UPPER)
    at_rest = np.linalg.norm(upper + [0.0, 0.0, _RUBIN_HEIGHT] - lower, axis=1)
    return Robot("Rubin Observatory camera hexapod", lower, upper, at_rest)


ROBOTS: dict[str, KnownRobot] = {
    "deltalab": KnownRobot(
        DELTALAB,
        "Daney, Andreff, Chabert, Papegay: Interval method for calibration of parallel robots: vision-based "
        "experiments. Mechanism and Machine Theory 41 (2006), Table 1.",
        (0.0, 140.0),
    ),
    "rubin-camera": KnownRobot(
        _rubin(),
        "Joint centres: CAMERA HEXAPOD STRUT FLEXURE COORDINATES.xlsx in the folder doc of github.com/lsst-ts/"
        "ts_mthexapod (received 2020-02-13, as constants.py there says); actuator limits of 14.1 mm: constants.py. "
        "Made by Moog CSA Engineering (Sneed and others: Final design of the LSST hexapods and rotator, 2014). "
        "Readings are changes of length from rest, as its controller gives them; the mobile frame lies in the plane "
        "of the upper joints.",
        (-14.1, 14.1),
    ),
    "cogiro": KnownRobot(
        Robot("CoGiRo cable robot", np.array(_COGIRO_FRAME), np.array(_COGIRO_PLATFORM), np.zeros(8)),
        "LIRMM and Tecnalia: Cable-suspended parallel robot CoGiRo (2016), and the model CoGiRo, in "
        "github.com/darwinlau/CASPR, in metres there. Readings are whole cable lengths; the poses to measure are "
        "a choice of cpcal's inside the frame.",
        (0.0, 20_000.0),
        PoseRange(np.array([-4000.0, -3000.0, 1000.0]), np.array([4000.0, 3000.0, 3000.0]), np.array([0.2, 0.2, 0.3])),
    ),
    "planar-3rpr": KnownRobot(
        Robot("Planar 3-RPR robot", np.array(_PLANAR_BASE), np.array(_PLANAR_PLATFORM), np.zeros(3)),
        "Kotlarski, Heimann, Ortmaier: Influence of kinematic redundancy on the singularity-free workspace of "
        "parallel kinematic machines. Frontiers of Mechanical Engineering 7 (2012), with the redundant joints locked; "
        "the numbers are those of the optimisation library Mantella (ParallelKinematicMachine3PRPR), in metres there. "
        "z, and the tilts about x and y, are fixed; the poses to measure are a choice of cpcal's.",
        (100.0, 1200.0),
        PoseRange(np.array([400.0, 150.0, 0.0]), np.array([800.0, 550.0, 0.0]), np.array([0.0, 0.0, 0.5])),
    ),
}


def known_robot(name: str) -> KnownRobot:
    """The robot in the catalogue as `name` (in any case); InputError lists those there are."""
    try:
        return ROBOTS[name.casefold()]
    except KeyError:
        near = difflib.get_close_matches(name.casefold(), ROBOTS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else "choose one of " + ", ".join(map(repr, ROBOTS))
        raise InputError([Problem("robot", f"there is no robot called {name!r}", hint)]) from None
