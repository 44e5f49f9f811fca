"""The questions of an engineer, asked of the legs of a campaign, and their answers as plain values."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
