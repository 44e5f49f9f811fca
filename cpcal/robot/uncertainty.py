"""How far readings may be off, as a campaign declares it for all its measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Value, frozen_array
from cpcal.robot.robot import LARGEST, good_numbers

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
            object.__setattr__(self, kind, array)
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
