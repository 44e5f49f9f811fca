"""Certified calibration of parallel robots: what no least-squares fit can answer, proved.

campaign = cpcal.load_campaign("campaign/")
result = cpcal.certify(campaign, delta=100.0)
"""

import sys

try:
    import lazy_loader

    __getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
except KeyboardInterrupt:
    if sys.argv[:1] != ["-m"] and not sys.argv[0].endswith("cpcal"):  # imported by a program: Ctrl-C is its own
        raise
    sys.stderr.write("cpcal: interrupted\n")
    sys.exit(130)
