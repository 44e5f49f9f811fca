"""Directed rounding of single operations on float64 numbers, as compiled functions: a bound below, a bound above.

The processor rounds to nearest; the result is then moved one float outward (two at some of the smallest normal
numbers) as in `rounding`, which does the same for arrays. A `below` is never +inf and an `above` never -inf: overflow
becomes the largest float on its safe side. NaN goes through.

What makes them bounds: `v - |v| PHI` is at least one float below a normal v, since |v| PHI is at least 0.75 units in
its last place; sums that are subnormal are exact; other subnormal results are moved by ETA, the least float.
"""

from __future__ import annotations

import math

from cpcal.solver.compiled import compiled

MAX = 1.7976931348623157e308
ETA = 5e-324
PHI = 0.75 * 2.0**-52


@compiled
def lowered(v: float) -> float:
    """Less than every number that rounds to v, and than those one float away from it in relative terms."""
    if v > MAX:
        v = MAX
    return v - (abs(v) * PHI + ETA)


@compiled
def raised(v: float) -> float:
    if v < -MAX:
        v = -MAX
    return v + (abs(v) * PHI + ETA)


@compiled
def sum_below(a: float, b: float) -> float:
    v = a + b
    if a == 0.0 or b == 0.0:
        return v
    if v > MAX:
        v = MAX
    return v - abs(v) * PHI


@compiled
def sum_above(a: float, b: float) -> float:
    v = a + b
    if a == 0.0 or b == 0.0:
        return v
    if v < -MAX:
        v = -MAX
    return v + abs(v) * PHI


@compiled
def product_below(a: float, b: float) -> float:
    """A bound of a b, where 0 times infinity is 0."""
    v = a * b
    if a == 0.0 or b == 0.0:
        return 0.0 if a == a and b == b else v
    if v == 0.0:
        return 0.0 if (a > 0.0) == (b > 0.0) else -ETA
    return lowered(v)


@compiled
def product_above(a: float, b: float) -> float:
    v = a * b
    if a == 0.0 or b == 0.0:
        return 0.0 if a == a and b == b else v
    if v == 0.0:
        return ETA if (a > 0.0) == (b > 0.0) else 0.0
    return raised(v)


@compiled
def quotient_below(a: float, b: float) -> float:
    """A bound of a / b for b that is not 0; at least one of them is finite."""
    v = a / b
    if v == 0.0:
        return 0.0 if a == 0.0 or (a > 0.0) == (b > 0.0) else -ETA
    return lowered(v)


@compiled
def quotient_above(a: float, b: float) -> float:
    v = a / b
    if v == 0.0:
        return 0.0 if a == 0.0 or (a > 0.0) != (b > 0.0) else ETA
    return raised(v)


@compiled
def root_below(a: float) -> float:
    """A bound of the square root of a >= 0. It is never subnormal, so that zero stays zero."""
    v = min(math.sqrt(a), MAX) if a == math.inf else math.sqrt(a)
    return v - v * PHI


@compiled
def root_above(a: float) -> float:
    v = math.sqrt(a)
    return v + v * PHI


@compiled
def power_below(m: float, n: int) -> float:
    """A bound of m ** n for m >= 0 and n >= 1."""
    result, known = 1.0, False
    while True:
        if n & 1:
            result = max(product_below(result, m), 0.0) if known else m
            known = True
        n >>= 1
        if n == 0:
            return min(result, MAX)
        m = max(product_below(m, m), 0.0)


@compiled
def power_above(m: float, n: int) -> float:
    result, known = 1.0, False
    while True:
        if n & 1:
            result = product_above(result, m) if known else m
            known = True
        n >>= 1
        if n == 0:
            return result
        m = product_above(m, m)


@compiled
def nth_root_below(m: float, n: int) -> float:
    """A bound of the n-th root of m >= 0 for n >= 1: a floating-point guess, lowered until its n-th power proves it."""
    if m == 0.0 or n == 1:
        return min(m, MAX)
    if m == math.inf:
        return MAX
    bound, step = math.exp(math.log(m) / n), 2.0 * PHI
    while step < 1.0:
        bound = bound - bound * step
        if power_above(bound, n) <= m:
            return bound
        step *= 2.0
    return 0.0


@compiled
def nth_root_above(m: float, n: int) -> float:
    if m == 0.0 or n == 1 or m == math.inf:
        return m
    bound, step = math.exp(math.log(m) / n), 2.0 * PHI
    while step < 1.0:
        bound = bound + bound * step
        if power_below(bound, n) >= m:
            return bound
        step *= 2.0
    return math.inf
