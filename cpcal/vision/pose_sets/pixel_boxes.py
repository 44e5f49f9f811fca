"""Where the dots of a target are in an image: to within stated boxes of pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, Indices
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import frozen_array
from cpcal.solver.interval import IntervalArray


@dataclass(frozen=True, eq=False)
class PixelBoxes:
    """Where dots of a target are in an image.

    numbers  (m,) of the dots in the target, each once
    lo, hi   (m, 2) pixels: the projection of dot `numbers[i]` is stated to lie in lo[i] <= pixel <= hi[i]
    of_images  then it is the centre (the centroid of the area) of the dot's image that lies there, as it is measured:
             by how much it differs from the projection is bounded by proof

    Raises InputError when the arrays make no boxes.
    """

    numbers: Indices
    lo: Floats
    hi: Floats
    of_images: bool = False

    def __post_init__(self) -> None:
        numbers = np.array(self.numbers, dtype=np.intp)
        numbers.setflags(write=False)
        object.__setattr__(self, "numbers", numbers)
        object.__setattr__(self, "lo", frozen_array(self.lo))
        object.__setattr__(self, "hi", frozen_array(self.hi))
        shape = (len(numbers), 2) if numbers.ndim == 1 else None
        if shape is None or self.lo.shape != shape or self.hi.shape != shape:
            what = f"have shapes {numbers.shape}, {self.lo.shape} and {self.hi.shape}"
            raise InputError([Problem("pixel boxes", what, "give numbers (m,), lo (m, 2) and hi (m, 2)")])
        good = (self.lo <= self.hi).all(axis=1) & np.isfinite(self.lo).all(axis=1) & np.isfinite(self.hi).all(axis=1)
        problems = [
            Problem(f"pixel box {k}", "has no points, or infinitely many", "give finite lo <= hi")
            for k in np.flatnonzero(~good)
        ]
        if len(np.unique(numbers)) < len(numbers):
            problems.append(Problem("pixel boxes", "name a dot twice", "give one box for each dot"))
        if problems:
            raise InputError(problems)

    @classmethod
    def around(
        cls, numbers: npt.ArrayLike, centers: npt.ArrayLike, half_width: npt.ArrayLike, *, of_images: bool = False
    ) -> PixelBoxes:
        """`center +- half_width`, pixels: centers (m, 2), half_width a number, (2,), (m, 1) or (m, 2), >= 0."""
        middle = np.asarray(centers, dtype=np.float64)
        try:
            radius = np.broadcast_to(np.asarray(half_width, dtype=np.float64), middle.shape)
        except ValueError:
            what = f"is {np.shape(half_width)} for centres {middle.shape}"
            raise InputError([Problem("half_width", what, "give one number, or one for each coordinate")]) from None
        if not bool((radius >= 0.0).all()):
            raise InputError([Problem("half_width", "is negative or NaN", "give pixels >= 0")])
        boxes = IntervalArray.around(middle, radius)
        return cls(np.asarray(numbers, dtype=np.intp), boxes.lo, boxes.hi, of_images)

    def part(self, chosen: Indices) -> PixelBoxes:
        """Some of them."""
        return PixelBoxes(self.numbers[chosen], self.lo[chosen], self.hi[chosen], self.of_images)

    def __len__(self) -> int:
        return len(self.numbers)
