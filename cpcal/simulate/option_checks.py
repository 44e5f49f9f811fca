"""Checks the options of simulated measurements: every one without a meaning is named, all at once."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cpcal.common.errors import Problem, Problems
from cpcal.robot import Robot


class OptionChecks:
    """Collects problems with named options; `finish` raises them."""

    def __init__(self, options: Mapping[str, object]) -> None:
        self.options = options
        self.problems = Problems()

    def demand(self, name: str, good: bool, remedy: str) -> None:
        if not good:
            self.problems.add(Problem(f"option {name}", f"has no meaning: {self.options[name]!r}", remedy))

    def whole(self, name: str, least: int, most: float = math.inf) -> None:
        """A whole number from `least` to `most`."""
        value = self.options[name]
        good = isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
        self.demand(name, good, f"give a whole number from {least}" + (f" to {most:,}" if most < math.inf else ""))

    def sizes(self, *names: str) -> None:
        """Finite numbers >= 0."""
        for name in names:
            value = self.options[name]
            self.demand(name, finite(value) and value >= 0, "give a finite number >= 0")  # type: ignore[operator]

    def six_legs(self, name: str) -> None:
        robot = self.options[name]
        self.demand(name, isinstance(robot, Robot) and robot.legs == 6, "give a Robot with six legs, or a workspace")

    def truncate(self, name: str) -> None:
        value = self.options[name]
        good = value is None or (finite(value) and value >= 0.1)  # type: ignore[operator]
        self.demand(name, good, "give a number >= 0.1")

    def stroke(self, name: str) -> None:
        value = self.options[name]
        good = isinstance(value, tuple) and len(value) == 2 and all(map(finite, value)) and value[0] < value[1]
        self.demand(name, good, "give (shortest, longest) in mm")

    def finish(self) -> None:
        """InputError that names every option without a meaning."""
        self.problems.raise_any()


def finite(value: object) -> bool:
    """Whether it is a finite number."""
    return isinstance(value, (int, float)) and math.isfinite(value)
