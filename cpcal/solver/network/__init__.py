"""What must hold: expressions, constraints, networks, and their rewriting to polynomial form."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
