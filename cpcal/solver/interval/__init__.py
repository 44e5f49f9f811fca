"""Values: intervals, boxes and the engines that compute with them."""

from cpcal.common.values import Bools, Floats, Indices, Ints
from cpcal.solver.interval.arithmetic import Arithmetic, get_arithmetic
from cpcal.solver.interval.box import Box
from cpcal.solver.interval.numbers import Interval, IntervalArray

__all__ = ["Arithmetic", "Bools", "Box", "Floats", "Indices", "Interval", "IntervalArray", "Ints", "get_arithmetic"]
