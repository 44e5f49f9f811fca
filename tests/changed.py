"""Campaigns that are changed: other sensors, fewer measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np


def with_gain(campaign, gain):
    """The same robot read by sensors that show L / (1 + gain)."""
    return replace(campaign, length=campaign.length / (1.0 + gain))


def some(campaign, rows):
    """Some of the measurements."""
    arrays = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")
    names = {name: tuple(np.array(getattr(campaign, name))[rows]) for name in ("pose", "run")}
    return replace(campaign, **names, **{name: getattr(campaign, name)[rows] for name in arrays})
