"""The table of operations: every operation on scalars has a code, and its interval extension stands in `value`.

This file, `inverses` (backward) and `derivatives` (partial derivatives, slopes) are what defines an operation. They
are compiled functions on bounds. Expressions of arrays are written out as scalar operations by `tape`; "index" and
"sum" do not outlive that.

Rebound (`rebound`) to other primitives than those of `interval.kernels`, the same definitions compute in arb.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import (
    Bounds,
    absolute,
    add,
    div,
    larger,
    mul,
    neg,
    power,
    smaller,
    sqr,
    sqrt,
    sub,
)

NEG, ADD, SUB, MUL, DIV, SQR, SQRT, POWER, ABS, MIN, MAX = range(11)

# What is known of an operation on all points of its arguments, as the decorations of IEEE 1788.
ANYTHING, DEFINED, CONTINUOUS = range(3)


@dataclass(frozen=True)
class Operation:
    """A row of the table: the code of an operation in a tape and how many arguments it takes."""

    code: int
    arity: int


TABLE: dict[str, Operation] = {
    "neg": Operation(NEG, 1),
    "add": Operation(ADD, 2),
    "sub": Operation(SUB, 2),
    "mul": Operation(MUL, 2),
    "div": Operation(DIV, 2),
    "sqr": Operation(SQR, 1),
    "sqrt": Operation(SQRT, 1),
    "power": Operation(POWER, 1),
    "abs": Operation(ABS, 1),
    "min": Operation(MIN, 2),
    "max": Operation(MAX, 2),
}


@compiled
def value(code: int, n: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """Enclosure of the operation over its arguments (b: the second, if there is one); n is a power's exponent."""
    if code == MUL:
        return mul(a_lo, a_hi, b_lo, b_hi)
    if code == ADD:
        return add(a_lo, a_hi, b_lo, b_hi)
    if code == SUB:
        return sub(a_lo, a_hi, b_lo, b_hi)
    if code == SQR:
        return sqr(a_lo, a_hi)
    if code == NEG:
        return neg(a_lo, a_hi)
    if code == SQRT:
        return sqrt(a_lo, a_hi)
    if code == DIV:
        return div(a_lo, a_hi, b_lo, b_hi)
    if code == POWER:
        return power(a_lo, a_hi, n)
    if code == ABS:
        return absolute(a_lo, a_hi)
    if code == MIN:
        return smaller(a_lo, a_hi, b_lo, b_hi)
    if code == MAX:
        return larger(a_lo, a_hi, b_lo, b_hi)
    return math.nan, math.nan


@compiled
def quality(code: int, n: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> int:
    """Whether the operation is CONTINUOUS at all points of its arguments, or at least DEFINED there, or ANYTHING."""
    if not (a_lo <= a_hi and b_lo <= b_hi):
        return ANYTHING
    if code == SQRT:
        return CONTINUOUS if a_lo >= 0.0 else ANYTHING
    if code == DIV:
        return CONTINUOUS if b_lo > 0.0 or b_hi < 0.0 else ANYTHING
    if code == POWER:
        return CONTINUOUS if n >= 0 or a_lo > 0.0 or a_hi < 0.0 else ANYTHING
    return CONTINUOUS
