"""The contract of a linear engine: one polyhedron, many objectives. It proposes; rigorous arithmetic disposes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from cpcal.common.arrays import Floats, Indices


class LinearStatus(Enum):
    """What a linear engine says. No status is a proof: the multipliers decide."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True)
class LinearSolution:
    """Approximate answer to `min c.z : matrix z <= rhs, lower <= z <= upper`.

    `rows` (k,) are those with a multiplier, `multipliers` (k,) > 0 theirs: few. With status INFEASIBLE they are a
    Farkas ray.
    """

    status: LinearStatus
    point: Floats  # (columns,)
    rows: Indices
    multipliers: Floats


class LinearEngine(Protocol):
    """One polyhedron, many objectives. Proposes; rigorous arithmetic disposes."""

    def load(self, matrix: Floats, rhs: Floats, lower: Floats, upper: Floats, always: int = 0) -> None:
        """Forget what was before and take `matrix z <= rhs`, `lower <= z <= upper` (finite bounds).

        Of many rows an engine may leave out those that no vertex violates; the first `always` are likely to matter.
        """
        ...

    def minimize(self, objective: Floats) -> LinearSolution:
        """Minimise, from where the program before ended."""
        ...
