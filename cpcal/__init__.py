"""Certified calibration of parallel robots: what no least-squares fit can answer, proved.

campaign = cpcal.load_campaign("campaign/")
result = cpcal.certify(campaign, delta=100.0)
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
