"""Values: intervals, boxes and the engines that compute with them."""

from cpcal.solver.interval.arithmetic import Arithmetic, get_arithmetic
from cpcal.solver.interval.box import Box
from cpcal.solver.interval.numbers import Interval, IntervalArray

__all__ = ["Arithmetic", "Box", "Interval", "IntervalArray", "get_arithmetic"]
