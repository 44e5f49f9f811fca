"""Smallest values, bounded from both sides."""

from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.local_minimum import fit
from cpcal.solver.optimize.minimum import Bracket, Found, Minimum, bracket_sentence
from cpcal.solver.optimize.support import irreducible, support
from cpcal.solver.optimize.timeout import TimeoutAnswer, TimeoutOutcome, Trial, ask, timeout
from cpcal.solver.optimize.verify_point import PointVerdicts, verify_point
from cpcal.solver.optimize.witness import Witness, WitnessProver

__all__ = [
    "Bracket",
    "Found",
    "Minimum",
    "PointVerdicts",
    "TimeoutAnswer",
    "TimeoutOutcome",
    "Trial",
    "Witness",
    "WitnessProver",
    "ask",
    "bracket_sentence",
    "fit",
    "irreducible",
    "minimize",
    "run",
    "support",
    "timeout",
    "verify_point",
]
