"""Values: intervals and boxes."""

from cpcal.common.values import Bools, Floats, Indices, fill
from cpcal.solver.interval.box import Box, Boxes
from cpcal.solver.interval.numbers import Interval, IntervalArray

__all__ = ["Bools", "Box", "Boxes", "Floats", "Indices", "Interval", "IntervalArray", "fill"]
