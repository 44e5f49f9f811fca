"""Campaigns and studies that are changed: other sensors, fewer measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpcal.questions import LegBracket, LegResult, Support, Work
from cpcal.robot import PoseTable


def with_gain(campaign, gain):
    """The same robot read by sensors that show L / (1 + gain)."""
    return replace(campaign, length=campaign.length / (1.0 + gain))


def some(campaign, rows):
    """Some of the measurements."""
    arrays = ("position", "quaternion", "length", "position_radius", "rotation_radius", "length_radius")
    names = {name: tuple(np.array(getattr(campaign, name))[rows]) for name in ("pose", "run")}
    return replace(campaign, **names, **{name: getattr(campaign, name)[rows] for name in arrays})


def of_poses(study, names):
    """A study of which only these configurations are left to calibrate with."""
    table = study.calibration
    rows = [k for k, name in enumerate(table.pose) if name in names]
    values = {name: getattr(table, name) for name in table.__dataclass_fields__}
    chosen = {name: None if v is None else np.array(v)[rows] for name, v in values.items()}
    return replace(study, calibration=PoseTable(**chosen))


_OF_BRACKET = {"verdict", "point", "center", "enclosure", "certificate"}
_OF_WORK = {"nodes", "programs", "seconds", "pending", "floor", "trials", "contractors_used"}


def leg_with(leg, /, **changes):
    """A leg's result (None: a new one) with fields of its groups changed: eps_lo, point, support, nodes and so on."""
    lo_hi = {name.removeprefix("eps_"): changes.pop(name) for name in ("eps_lo", "eps_hi") if name in changes}
    bracket = {name: changes.pop(name) for name in _OF_BRACKET & changes.keys()} | lo_hi
    work = {name: changes.pop(name) for name in _OF_WORK & changes.keys()}
    if "support" in changes:
        changes["support"] = Support(changes["support"])
    if leg is None:
        return LegResult(bracket=LegBracket(**bracket), work=Work(**work), **changes)
    return replace(leg, bracket=replace(leg.bracket, **bracket), work=replace(leg.work, **work), **changes)
