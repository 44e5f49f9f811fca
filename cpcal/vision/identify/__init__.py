"""Which dot is which: cross-ratios along collinear runs, homographies, and what must fit before an answer is given."""

from cpcal.vision.identify.identify import Identification, Unidentified, identify

__all__ = ["Identification", "Unidentified", "identify"]
