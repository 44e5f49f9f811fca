"""What every room may use: errors, names, numbers in print, values that hold arrays, the one way to write files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
