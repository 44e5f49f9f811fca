"""Polyhedra: linear programs that propose, rigorous bounds that dispose.

GLOP is in `glop`, a module of its own: ortools takes a while to load, and is rarely needed.
"""

from cpcal.solver.linear.box_program import BoxProgram
from cpcal.solver.linear.dense import Dense
from cpcal.solver.linear.engine import LinearEngine, LinearSolution, LinearStatus
from cpcal.solver.linear.rigorous import lower_bound
from cpcal.solver.linear.tighten import tightened

__all__ = [
    "BoxProgram",
    "Dense",
    "LinearEngine",
    "LinearSolution",
    "LinearStatus",
    "lower_bound",
    "tightened",
]
