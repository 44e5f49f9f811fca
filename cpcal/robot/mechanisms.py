"""Imperfect legs: physical mechanisms that the seven parameters of a leg leave out, each with its own size.

A `Mechanisms` holds the values of a particular robot, leg by leg; `sampled` makes one from sizes. Size zero is
the perfect leg. `assembly.py` has the equations and finds the poses of a robot with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Value, frozen_array
from cpcal.robot.robot import LARGEST, good_numbers

# The values of one leg: how many numbers, and what is asked of them. None: one number for the whole robot.
FIELDS: dict[str, int | None] = {
    "base_axis": 3,
    "base_offset": 1,
    "mobile_axis": 3,
    "mobile_offset": 3,
    "backlash": 1,
    "friction": None,
    "sag": 1,
    "gain": 1,
    "reference": None,
    "joint_error": 1,
    "joint_phase": 2,
}
_UNIT = 1e-6  # tolerance on the norm of an axis


def joint_phases(legs: int, stream: np.random.Generator) -> Floats:
    """Two random phases a leg, (n, 2) rad, for `joint_effect`."""
    return stream.uniform(0.0, 2.0 * np.pi, (legs, 2))


@dataclass(frozen=True, eq=False)
class Mechanisms(Value):
    """What is imperfect about each of n legs. Zero offsets, backlash, sag, gain, joint error: nothing.

    base_axis      (n, 3) unit, base frame: first axis of the lower universal joint, fixed in the base, through a
    base_offset    (n,) mm: its second axis passes at this distance, along the common normal of the two, which
                   turns about the first axis with the leg and points to the leg's side of it
    mobile_axis    (n, 3) unit, mobile frame: first axis of the upper joint, fixed in the platform, through b
    mobile_offset  (n, 3) mm: of its other two axes, each at right angles to the one before (Denavit-Hartenberg):
                   from axis 1 to axis 2 along their common normal; along axis 2; from axis 2 to axis 3, the
                   leg's own, along theirs
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
    mobile_axis: Floats
    mobile_offset: Floats
    backlash: Floats
    friction: float
    sag: Floats
    gain: Floats
    reference: float
    joint_error: Floats
    joint_phase: Floats

    def __post_init__(self) -> None:
        for name, width in FIELDS.items():
            value: Any = getattr(self, name)
            object.__setattr__(self, name, float(value) if width is None else frozen_array(value))
        problems = self._problems()
        if problems:
            raise InputError(problems)

    def _problems(self) -> list[Problem]:
        found = []
        legs = len(self.backlash) if self.backlash.ndim else 0
        for name, width in FIELDS.items():
            value = np.asarray(getattr(self, name))
            shape = () if width is None else (legs,) if width == 1 else (legs, width)
            if value.shape != shape:
                remedy = f"give an array of the shape {shape}"
                found.append(Problem(f"mechanisms {name}", f"has the shape {value.shape}", remedy))
            elif (wrong := wrong_value(name, value)) is not None:
                found.append(Problem(f"mechanisms {name}", *wrong))
        return found

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return len(self.backlash)

    @property
    def perfect(self) -> bool:
        """Whether nothing is imperfect, whatever the axes, the friction and the phases are."""
        active = (self.base_offset, self.mobile_offset, self.backlash, self.sag, self.gain, self.joint_error)
        return not any(values.any() for values in active)

    @classmethod
    def sampled(
        cls,
        legs: int,
        stream: np.random.Generator,
        phases: np.random.Generator,
        *,
        axis_offset: float = 0.0,
        joint_offset: float = 0.0,
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
        azimuth = stream.uniform(0.0, 2.0 * np.pi, (2, legs))
        axes = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros((2, legs))], axis=-1)
        sign = np.where(stream.random((5, legs)) < 0.5, -1.0, 1.0)
        return cls(
            base_axis=axes[0],
            base_offset=axis_offset * sign[0],
            mobile_axis=axes[1],
            mobile_offset=joint_offset * sign[1:4].T,
            backlash=np.full(legs, backlash),
            friction=friction,
            sag=np.full(legs, sag),
            gain=gain * sign[4],
            reference=reference,
            joint_error=np.full(legs, joint_error),
            joint_phase=joint_phases(legs, phases),
        )


def wrong_value(name: str, value: npt.ArrayLike) -> tuple[str, str] | None:
    """What is wrong with a field's values of the right shape, and the remedy; None when they are good."""
    array = np.asarray(value, dtype=np.float64)
    if not good_numbers(array).all():
        return f"holds a number that is NaN, infinite or above {LARGEST:g}", "give a number that makes sense"
    if name.endswith("_axis") and (np.abs(np.linalg.norm(array, axis=-1) - 1.0) > _UNIT).any():
        return "holds an axis whose norm is not 1", "give unit vectors"
    if name == "gain" and (array <= -1.0).any():
        return "holds a gain of -1 or less", "give relative errors, such as 0.001"
    if name in ("backlash", "friction", "sag", "joint_error") and (array < 0.0).any():
        return "holds a negative number", "give numbers >= 0"
    return None
