"""Which elements of an expression depend on which components of its readings: by structure, not by derivatives."""

from __future__ import annotations

import numpy as np

from cpcal.solver.network.tape import Tape


def exclusive(tape: Tape) -> bool:
    """Whether no component of a reading enters two elements of the roots: else one value of it must serve both."""
    readings = tape.reach.leaf[tape.reach.leaf >= tape.given]
    return len(np.unique(readings)) == len(readings)
