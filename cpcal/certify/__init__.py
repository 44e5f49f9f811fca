"""The questions of an engineer, asked of the legs of a campaign."""

from cpcal.certify.certify import certify
from cpcal.certify.compare import COMPARED, compare
from cpcal.certify.compare_networks import compare_networks
from cpcal.certify.point import PointResult, certify_point
from cpcal.results import CENTERS, METHODS, SUPPORTS

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
