"""The drawing of a parallel robot: joint centres and length offsets (the paper's 7 parameters a leg)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem, shown
from cpcal.common.names import NAME_REMEDY, is_name
from cpcal.common.values import Value, frozen_array

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
        problems = []
        for field in ("base", "mobile", "offset"):
            try:
                array = frozen_array(getattr(self, field))
            except (TypeError, ValueError) as error:
                problems.append(Problem(f"robot {field}", f"is not an array of numbers ({error})", "give mm"))
                continue
            object.__setattr__(self, field, array)
        problems = problems or self._problems()
        if problems:
            raise InputError(problems)

    def _problems(self) -> list[Problem]:
        found = []
        legs = self.base.shape[0] if self.base.ndim else 0
        for field, shape in (("base", (legs, 3)), ("mobile", (legs, 3)), ("offset", (legs,))):
            array: Floats = getattr(self, field)
            if array.shape != shape or legs == 0:
                remedy = "give base (n, 3), mobile (n, 3) and offset (n,) for the same n >= 1 legs"
                found.append(Problem(f"robot {field}", f"has the shape {array.shape}", remedy))
            elif not good_numbers(array).all():
                what = f"holds a number that is NaN, infinite or above {LARGEST:g}"
                found.append(Problem(f"robot {field}", what, "give numbers in mm"))
        if not is_name(self.name):
            found.append(Problem("robot name", f"is {shown(self.name)}", NAME_REMEDY))
        return found

    @property
    def legs(self) -> int:
        """The number of legs, n."""
        return int(self.offset.shape[0])

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
            raise InputError([Problem("robot parameters", what, "give one row of 7 numbers a leg")])
        return cls(name, rows[:, :3], rows[:, 3:6], rows[:, 6])
