"""A tape at one point in plain numbers, for proposals: nothing here is a bound."""

from __future__ import annotations

from cpcal.common.arrays import Floats, Ints
from cpcal.solver.compiled import compiled
from cpcal.solver.network.operations import ADD, MUL, SQR, SUB, value


@compiled
def near(code: Ints, arg: Ints, par: Ints, first: int, slots: Floats) -> None:
    """Numbers near the values of all operations at one point, from the leaves: for proposals, three times faster."""
    for k in range(len(code)):
        c, a, b = code[k], slots[arg[k, 0]], slots[arg[k, 1]]
        if c == ADD:
            slots[first + k] = a + b
        elif c == MUL:
            slots[first + k] = a * b
        elif c == SUB:
            slots[first + k] = a - b
        elif c == SQR:
            slots[first + k] = a * a
        else:
            lo, hi = value(c, par[k], a, a, b, b)
            slots[first + k] = 0.5 * lo + 0.5 * hi
