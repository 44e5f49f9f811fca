from .certified_ranges import with_ranges
from .certify import certify
from .certify_robust import certify_robust
from .compare import COMPARED, compare
from .compare_networks import compare_networks
from .data_check import DataCheck, Finding, check_data
from .point import PointResult, certify_point

__all__ = [
    "COMPARED",
    "DataCheck",
    "Finding",
    "PointResult",
    "certify",
    "certify_point",
    "certify_robust",
    "check_data",
    "compare",
    "compare_networks",
    "with_ranges",
]
