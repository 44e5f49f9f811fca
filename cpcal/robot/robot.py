"""The drawing of a parallel robot: joint centres and length offsets (the paper's 7 parameters a leg)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cpcal.common.errors import Problems, shown, unusable
from cpcal.common.files import NAME_MAX, NAME_REMEDY, is_text
from cpcal.common.values import LARGEST, ArrayLike, Bools, Floats, Pair, Value, all_finite, floats, freeze


def good_numbers(values: ArrayLike, least: float = -LARGEST) -> Bools:
    """Which numbers are finite and of a size that makes sense in mm; of half-widths none below `least` = 0."""
    array = floats(values)
    return (array >= least) & (array <= LARGEST)


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
        problems, legs = Problems(), len(self.base) if hasattr(self.base, "__len__") else 0
        for name, shape in (("base", (legs, 3)), ("mobile", (legs, 3)), ("offset", (legs,))):
            try:
                freeze(self, name)
            except (TypeError, ValueError) as error:
                problems.wrong(f"robot {name}", f"is not an array of numbers ({error})", "give numbers, mm")
                continue
            array = getattr(self, name)
            if array.shape != shape or not legs:
                remedy = f"give an array of the shape {shape}" if legs else "give one row for each of n >= 1 legs"
                problems.wrong(f"robot {name}", f"has the shape {array.shape}", remedy)
            elif not good_numbers(array).all():
                what = f"holds a number that is NaN, infinite or above {LARGEST:g}"
                problems.wrong(f"robot {name}", what, "give a number that makes sense, in mm")
        if not is_text(self.name, NAME_MAX):
            problems.wrong("robot name", f"is {shown(self.name)}", NAME_REMEDY)
        problems.raise_any()

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return len(self.offset)

    @property
    def parameters(self) -> Floats:
        """(n, 7) mm: one row `a_x a_y a_z b_x b_y b_z l` a leg, as in the paper's tables."""
        return np.hstack([self.base, self.mobile, self.offset[:, None]])

    @classmethod
    def from_parameters(cls, name: str, parameters: ArrayLike) -> Robot:
        """The robot of an (n, 7) array of rows `a_x a_y a_z b_x b_y b_z l`, mm."""
        rows = floats(parameters)
        if rows.ndim != 2 or rows.shape[1] != 7:
            what = f"have the shape {rows.shape}"
            raise unusable("robot parameters", what, "give one row of 7 numbers a leg")
        return cls(name, rows[:, :3], rows[:, 3:6], rows[:, 6])


# ------------------------------------------------------------------------------------------------------------------
# How far readings may be off, as a campaign declares it for all its measurements.

KINDS = ("position", "rotation", "length")
EXACT_OR_NOT = (
    "write in [uncertainty] either factor = 3 with position_sigma, rotation_sigma and length_sigma, "
    "or position_half_width, rotation_half_width and length_half_width, or exact = true"
)


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
        problems = Problems()
        freeze(self, *KINDS)
        for kind in KINDS:
            array = getattr(self, kind)
            if array.ndim != 1 or (kind != "length" and array.shape != (3,)):
                what = f"has the shape {array.shape}"
                problems.wrong(f"uncertainty {kind}", what, "give 3, 3 and as many as there are legs")
            elif not good_numbers(array, 0.0).all():
                what = f"holds a number that is negative, not finite or above {LARGEST:g}"
                problems.wrong(f"uncertainty {kind}", what, "give finite numbers >= 0")
        if self.factor is not None and not good_numbers(self.factor, 0.0):
            problems.wrong("uncertainty factor", f"is {self.factor}", "give a finite number >= 0")
        if not problems and not good_numbers(self.half_widths, 0.0).all():
            problems.wrong("uncertainty", f"factor * sigma is above {LARGEST:g}", "give smaller numbers")
        problems.raise_any()

    @property
    def half_widths(self) -> Floats:
        """(6 + n,): of position, rotation and leg readings, one after the other."""
        values = np.concatenate([self.position, self.rotation, self.length])
        with np.errstate(over="ignore"):
            return values if self.factor is None else (self.factor * values)


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
        freeze(self, "low", "high", "turn")
        bounds = self.bounds if all(a.shape == (3,) for a in (self.low, self.high, self.turn)) else None
        if bounds is None or not all_finite(bounds) or (bounds[0] > bounds[1]).any():
            remedy = "give low <= high (3,) in mm and turn >= 0 (3,) in rad"
            raise unusable("workspace", "is no box of poses", remedy)

    @property
    def bounds(self) -> Floats:
        """(2, 6): least and largest x, y, z (mm) and components of the rotation vector (rad)."""
        return np.stack([np.concatenate([self.low, -self.turn]), np.concatenate([self.high, self.turn])])

    @property
    def free(self) -> Bools:
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
    stroke: Pair
    workspace: PoseRange | None


ROBOTS = {
    name: KnownRobot(
        Robot(entry["name"], entry["base"], entry["mobile"], entry["offset"]),
        entry["source"],
        tuple(entry["stroke"]),
        PoseRange(**entry["workspace"]) if "workspace" in entry else None,
    )
    for name, entry in tomllib.loads(Path(__file__).with_name("robots.toml").read_text(encoding="utf-8")).items()
}
DELTALAB = ROBOTS["deltalab"].robot


def known_robot(name: str) -> KnownRobot:
    """The robot in the catalogue as `name` (in any case); InputError lists those there are."""
    if name.casefold() not in ROBOTS:
        problems, others = Problems(), "choose one of " + ", ".join(map(repr, ROBOTS))
        problems.add_unknown("robot", f"there is no robot called {name!r}", name.casefold(), ROBOTS, others, None)
        problems.raise_any()
    return ROBOTS[name.casefold()]
