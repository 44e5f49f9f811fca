"""Units that data come in, by their usual abbreviations, and their size in mm and rad, which cpcal computes in."""

from __future__ import annotations

import math
from decimal import Decimal

from cpcal.common.errors import Problem, shown

LENGTHS = {"mm": Decimal(1), "cm": Decimal(10), "m": Decimal(1000), "um": Decimal("0.001"), "in": Decimal("25.4")}
NAMES = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "um": "micrometres", "in": "inches"}
ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}


def length_factor(unit: str, where: str) -> float | Problem:
    """How many mm the unit is, or what is wrong with its name; `where` says what is in that unit."""
    return float(LENGTHS[unit]) if unit in LENGTHS else _unknown(unit, where, LENGTHS)


def _unknown(unit: str, where: str, known: dict[str, Decimal] | dict[str, float]) -> Problem:
    return Problem(where, f"has the unknown unit {shown(unit)}", "give one of " + ", ".join(known))
