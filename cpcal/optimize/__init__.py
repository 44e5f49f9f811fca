"""Smallest values, bounded from both sides."""

from cpcal.optimize.bound import Bracket, Minimum, minimize, run
from cpcal.optimize.fit import fit
from cpcal.optimize.judge import Judgement, judge
from cpcal.optimize.support import irreducible, support
from cpcal.optimize.timeout import Answer, Outcome, Trial, ask, timeout
from cpcal.optimize.witness import Witness, WitnessProver

__all__ = [
    "Answer",
    "Bracket",
    "Judgement",
    "Minimum",
    "Outcome",
    "Trial",
    "Witness",
    "WitnessProver",
    "ask",
    "fit",
    "irreducible",
    "judge",
    "minimize",
    "run",
    "support",
    "timeout",
]
