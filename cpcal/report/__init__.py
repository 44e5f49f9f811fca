"""What a person reads of a result: numbers rounded to the proved side, sentences, one HTML page."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
