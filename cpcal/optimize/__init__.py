"""Smallest values, bounded from both sides."""

from cpcal.optimize.bound import Bracket, Minimum, minimize, run
from cpcal.optimize.fit import fit
from cpcal.optimize.support import irreducible, support
from cpcal.optimize.witness import Witness, WitnessProver

__all__ = ["Bracket", "Minimum", "Witness", "WitnessProver", "fit", "irreducible", "minimize", "run", "support"]
