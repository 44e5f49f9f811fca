"""Legs, kinematics, pose and rotation, campaign and study files, simulated campaigns and studies."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
