"""Which dot is which: cross-ratios along collinear runs, homographies, and what must fit before an answer is given."""

from cpcal.vision.identify.identify import FEWEST, Identification, Unidentified, identify

__all__ = ["FEWEST", "Identification", "Unidentified", "identify"]
