"""Polyhedra: linear programs that propose, rigorous bounds that dispose.

GLOP is in `glop`, a module of its own: ortools takes a while to load, and is rarely needed.
"""

from cpcal.solver.linear.engine import (
    BoxProgram,
    Dense,
    LinearEngine,
    LinearSolution,
    LinearStatus,
    lower_bound,
    tightened,
)

__all__ = [
    "BoxProgram",
    "Dense",
    "LinearEngine",
    "LinearSolution",
    "LinearStatus",
    "lower_bound",
    "tightened",
]
