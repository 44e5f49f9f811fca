"""Smallest values, bounded from both sides."""

from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.local import Known, fit
from cpcal.solver.optimize.minimum import Alone, Bracket, Minimum, irreducible, support
from cpcal.solver.optimize.timeout import TimeoutOutcome, ask, timeout
from cpcal.solver.optimize.witness import PointVerdicts, Prepared, Witness, WitnessProver, verify_point

__all__ = [
    "Alone",
    "Bracket",
    "Known",
    "Minimum",
    "PointVerdicts",
    "Prepared",
    "TimeoutOutcome",
    "Witness",
    "WitnessProver",
    "ask",
    "fit",
    "irreducible",
    "minimize",
    "run",
    "support",
    "timeout",
    "verify_point",
]
