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
from cpcal.solver.interval.functions import cos, cosh, has_pole, log, pow_real, sin, sinh
from cpcal.solver.interval.kernels import MAX as FLOAT_MAX
from cpcal.solver.interval.kernels import Bounds, add, div, hull, meet, mul, neg, power, sqr, sqrt, sub
from cpcal.solver.network.inverses import first_argument, second_argument
from cpcal.solver.network.operations import (
    ABS,
    ACOS,
    ADD,
    ATAN,
    ATAN2,
    CEIL,
    COS,
    COSH,
    DIV,
    EXP,
    EXPM1,
    FLOOR,
    LOG,
    LOG1P,
    MAX,
    MIN,
    MUL,
    NEG,
    POW,
    POWER,
    SIGN,
    SIN,
    SINH,
    SQR,
    SQRT,
    SUB,
    TAN,
    TANH,
    quality,
    value,
)

# ------------------------------------------------------------------------------------------------------------------
# Partial derivatives of operations, and their slopes.
#
# What the derivative is to the mean value form, the slope is to the slope form. For an operation phi with arguments
# u(c) at a centre c and u(x) anywhere, numbers p_j with
#
#     phi(u(x)) - phi(u(c)) = sum_j p_j (u_j(x) - u_j(c))                       (Krawczyk and Neumaier)
#
# are enclosed. That is algebra, not calculus: it holds wherever both sides are defined, next to poles and kinks, and
# the enclosure is about half as wide as that of the derivative. Operations without a slope of their own use their
# derivative over the hull of both values: it holds all such slopes.

Partials = tuple[float, float, float, float]  # bounds of the derivatives by the first and the second argument


@compiled
def _sign(lo: float, hi: float) -> Bounds:
    """Derivative of abs: 1, -1, or anything between where zero is inside (or nothing else)."""
    return 1.0 if lo >= 0.0 and hi > 0.0 else -1.0, -1.0 if hi <= 0.0 and lo < 0.0 else 1.0


@compiled
def _share_of_smaller(a_lo: float, a_hi: float, b_lo: float, b_hi: float) -> Bounds:
    """Derivative of min(a, b) with respect to a: 1 where a is smaller, 0 where b is, else [0, 1]."""
    return 1.0 if a_hi <= b_lo else 0.0, 0.0 if a_lo > b_hi else 1.0


@compiled
def _times_power(n: int, a_lo: float, a_hi: float) -> Bounds:
    """n a^(n-1)"""
    if n == 0:
        return 0.0, 0.0
    low, high = power(a_lo, a_hi, n - 1)
    return mul(float(n), float(n), low, high)


@compiled
def _of_angle(y_lo: float, y_hi: float, x_lo: float, x_hi: float) -> Partials:
    """x / (x^2 + y^2) and -y / (x^2 + y^2); nothing is known across the cut."""
    if not (x_lo > 0.0 or y_lo > 0.0 or y_hi < 0.0):
        return -math.inf, math.inf, -math.inf, math.inf
    s_lo, s_hi = sqr(x_lo, x_hi)
    t_lo, t_hi = sqr(y_lo, y_hi)
    s_lo, s_hi = add(s_lo, s_hi, t_lo, t_hi)
    low, high = div(x_lo, x_hi, s_lo, s_hi)
    t_lo, t_hi = div(-y_hi, -y_lo, s_lo, s_hi)
    return low, high, t_lo, t_hi


@compiled
def _of_function(code: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float) -> Bounds:
    """Of an elementary function of one argument; the whole line where it jumps or has a pole."""
    if code == EXP:
        return z_lo, z_hi
    if code == EXPM1:
        return add(z_lo, z_hi, 1.0, 1.0)
    if code == SIN:
        return cos(a_lo, a_hi)
    if code == COS:
        low, high = sin(a_lo, a_hi)
        return -high, -low
    if code == SINH:
        return cosh(a_lo, a_hi)
    if code == COSH:
        return sinh(a_lo, a_hi)
    if code == TAN:
        if has_pole(a_lo, a_hi):
            return -math.inf, math.inf
        low, high = sqr(z_lo, z_hi)
        return add(low, high, 1.0, 1.0)
    if code == TANH:
        low, high = sqr(z_lo, z_hi)
        return sub(1.0, 1.0, low, high)
    if code in (FLOOR, CEIL, SIGN):
        return (0.0, 0.0) if z_lo == z_hi else (-math.inf, math.inf)
    low, high = a_lo, a_hi  # the others are 1 over something
    if code == LOG:
        low = max(low, 0.0)
    elif code == LOG1P:
        low, high = add(max(low, -1.0), high, 1.0, 1.0)
    elif code == ATAN:
        low, high = sqr(low, high)
        low, high = add(low, high, 1.0, 1.0)
    else:
        low, high = sqr(low, high)
        low, high = sub(1.0, 1.0, low, high)
        low, high = sqrt(low, high)
        if code == ACOS:
            low, high = -high, -low
    return div(1.0, 1.0, low, high)


@compiled
def partials(
    code: int, n: int, z_lo: float, z_hi: float, a_lo: float, a_hi: float, b_lo: float, b_hi: float
) -> Partials:
    """Enclosures of the partial derivatives; of abs, min and max generalised ones. z is the operation's value."""
    if code == MUL:
        return b_lo, b_hi, a_lo, a_hi
    if code == ADD:
        return 1.0, 1.0, 1.0, 1.0
    if code == SUB:
        return 1.0, 1.0, -1.0, -1.0
    low, high, b_low, b_high = 0.0, 0.0, 0.0, 0.0
    if code == SQR:
        low, high = min(2.0 * a_lo, FLOAT_MAX), max(2.0 * a_hi, -FLOAT_MAX)
    elif code == NEG:
        low, high = -1.0, -1.0
    elif code == SQRT:
        low, high = div(0.5, 0.5, z_lo, z_hi)
    elif code == DIV:
        low, high = div(1.0, 1.0, b_lo, b_hi)
        q_lo, q_hi = div(z_lo, z_hi, b_lo, b_hi)
        b_low, b_high = neg(q_lo, q_hi)
    elif code == POWER:
        low, high = _times_power(n, a_lo, a_hi)
    elif code == ABS:
        low, high = _sign(a_lo, a_hi)
    elif code == MIN:
        low, high = _share_of_smaller(a_lo, a_hi, b_lo, b_hi)
        b_low, b_high = 1.0 - high, 1.0 - low
    elif code == MAX:
        low, high = _share_of_smaller(-a_hi, -a_lo, -b_hi, -b_lo)
        b_low, b_high = 1.0 - high, 1.0 - low
    elif code == POW:
        low, high = sub(b_lo, b_hi, 1.0, 1.0)
        low, high = pow_real(a_lo, a_hi, low, high)
        low, high = mul(b_lo, b_hi, low, high)
        b_low, b_high = log(a_lo, a_hi)
        b_low, b_high = mul(z_lo, z_hi, b_low, b_high)
    elif code == ATAN2:
        return _of_angle(a_lo, a_hi, b_lo, b_hi)
    else:
        low, high = _of_function(code, z_lo, z_hi, a_lo, a_hi)
    return low, high, b_low, b_high


@compiled
def _power_slope(n: int, c_lo: float, c_hi: float, u_lo: float, u_hi: float) -> Bounds:
    """u^n - c^n = (u - c) sum_k u^k c^(n-1-k); for n < 0 that of -n, divided by -(u c)^-n."""
    if n == 0:
        return 0.0, 0.0
    m = abs(n)
    low, high = power(c_lo, c_hi, m - 1)
    for k in range(1, m):
        p_lo, p_hi = power(u_lo, u_hi, k)
        q_lo, q_hi = power(c_lo, c_hi, m - 1 - k)
        t_lo, t_hi = mul(p_lo, p_hi, q_lo, q_hi)
        low, high = add(low, high, t_lo, t_hi)
    if n > 0:
        h_lo, h_hi = hull(u_lo, u_hi, c_lo, c_hi)
        d_lo, d_hi = _times_power(n, h_lo, h_hi)
        return meet(low, high, d_lo, d_hi)
    p_lo, p_hi = power(u_lo, u_hi, m)
    q_lo, q_hi = power(c_lo, c_hi, m)
    t_lo, t_hi = mul(p_lo, p_hi, q_lo, q_hi)
    low, high = div(low, high, t_lo, t_hi)
    return -high, -low


@compiled
def _abs_slope(c_lo: float, c_hi: float, u_lo: float, u_hi: float) -> Bounds:
    """1 or -1 where u and c have one sign; else, for c > 0 > u, from (c - |u|) / (c + |u|) to 1: it grows in both."""
    if u_lo >= 0.0 and c_lo >= 0.0:
        return 1.0, 1.0
    if u_hi <= 0.0 and c_hi <= 0.0:
        return -1.0, -1.0
    flipped = c_hi < 0.0  # the slope of |.| between -u and -c is the opposite of that between u and c
    near = -c_hi if flipped else c_lo
    far = max(u_hi if flipped else -u_lo, 0.0)
    least = -1.0
    if 0.0 < near < math.inf and far < math.inf:
        over_lo, over_hi = sub(near, near, far, far)
        under_lo, under_hi = add(near, near, far, far)
        low, _ = div(over_lo, over_hi, under_lo, under_hi)
        least = max(low, -1.0)
    return (-1.0, -least) if flipped else (least, 1.0)


@compiled
def slopes(
    code: int,
    n: int,
    c: tuple[float, float, float, float, float, float],
    u: tuple[float, float, float, float, float, float],
) -> Partials:
    """Enclosures of the slopes from the centre to anywhere; c and u hold the bounds of value and arguments there."""
    if code == MUL:  # u v - u_c v_c = v (u - u_c) + u_c (v - v_c)
        return u[4], u[5], c[2], c[3]
    if code == SQR:
        low, high = add(u[2], u[3], c[2], c[3])
    elif code == SQRT:
        low, high = add(u[0], u[1], c[0], c[1])
        low, high = div(1.0, 1.0, low, high)
    elif code == DIV:  # u/v - q_c = ((u - u_c) - q_c (v - v_c)) / v with q_c = u_c/v_c
        low, high = div(1.0, 1.0, u[4], u[5])
        q_lo, q_hi = div(c[0], c[1], u[4], u[5])
        return low, high, -q_hi, -q_lo
    elif code == POWER:
        low, high = _power_slope(n, c[2], c[3], u[2], u[3])
    elif code == ABS:
        low, high = _abs_slope(c[2], c[3], u[2], u[3])
    else:
        z_lo, z_hi = hull(u[0], u[1], c[0], c[1])
        a_lo, a_hi = hull(u[2], u[3], c[2], c[3])
        b_lo, b_hi = hull(u[4], u[5], c[4], c[5])
        return partials(code, n, z_lo, z_hi, a_lo, a_hi, b_lo, b_hi)
    return low, high, 0.0, 0.0


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
