"""Leg models: the equation of a leg, its network, its fit and its statement for a certificate."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
