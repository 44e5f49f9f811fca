"""How far the platform can be from where its controller says, anywhere: what certified parameter sets leave of it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
