"""Smallest values, bounded from both sides."""

from cpcal.solver.optimize.bound import minimize, run
from cpcal.solver.optimize.incumbent import Known
from cpcal.solver.optimize.local_minimum import fit
from cpcal.solver.optimize.minimum import Bracket, Minimum
from cpcal.solver.optimize.prepared import Prepared
from cpcal.solver.optimize.support import Alone, irreducible, support
from cpcal.solver.optimize.timeout import TimeoutOutcome, ask, timeout
from cpcal.solver.optimize.verify_point import PointVerdicts, verify_point
from cpcal.solver.optimize.witness import Witness, WitnessProver

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
