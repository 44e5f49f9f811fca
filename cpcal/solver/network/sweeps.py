"""The sweeps over a tape, as compiled functions: forward, backward (hc4), derivatives from the roots to the leaves.

A tape is a table of operations: `code` (P,), `arg` (P, 2) slots of the arguments (twice the same for one argument),
`par` (P,) exponents. Operation k fills slot `first + k`; the slots before `first` are leaves: the n components of a
box, then constants, then readings. Bounds of one box are two arrays of all slots, `lo` and `hi`.
"""

from __future__ import annotations

import math

import numpy as np

from cpcal.common.values import Bools, Floats, Ints
from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import add, meet, mul
from cpcal.solver.interval.operations import first_argument, partials, quality, second_argument, slopes, value


@compiled
def forward(code: Ints, arg: Ints, par: Ints, first: int, lo: Floats, hi: Floats) -> None:
    """Values of all operations, from the leaves, which are in `lo` and `hi` already."""
    for k in range(len(code)):
        a, b = arg[k, 0], arg[k, 1]
        lo[first + k], hi[first + k] = value(code[k], par[k], lo[a], hi[a], lo[b], hi[b])


@compiled
def forward_all(
    code: Ints, arg: Ints, par: Ints, first: int, boxes_lo: Floats, boxes_hi: Floats, lo: Floats, hi: Floats
) -> None:
    """The same for B boxes (B, n): `lo`, `hi` (B, M) hold constants and readings."""
    n = boxes_lo.shape[1]
    for r in range(len(boxes_lo)):
        lo[r, :n], hi[r, :n] = boxes_lo[r], boxes_hi[r]
        forward(code, arg, par, first, lo[r], hi[r])


@compiled
def backward(code: Ints, arg: Ints, par: Ints, first: int, variable: int, given: int, lo: Floats, hi: Floats) -> bool:
    """Narrow the arguments of every operation, last to first; False where some slot holds no number any more.

    Slots from `variable` to `given` are constants, which stay as they are: where no value of a constant fits, none
    of the other argument does.
    """
    for k in range(len(code) - 1, -1, -1):
        a, b, z = arg[k, 0], arg[k, 1], first + k
        z_lo, z_hi = lo[z], hi[z]
        if not z_lo <= z_hi:
            return False
        a_lo, a_hi, b_lo, b_hi = lo[a], hi[a], lo[b], hi[b]
        if a < variable or a >= given:
            low, high = first_argument(code[k], par[k], z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)
            low, high = meet(low, high, a_lo, a_hi)
            if not low <= high:
                return False
            lo[a], hi[a] = low, high
        if a != b and (b < variable or b >= given):
            low, high = second_argument(code[k], par[k], z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)
            low, high = meet(low, high, b_lo, b_hi)
            if not low <= high:
                return False
            lo[b], hi[b] = low, high
    return True


@compiled
def hc4(
    code: Ints, arg: Ints, par: Ints, first: int, variable: int, given: int, roots: Ints, lo: Floats, hi: Floats
) -> bool:
    """One forward and one backward sweep for `root <= 0`; False where no point of the box is left."""
    forward(code, arg, par, first, lo, hi)
    for root in roots:
        if not lo[root] <= 0.0:
            return False
        hi[root] = min(hi[root], 0.0)
    return backward(code, arg, par, first, variable, given, lo, hi)


@compiled
def contract_all(
    code: Ints,
    arg: Ints,
    par: Ints,
    first: int,
    given: int,
    roots: Ints,
    leaves_lo: Floats,
    leaves_hi: Floats,
    boxes_lo: Floats,
    boxes_hi: Floats,
    sweeps: int,
) -> None:
    """hc4 on B boxes (B, n), in place, `sweeps` times each or until nothing moves; NaN where nothing is left."""
    n, size = boxes_lo.shape[1], first + len(code)
    lo, hi = np.empty(size), np.empty(size)
    for r in range(len(boxes_lo)):
        lo[:n], hi[:n] = boxes_lo[r], boxes_hi[r]
        lo[n:first], hi[n:first] = leaves_lo, leaves_hi
        for _ in range(sweeps):
            if not hc4(code, arg, par, first, n, given, roots, lo, hi):
                boxes_lo[r], boxes_hi[r] = np.nan, np.nan
                break
            moved = False
            for j in range(n):
                if lo[j] > boxes_lo[r, j] or hi[j] < boxes_hi[r, j]:
                    moved = True
                boxes_lo[r, j], boxes_hi[r, j] = lo[j], hi[j]
            if not moved:
                break


@compiled
def qualities(code: Ints, arg: Ints, par: Ints, lo: Floats, hi: Floats, out: Ints) -> None:
    """The quality of every operation (P,) on all points that the slots enclose."""
    for k in range(len(code)):
        a, b = arg[k, 0], arg[k, 1]
        out[k] = quality(code[k], par[k], lo[a], hi[a], lo[b], hi[b])


@compiled
def all_partials(code: Ints, arg: Ints, par: Ints, first: int, lo: Floats, hi: Floats, out: Floats) -> None:
    """Partial derivatives of every operation over slots: `out` (P, 4)."""
    for k in range(len(code)):
        a, b, z = arg[k, 0], arg[k, 1], first + k
        out[k] = partials(code[k], par[k], lo[z], hi[z], lo[a], hi[a], lo[b], hi[b])


@compiled
def all_slopes(
    code: Ints, arg: Ints, par: Ints, first: int, c_lo: Floats, c_hi: Floats, lo: Floats, hi: Floats, out: Floats
) -> None:
    """Slopes of every operation from the slots at a centre to those anywhere: `out` (P, 4)."""
    for k in range(len(code)):
        a, b, z = arg[k, 0], arg[k, 1], first + k
        center = (c_lo[z], c_hi[z], c_lo[a], c_hi[a], c_lo[b], c_hi[b])
        anywhere = (lo[z], hi[z], lo[a], hi[a], lo[b], hi[b])
        out[k] = slopes(code[k], par[k], center, anywhere)


@compiled
def scaled(g_lo: float, g_hi: float, p_lo: float, p_hi: float) -> tuple[float, float]:
    """The product; exact where one factor is 1 or -1."""
    if g_lo == g_hi and abs(g_lo) == 1.0:
        g_lo, g_hi, p_lo, p_hi = p_lo, p_hi, g_lo, g_hi
    if p_lo == p_hi and abs(p_lo) == 1.0:
        return (g_lo, g_hi) if p_lo == 1.0 else (-g_hi, -g_lo)
    return mul(g_lo, g_hi, p_lo, p_hi)


@compiled
def needed(arg: Ints, first: int, roots: Ints) -> Bools:
    """Which operations (P,) some root is computed from."""
    out = np.zeros(len(arg), np.bool_)
    for root in roots:
        if root >= first:
            out[root - first] = True
    for k in range(len(arg) - 1, -1, -1):
        if out[k]:
            for a in arg[k]:
                if a >= first:
                    out[a - first] = True
    return out


@compiled
def reach(arg: Ints, first: int, variable: int, given: int, roots: Ints, start: Ints, order: Ints) -> int:
    """What each root is computed from: slots of operations, then of variables and readings, the last ones first.

    Those of root r go to `order` from `start[r]` on, if there is room; how many there are in all.
    """
    seen = np.full(first + len(arg), -1, np.int64)
    stack = np.empty(2 * len(arg) + 2, np.int64)
    count = 0
    for r in range(len(roots)):
        start[r] = count
        stack[0], depth = roots[r], 1
        while depth:
            depth -= 1
            k = stack[depth]
            if seen[k] == r or variable <= k < given:
                continue
            seen[k] = r
            if count < len(order):
                order[count] = k
            count += 1
            if k >= first:
                stack[depth], stack[depth + 1] = arg[k - first, 0], arg[k - first, 1]
                depth += 2
        if count <= len(order):
            order[start[r] : count] = -np.sort(-order[start[r] : count])
    start[len(roots)] = count
    return count


@compiled
def gradients(
    arg: Ints,
    first: int,
    variable: int,
    given: int,
    roots: Ints,
    start: Ints,
    order: Ints,
    factors: Floats,
    out_lo: Floats,
    out_hi: Floats,
) -> None:
    """Derivatives of every root by its leaves, from those of the operations (P, 4), where `order` lists the leaves."""
    size = first + len(arg)
    lo, hi = np.zeros(size), np.zeros(size)
    for r in range(len(roots)):
        lo[roots[r]] = hi[roots[r]] = 1.0
        for p in range(start[r], start[r + 1]):
            k = order[p]
            g_lo, g_hi = lo[k], hi[k]
            lo[k] = hi[k] = 0.0
            if k < first:
                out_lo[p], out_hi[p] = g_lo, g_hi
                continue
            if g_lo == 0.0 and g_hi == 0.0:
                continue
            f = factors[k - first]
            a, b = arg[k - first, 0], arg[k - first, 1]
            if a < variable or a >= given:
                s_lo, s_hi = scaled(g_lo, g_hi, f[0], f[1])
                lo[a], hi[a] = add(lo[a], hi[a], s_lo, s_hi)
            if b < variable or b >= given:
                s_lo, s_hi = scaled(g_lo, g_hi, f[2], f[3])
                lo[b], hi[b] = add(lo[b], hi[b], s_lo, s_hi)


@compiled
def row_products(
    start: Ints, order: Ints, begin: int, end: int, g_lo: Floats, g_hi: Floats, x: Floats, lo: Floats, hi: Floats
) -> None:
    """Add to `lo`, `hi` of every root its derivatives by the leaves in [begin, end) times their bounds x (M, 2)."""
    for r in range(len(start) - 1):
        for p in range(start[r], start[r + 1]):
            k = order[p]
            if begin <= k < end:
                low, high = mul(g_lo[p], g_hi[p], x[k, 0], x[k, 1])
                lo[r], hi[r] = add(lo[r], hi[r], low, high)


@compiled
def row_qualities(first: int, start: Ints, order: Ints, operations: Ints, out: Ints) -> None:
    """For every root the least quality of the operations that depend on variables or readings."""
    for r in range(len(start) - 1):
        for p in range(start[r], start[r + 1]):
            if order[p] >= first:
                out[r] = min(out[r], operations[order[p] - first])


@compiled
def point_jacobians(
    code: Ints,
    arg: Ints,
    par: Ints,
    first: int,
    given: int,
    roots: Ints,
    start: Ints,
    order: Ints,
    leaves_lo: Floats,
    leaves_hi: Floats,
    points: Floats,
    out: Floats,
) -> None:
    """About the derivatives of every root by the components of a box at B points (B, n): `out` (B, K, n), of zeros.

    What is not defined, as the derivative of a norm at zero, stays 0.
    """
    n, size = points.shape[1], first + len(code)
    lo, hi = np.empty(size), np.empty(size)
    factors, g_lo, g_hi = np.empty((len(code), 4)), np.empty(len(order)), np.empty(len(order))
    for b in range(len(points)):
        lo[:n], hi[:n] = points[b], points[b]
        lo[n:first], hi[n:first] = leaves_lo, leaves_hi
        forward(code, arg, par, first, lo, hi)
        all_partials(code, arg, par, first, lo, hi, factors)
        gradients(arg, first, n, given, roots, start, order, factors, g_lo, g_hi)
        for r in range(len(roots)):
            for p in range(start[r], start[r + 1]):
                middle = 0.5 * g_lo[p] + 0.5 * g_hi[p]
                if order[p] < n and math.isfinite(middle):
                    out[b, r, order[p]] = middle
