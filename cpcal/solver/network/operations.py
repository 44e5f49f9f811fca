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
from cpcal.solver.interval.functions import (
    acos,
    asin,
    atan,
    atan2,
    cos,
    cosh,
    exp,
    expm1,
    has_pole,
    log,
    log1p,
    pow_real,
    sin,
    sinh,
    tan,
    tanh,
)
from cpcal.solver.interval.kernels import (
    Bounds,
    absolute,
    add,
    ceil,
    div,
    floor,
    larger,
    mul,
    neg,
    power,
    sign,
    smaller,
    sqr,
    sqrt,
    sub,
)

SELECTS = 1  # parameter of a "mul" by zeros and ones: 0 wherever the factor is 0, also where the other is not defined
NEG, ADD, SUB, MUL, DIV, SQR, SQRT, POWER, ABS, MIN, MAX = range(11)
EXP, EXPM1, LOG, LOG1P, SIN, COS, TAN, ASIN, ACOS, ATAN, SINH, COSH, TANH, POW, ATAN2, FLOOR, CEIL, SIGN = range(11, 29)

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
    "exp": Operation(EXP, 1),
    "expm1": Operation(EXPM1, 1),
    "log": Operation(LOG, 1),
    "log1p": Operation(LOG1P, 1),
    "sin": Operation(SIN, 1),
    "cos": Operation(COS, 1),
    "tan": Operation(TAN, 1),
    "asin": Operation(ASIN, 1),
    "acos": Operation(ACOS, 1),
    "atan": Operation(ATAN, 1),
    "sinh": Operation(SINH, 1),
    "cosh": Operation(COSH, 1),
    "tanh": Operation(TANH, 1),
    "pow": Operation(POW, 2),
    "atan2": Operation(ATAN2, 2),
    "floor": Operation(FLOOR, 1),
    "ceil": Operation(CEIL, 1),
    "sign": Operation(SIGN, 1),
}


@compiled
def _function(code: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    if code == EXP:
        return exp(a_lo, a_hi)
    if code == EXPM1:
        return expm1(a_lo, a_hi)
    if code == LOG:
        return log(a_lo, a_hi)
    if code == LOG1P:
        return log1p(a_lo, a_hi)
    if code == SIN:
        return sin(a_lo, a_hi)
    if code == COS:
        return cos(a_lo, a_hi)
    if code == TAN:
        return tan(a_lo, a_hi)
    if code == ASIN:
        return asin(a_lo, a_hi)
    if code == ACOS:
        return acos(a_lo, a_hi)
    if code == ATAN:
        return atan(a_lo, a_hi)
    if code == SINH:
        return sinh(a_lo, a_hi)
    if code == COSH:
        return cosh(a_lo, a_hi)
    if code == TANH:
        return tanh(a_lo, a_hi)
    if code == FLOOR:
        return floor(a_lo, a_hi)
    if code == CEIL:
        return ceil(a_lo, a_hi)
    if code == SIGN:
        return sign(a_lo, a_hi)
    if code == POW:
        return pow_real(a_lo, a_hi, b_lo, b_hi)
    if code == ATAN2:
        return atan2(a_lo, a_hi, b_lo, b_hi)
    return math.nan, math.nan


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
    return _function(code, a_lo, a_hi, b_lo, b_hi)


@compiled
def _function_quality(code: int, a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> int:
    if code == LOG:
        return CONTINUOUS if a_lo > 0.0 else ANYTHING
    if code == LOG1P:
        return CONTINUOUS if a_lo > -1.0 else ANYTHING
    if code in (ASIN, ACOS):
        return CONTINUOUS if a_lo >= -1.0 and a_hi <= 1.0 else ANYTHING
    if code == TAN:
        return ANYTHING if has_pole(a_lo, a_hi) else CONTINUOUS
    if code == POW:
        return CONTINUOUS if a_lo > 0.0 or (a_lo == 0.0 and b_lo > 0.0) else ANYTHING
    if code == ATAN2:
        if b_lo > 0.0 or a_lo > 0.0 or a_hi < 0.0:
            return CONTINUOUS
        return DEFINED if b_hi < 0.0 else ANYTHING
    if code in (FLOOR, CEIL, SIGN):
        low, high = _function(code, a_lo, a_hi, b_lo, b_hi)
        return CONTINUOUS if low == high and a_lo < a_hi else DEFINED
    return CONTINUOUS


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
    if code > MAX:
        return _function_quality(code, a_lo, a_hi, b_lo, b_hi)
    return CONTINUOUS
