"""How long work runs: where its tasks are done, how it is asked to stop, and how it goes on after a stop."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
