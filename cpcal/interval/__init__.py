"""Values: intervals, boxes and the engines that compute with them."""

from cpcal.interval.arithmetic import Arithmetic, get_arithmetic
from cpcal.interval.array import IntervalArray
from cpcal.interval.box import Box
from cpcal.interval.scalar import Interval

__all__ = ["Arithmetic", "Box", "Interval", "IntervalArray", "get_arithmetic"]
