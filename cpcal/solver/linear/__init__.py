"""Polyhedra: linear programs that propose, rigorous bounds that dispose."""

from cpcal.solver.linear.box_program import BoxProgram
from cpcal.solver.linear.dense import Dense
from cpcal.solver.linear.engine import LinearEngine, LinearSolution, LinearStatus
from cpcal.solver.linear.glop import Glop
from cpcal.solver.linear.rigorous import lower_bound
from cpcal.solver.linear.tighten import tightened

__all__ = [
    "BoxProgram",
    "Dense",
    "Glop",
    "LinearEngine",
    "LinearSolution",
    "LinearStatus",
    "lower_bound",
    "tightened",
]
