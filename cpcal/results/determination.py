"""Whether the measurements of a leg determine its parameters: plain values.

Two rules. The rank of the equations, in floating point, tells which parameters they leave open. And where all that is
proved of a parameter is a wide range, it is not shown to be determined, whatever the rank is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.numbers import plain_gap
from cpcal.solver.interval import Box

SHARE = 0.5  # of its side of the box: an enclosure that fills more is wide
KNOWN = 10.0  # mm: a box of this half-width or less states the parameters by itself, and no range in it is wide
_LENGTHS = 7  # the parameters (a, b, l), which have the half-width of the box


@dataclass(frozen=True)
class Determination:
    """The `rank` of the Jacobian of so many equations in `of` parameters, and those that they leave `undetermined`."""

    measurements: int
    of: int
    rank: int
    undetermined: tuple[str, ...] = ()

    @property
    def tests_the_model(self) -> bool:
        """Whether measurements are left to contradict the model, once the parameters are determined."""
        return not self.undetermined and self.measurements > self.of

    @property
    def sentence(self) -> str:
        """Empty when all is well."""
        count = f"{self.measurements:,} measurement{'' if self.measurements == 1 else 's'}"
        if self.undetermined:
            names = ", ".join(self.undetermined)
            return f"{count} of rank {self.rank} leave {len(self.undetermined)} of {self.of} parameters open: {names}."
        if not self.tests_the_model:
            return f"{count} determine {self.of} parameters, and none is left to test the model."
        return ""


@dataclass(frozen=True)
class Wide:
    """Parameters whose ranges, all that is proved of them, are more than half of the box: (name, lo, hi), in mm."""

    ranges: tuple[tuple[str, float, float], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _, _ in self.ranges)

    @property
    def sentence(self) -> str:
        """Empty when all is well."""
        if not self.ranges:
            return ""
        widths = ", ".join(f"{name} ({plain_gap(lo, hi)} mm)" for name, lo, hi in self.ranges)
        return (
            f"The measurements are not shown to determine parameters that may fill more than half of the box: {widths}."
        )


NOTHING_WIDE = Wide()


def wide(enclosure: Box, delta: float) -> Wide:
    """Of an enclosure of all parameters that are as good as the best known, in a box of half-width `delta` (mm)."""
    if enclosure.is_empty or delta <= KNOWN:
        return NOTHING_WIDE
    lo, hi = enclosure.lo[:_LENGTHS], enclosure.hi[:_LENGTHS]
    found = np.flatnonzero(hi - lo > SHARE * 2.0 * delta)
    return Wide(tuple((enclosure.names[k], float(lo[k]), float(hi[k])) for k in found))
