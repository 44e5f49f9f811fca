from .certify import certify
from .compare import COMPARED, compare
from .compare_networks import compare_networks
from .point import PointResult, certify_point
from .question import CENTERS, METHODS, SUPPORTS

__all__ = [
    "CENTERS",
    "COMPARED",
    "METHODS",
    "SUPPORTS",
    "PointResult",
    "certify",
    "certify_point",
    "compare",
    "compare_networks",
]
