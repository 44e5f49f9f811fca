"""Which leg model a campaign asks for: [model] in campaign.toml. What the names mean stands in `cpcal.calibration`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cpcal.errors import InputError, Problem


@dataclass(frozen=True)
class ModelChoice:
    """A model's name, and half-widths of its extra parameters, in their units, where they are not the default.

    Raises InputError for what can belong to no model.
    """

    name: str
    half_widths: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "half_widths", {str(k): float(v) for k, v in self.half_widths.items()})
        problems = []
        if not self.name.isidentifier():
            problems.append(Problem("model", f"{self.name!r} cannot be a name", 'give one such as "gain"'))
        for key, value in self.half_widths.items():
            if not key.isidentifier():
                problems.append(Problem("model", f"{key!r} cannot be a parameter", "give its name, such as s"))
            if not (math.isfinite(value) and value >= 0.0):
                problems.append(Problem("model", f"the half-width of {key!r} is {value}", "give a number, 0 or more"))
        if problems:
            raise InputError(problems)
