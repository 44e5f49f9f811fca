"""The contract of a linear engine: one polyhedron, many objectives. It proposes; rigorous arithmetic disposes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from cpcal.common.arrays import Floats


class LinearStatus(Enum):
    """What a linear engine says. No status is a proof: the multipliers decide."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True)
class LinearSolution:
    """Approximate answer to `min c.z : rows z <= rhs, lower <= z <= upper`; `multipliers` >= 0, one per row.

    With status INFEASIBLE the multipliers are those of the elastic program: a Farkas ray.
    """

    status: LinearStatus
    point: Floats  # (columns,)
    multipliers: Floats  # (rows,)


class LinearEngine(Protocol):
    """One polyhedron, many objectives. Proposes; rigorous arithmetic disposes."""

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats) -> None:
        """Forget what was before and take `matrix z <= rhs`, `lower <= z <= upper` (finite bounds)."""
        ...

    def add_rows(self, matrix: Floats, rhs: Floats) -> None: ...

    def minimize(self, objective: Floats) -> LinearSolution:
        """Minimise from the last basis."""
        ...
