"""From data to networks and their proofs: a leg, what a camera sees, the frames of a hand-eye rig, a platform."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
