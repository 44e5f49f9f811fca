"""Polyhedra: linear programs that propose, rigorous bounds that dispose."""

from cpcal.solver.linear.engine import (
    BoxProgram,
    Dense,
    LinearSolution,
    LinearStatus,
    lower_bound,
    tightened,
)

__all__ = [
    "BoxProgram",
    "Dense",
    "LinearSolution",
    "LinearStatus",
    "lower_bound",
    "tightened",
]
