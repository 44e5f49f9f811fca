"""The drawing of a parallel robot: joint centres and length offsets (the paper's 7 parameters a leg)."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem, Problems, shown, unusable
from cpcal.common.files import NAME_REMEDY, is_name
from cpcal.common.values import Floats, Value, fill, frozen_array

_UNIT = 1e-6  # tolerance on the norm of an axis
LARGEST = 1e12  # mm: no robot is larger, and no square of such a number overflows


def good_numbers(values: Floats) -> npt.NDArray[np.bool_]:
    """Which numbers are finite and of a size that makes sense in mm."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) <= LARGEST)


@dataclass(frozen=True, eq=False)
class Robot(Value):
    """n legs; leg i joins `base[i]` to `mobile[i]` and is `offset[i]` + reading long (the paper, eq. 1).

    base    (n, 3) mm, base joint centres a, in the base frame
    mobile  (n, 3) mm, mobile joint centres b, in the mobile frame
    offset  (n,)   mm, length offsets l

    The arrays are copied and read-only. Raises InputError when the shapes disagree or a value is not finite.
    """

    name: str
    base: Floats
    mobile: Floats
    offset: Floats

    def __post_init__(self) -> None:
        problems = frozen_rows(self, "robot", {"base": 3, "mobile": 3, "offset": 1}, self.base)
        if not is_name(self.name):
            problems.append(Problem("robot name", f"is {shown(self.name)}", NAME_REMEDY))
        if problems:
            raise InputError(problems)

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return len(self.offset)

    @property
    def parameters(self) -> Floats:
        """(n, 7) mm: one row `a_x a_y a_z b_x b_y b_z l` a leg, as in the paper's tables."""
        return np.concatenate([self.base, self.mobile, self.offset[:, None]], axis=1)

    @classmethod
    def from_parameters(cls, name: str, parameters: npt.ArrayLike) -> Robot:
        """The robot of an (n, 7) array of rows `a_x a_y a_z b_x b_y b_z l`, mm."""
        rows = np.asarray(parameters, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 7:
            what = f"have the shape {rows.shape}"
            raise unusable("robot parameters", what, "give one row of 7 numbers a leg")
        return cls(name, rows[:, :3], rows[:, 3:6], rows[:, 6])


Widths = Mapping[str, int | None]  # of fields: how many numbers each leg has; None: one number for the whole robot


def frozen_rows(value: Value, where: str, widths: Widths, rows: npt.ArrayLike) -> list[Problem]:
    """Freeze the fields of a value while it is made, and what is wrong with them; `rows` has one row for each leg."""
    problems = []
    for name, width in widths.items():
        try:
            array = frozen_array(getattr(value, name))
        except (TypeError, ValueError) as error:
            problems.append(Problem(f"{where} {name}", f"is not an array of numbers ({error})", "give numbers, mm"))
        else:
            fill(value, **{name: float(array) if width is None and array.ndim == 0 else array})
    if problems:
        return problems
    legs = np.shape(rows)[0] if np.ndim(rows) else 0
    for name, width in widths.items():
        held = np.asarray(getattr(value, name))
        shape = () if width is None else (legs,) if width == 1 else (legs, width)
        if held.shape != shape or not legs:
            remedy = f"give an array of the shape {shape}" if legs else "give one row for each of n >= 1 legs"
            problems.append(Problem(f"{where} {name}", f"has the shape {held.shape}", remedy))
        elif (wrong := wrong_value(name, held)) is not None:
            problems.append(Problem(f"{where} {name}", *wrong))
    return problems


def wrong_value(name: str, value: npt.ArrayLike) -> tuple[str, str] | None:
    """What is wrong with a field's values of the right shape, and the remedy; None when they are good."""
    array = np.asarray(value, dtype=np.float64)
    if not good_numbers(array).all():
        return f"holds a number that is NaN, infinite or above {LARGEST:g}", "give a number that makes sense, in mm"
    if name.endswith("_axis") and (np.abs(np.linalg.norm(array, axis=-1) - 1.0) > _UNIT).any():
        return "holds an axis whose norm is not 1", "give unit vectors"
    if name == "gain" and (array <= -1.0).any():
        return "holds a gain of -1 or less", "give relative errors, such as 0.001"
    if name in ("backlash", "friction", "sag", "joint_error") and (array < 0.0).any():
        return "holds a negative number", "give numbers >= 0"
    return None


# ------------------------------------------------------------------------------------------------------------------
# How far readings may be off, as a campaign declares it for all its measurements.

KINDS = ("position", "rotation", "length")
EXACT_OR_NOT = (
    "write in [uncertainty] either factor = 3 with position_sigma, rotation_sigma and length_sigma, "
    "or position_half_width, rotation_half_width and length_half_width, or exact = true"
)


def sizes(values: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Which values are good half-widths: not negative, and no larger than any robot."""
    array = np.asarray(values, dtype=np.float64)
    return good_numbers(array) & (array >= 0)


@dataclass(frozen=True, eq=False)
class Uncertainty(Value):
    """`half-width = factor * value`; the values are standard deviations, or half-widths if `factor` is None.

    position (3,) mm; rotation (3,) rad, rotation vector in the base frame; length (n,) mm. Raises
    InputError when a shape is wrong or a number is negative or not finite.
    """

    position: Floats
    rotation: Floats
    length: Floats
    factor: float | None = None

    def __post_init__(self) -> None:
        problems = []
        for kind in KINDS:
            array = frozen_array(getattr(self, kind))
            fill(self, **{kind: array})
            if array.ndim != 1 or (kind != "length" and array.shape != (3,)):
                what = f"has the shape {array.shape}"
                problems.append(Problem(f"uncertainty {kind}", what, "give 3, 3 and as many as there are legs"))
            elif not sizes(array).all():
                what = f"holds a number that is negative, not finite or above {LARGEST:g}"
                problems.append(Problem(f"uncertainty {kind}", what, "give finite numbers >= 0"))
        if self.factor is not None and not sizes(self.factor):
            problems.append(Problem("uncertainty factor", f"is {self.factor}", "give a finite number >= 0"))
        if not problems and not sizes(self.half_widths).all():
            problems.append(Problem("uncertainty", f"factor * sigma is above {LARGEST:g}", "give smaller numbers"))
        if problems:
            raise InputError(problems)

    @property
    def half_widths(self) -> Floats:
        """(6 + n,): of position, rotation and leg readings, one after the other."""
        values = np.concatenate([self.position, self.rotation, self.length])
        with np.errstate(over="ignore"):
            return values if self.factor is None else np.asarray(self.factor * values)


# ------------------------------------------------------------------------------------------------------------------
# Robots whose dimensions are published, each with its source: robots.toml.


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
        fill(self, **{name: frozen_array(getattr(self, name)) for name in ("low", "high", "turn")})
        bounds = self.bounds if all(a.shape == (3,) for a in (self.low, self.high, self.turn)) else None
        if bounds is None or not np.isfinite(bounds).all() or (bounds[0] > bounds[1]).any():
            remedy = "give low <= high (3,) in mm and turn >= 0 (3,) in rad"
            raise unusable("workspace", "is no box of poses", remedy)

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
    """A robot of the catalogue, and where its nominal dimensions are published.

    stroke     mm, shortest and longest reading of a leg
    workspace  the poses to measure; None where six legs are commanded to readings within the stroke
    """

    robot: Robot
    source: str
    stroke: tuple[float, float]
    workspace: PoseRange | None = None


def _known(entry: dict[str, Any]) -> KnownRobot:
    robot = Robot(entry["name"], entry["base"], entry["mobile"], entry["offset"])
    place = entry.get("workspace")
    low, high = entry["stroke"]
    return KnownRobot(robot, entry["source"], (low, high), None if place is None else PoseRange(**place))


_CATALOGUE = tomllib.loads((files("cpcal.robot") / "robots.toml").read_text(encoding="utf-8"))
ROBOTS = {name: _known(entry) for name, entry in _CATALOGUE.items()}
DELTALAB = ROBOTS["deltalab"].robot


def known_robot(name: str) -> KnownRobot:
    """The robot in the catalogue as `name` (in any case); InputError lists those there are."""
    if name.casefold() not in ROBOTS:
        problems, others = Problems(), "choose one of " + ", ".join(map(repr, ROBOTS))
        problems.add_unknown("robot", f"there is no robot called {name!r}", name.casefold(), ROBOTS, others, None)
        problems.raise_any()
    return ROBOTS[name.casefold()]


# ------------------------------------------------------------------------------------------------------------------
# Imperfect legs: physical mechanisms that the seven parameters of a leg leave out, each with its own size.
#
# A `Mechanisms` holds the values of a particular robot, leg by leg; `sampled` makes one from sizes. Size zero is
# the perfect leg. `cpcal.simulate.studies` has the equations and finds the poses of a robot with them.

FIELDS: Widths = {
    "base_axis": 3,
    "base_offset": 1,
    "backlash": 1,
    "friction": None,
    "sag": 1,
    "gain": 1,
    "reference": None,
    "joint_error": 1,
    "joint_phase": 2,
}


def joint_phases(legs: int, stream: np.random.Generator) -> Floats:
    """Two random phases a leg, (n, 2) rad, for `joint_effect`."""
    return stream.uniform(0.0, 2.0 * np.pi, (legs, 2))


@dataclass(frozen=True, eq=False)
class Mechanisms(Value):
    """What is imperfect about each of n legs. Zero offsets, backlash, sag, gain, joint error: nothing.

    base_axis      (n, 3) unit, base frame: first axis of the lower universal joint, fixed in the base, through a
    base_offset    (n,) mm: its second axis passes at this distance, along the common normal of the two, which
                   turns about the first axis with the leg and points to the leg's side of it
    backlash       (n,) mm: whole clearance along the leg, which is half of it longer under tension and half of it
                   shorter under compression
    friction       platform weights: of the axial force, positive under compression, that the approach adds
                   (extending) or takes away (retracting) before its sign decides the side of the clearance
    sag            (n,) mm: by how much the leg's own weight would bring together the ends of the leg if it lay
                   flat with the length of mid-stroke
    gain           (n,): the sensor reads `reference + (1 + gain) (true - reference)`
    reference      mm: the reading at mid-stroke
    joint_error    (n,) mm, joint_phase (n, 2) rad: amplitude and phases of `joint_effect` on the reading

    Raises InputError when the shapes disagree, a value is not finite, an axis is no unit vector, a gain is -1 or
    less, or a backlash, sag, friction or joint error is negative.
    """

    base_axis: Floats
    base_offset: Floats
    backlash: Floats
    friction: float
    sag: Floats
    gain: Floats
    reference: float
    joint_error: Floats
    joint_phase: Floats

    def __post_init__(self) -> None:
        if problems := frozen_rows(self, "mechanisms", FIELDS, self.backlash):
            raise InputError(problems)

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return len(self.backlash)

    @property
    def perfect(self) -> bool:
        """Whether nothing is imperfect, whatever the axes, the friction and the phases are."""
        active = (self.base_offset, self.backlash, self.sag, self.gain, self.joint_error)
        return not any(values.any() for values in active)

    @classmethod
    def sampled(
        cls,
        legs: int,
        stream: np.random.Generator,
        phases: np.random.Generator,
        *,
        axis_offset: float = 0.0,
        backlash: float = 0.0,
        friction: float = 0.0,
        sag: float = 0.0,
        gain: float = 0.0,
        joint_error: float = 0.0,
        reference: float,
    ) -> Mechanisms:
        """Mechanisms of these sizes; directions and signs from `stream`, phases of the joint error from `phases`.

        First axes are level, in random directions; offsets and gains have the given size and a random sign. The
        draw does not depend on the sizes, so that each scales on its own.
        """
        azimuth = stream.uniform(0.0, 2.0 * np.pi, (2, legs))[0]
        sign = np.where(stream.random((5, legs)) < 0.5, -1.0, 1.0)
        return cls(
            base_axis=np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(legs)], axis=-1),
            base_offset=axis_offset * sign[0],
            backlash=np.full(legs, backlash),
            friction=friction,
            sag=np.full(legs, sag),
            gain=gain * sign[4],
            reference=reference,
            joint_error=np.full(legs, joint_error),
            joint_phase=joint_phases(legs, phases),
        )
