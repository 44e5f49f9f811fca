"""Projections of a set of parameters on planes of two of them, as proved half-planes: plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cpcal.solver.interval import Box

HalfPlane = tuple[float, float, float]


@dataclass(frozen=True)
class Projection:
    """The set lies where `u x + v y <= c` for every (u, v, c) of `half_planes`, (x, y) being two `parameters` in mm."""

    parameters: tuple[str, str]
    half_planes: tuple[HalfPlane, ...]

    def __post_init__(self) -> None:
        """Raises ValueError for half-planes without a direction, or that are not finite."""
        if self.parameters[0] == self.parameters[1]:
            raise ValueError(f"{self.parameters} are not two parameters")
        for plane in self.half_planes:
            if plane[0] == plane[1] == 0.0 or not all(map(math.isfinite, plane)):
                raise ValueError(f"{plane} is no half-plane")


@dataclass(frozen=True)
class Projections:
    """What holds all parameters that satisfy a leg's equations to within `eps`, of those it was asked about.

    "Satisfies": THERE EXISTS for every measurement a reading in its set. `box` and each of `pairs` hold for themselves.
    """

    eps: float
    box: Box
    pairs: tuple[Projection, ...]

    def __post_init__(self) -> None:
        """Raises ValueError for an eps or a box that is not finite, and parameters that the box has not."""
        bounds = (self.eps, *self.box.lo.tolist(), *self.box.hi.tolist())
        if not all(map(math.isfinite, bounds)):
            raise ValueError("eps or the box of the projections is not finite")
        if not {name for pair in self.pairs for name in pair.parameters} <= set(self.box.names):
            raise ValueError("a projection is of parameters that are not there")
