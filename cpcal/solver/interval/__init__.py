"""Values: intervals and boxes."""

from cpcal.common.values import Bools, Floats, Indices
from cpcal.solver.interval.box import Box
from cpcal.solver.interval.numbers import Interval, IntervalArray

__all__ = ["Bools", "Box", "Floats", "Indices", "Interval", "IntervalArray"]
