"""From campaigns to fits and constraint networks: frames, leg models, least squares, statistics, validation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
