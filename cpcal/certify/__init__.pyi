from .certify import certify
from .compare import COMPARED, compare
from .compare_networks import compare_networks
from .point import PointResult, certify_point
from .ranges import with_ranges

__all__ = [
    "COMPARED",
    "PointResult",
    "certify",
    "certify_point",
    "compare",
    "compare_networks",
    "with_ranges",
]
