"""Where a search stops at the latest, and the clock that says when."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Where a search stops at the latest, with what it has proved so far."""

    seconds: float | None = None
    nodes: int | None = None
    gap: float = 1e-6  # relative, of a bracket
    gap_absolute: float = 1e-9  # in the objective's unit

    def clock(self) -> Clock:
        """A clock that starts now."""
        return Clock(self, math.inf if self.seconds is None else time.monotonic() + self.seconds)


@dataclass(frozen=True)
class Clock:
    """Limits that began to count at some moment."""

    limits: Limits
    deadline: float

    def over(self, nodes: int = 0) -> bool:
        """Whether the time or the nodes are used up."""
        too_many = self.limits.nodes is not None and nodes >= self.limits.nodes
        return too_many or time.monotonic() > self.deadline
