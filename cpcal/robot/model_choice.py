"""Which leg model a campaign asks for: [model] in campaign.toml. What the names mean stands in `cpcal.calibration`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cpcal.common.errors import InputError, Problem, shown
from cpcal.common.names import NAME_MAX
from cpcal.common.values import Value, frozen_mapping


@dataclass(frozen=True, eq=False)
class ModelChoice(Value):
    """A model's name, and half-widths of its extra parameters, in their units, where they are not the default.

    Raises InputError for what can belong to no model.
    """

    name: str
    half_widths: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        widths = {str(k): float(v) for k, v in self.half_widths.items()}
        object.__setattr__(self, "half_widths", frozen_mapping(widths))
        problems = []
        if not (self.name.isidentifier() and len(self.name) <= NAME_MAX):
            problems.append(Problem("model", f"{shown(self.name)} cannot be a name", 'give one such as "gain"'))
        for key, value in self.half_widths.items():
            if not (key.isidentifier() and len(key) <= NAME_MAX):
                problems.append(Problem("model", f"{shown(key)} cannot be a parameter", "give its name, such as s"))
            if not (math.isfinite(value) and value >= 0.0):
                what = f"the half-width of {shown(key)} is {value}"
                problems.append(Problem("model", what, "give a number, 0 or more"))
        if problems:
            raise InputError(problems)
