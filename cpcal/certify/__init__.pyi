from .bracket import PointResult, certify_point
from .certify import certify
from .compare import COMPARED, compare
from .compare_networks import compare_networks
from .data_check import DataCheck, Finding, check_data
from .ranges import with_ranges
from .robust import certify_robust

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
