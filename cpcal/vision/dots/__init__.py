"""Dots in an image: spots, blurred ellipses fitted to their edges, sub-pixel centres with covariance and quality."""

from cpcal.vision.dots.observe import Dots, nothing, observe_dots, populations, refitted

__all__ = ["Dots", "nothing", "observe_dots", "populations", "refitted"]
