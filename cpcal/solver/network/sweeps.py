"""The sweeps over a tape, as compiled functions: forward, backward (hc4), derivatives from the roots to the leaves.

Slots of one box are a pair of arrays of all lower and all upper bounds.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cpcal.common.values import Bools, Floats
from cpcal.solver.compiled import compiled
from cpcal.solver.interval.kernels import Arrays, Bounds, add, at, meet, mul, neg
from cpcal.solver.interval.operations import (
    ADD,
    MUL,
    SQR,
    SUB,
    continuous,
    first_argument,
    partials,
    second_argument,
    value,
)

Places: TypeAlias = npt.NDArray[np.int32]  # 30,000 measurements have millions of slots


class Program(NamedTuple):
    """A table of operations: operation k fills slot `first + k`.

    The slots before are leaves: the components of a box, constants from `size` on, readings from `given` on.
    """

    code: Places  # (P,)
    arg: Places  # (P, 2): slots of the arguments, twice the same for one argument
    par: Places  # (P,): exponents
    roots: Places  # (K,): the slots of what is asked for
    size: int
    given: int
    first: int


class Reach(NamedTuple):
    """Sparse derivatives of the roots by variables and readings: entry p is that of root `row[p]` by `leaf[p]`.

    `order` lists, from `start[r]` on, what root r is computed from; `entry` are the places of its leaves in it.
    """

    start: Places
    order: Places
    entry: Places
    row: Places
    leaf: Places


@compiled
def arguments(p: Program, x: Arrays, k: int) -> tuple[Bounds, Bounds]:
    """Of operation k."""
    return at(x, p.arg[k, 0]), at(x, p.arg[k, 1])


@compiled
def forward(p: Program, x: Arrays) -> None:
    """Values of all operations, from the leaves, which are in the slots already."""
    for k in range(len(p.code)):
        a, b = arguments(p, x, k)
        x[0][p.first + k], x[1][p.first + k] = value(p.code[k], p.par[k], a, b)


@compiled
def forward_all(p: Program, x: Arrays) -> None:
    """The same for B boxes, in slots (B, M)."""
    for r in range(len(x[0])):
        forward(p, (x[0][r], x[1][r]))


@compiled
def near(p: Program, slots: Floats) -> None:
    """Numbers near the values of all operations at B points, in slots (B, M), from the leaves: for proposals."""
    for row in range(len(slots)):
        x = slots[row]
        for k in range(len(p.code)):
            c, a, b = p.code[k], x[p.arg[k, 0]], x[p.arg[k, 1]]
            if c == ADD:
                x[p.first + k] = a + b
            elif c in (MUL, SQR):  # a square's argument stands there twice
                x[p.first + k] = a * b
            elif c == SUB:
                x[p.first + k] = a - b
            else:
                lo, hi = value(c, p.par[k], (a, a), (b, b))
                x[p.first + k] = 0.5 * lo + 0.5 * hi


@compiled
def is_constant(p: Program, slot: int) -> bool:
    return p.size <= slot < p.given


@compiled
def backward(p: Program, x: Arrays) -> bool:
    """Narrow the arguments of every operation, last to first; False where some slot holds no number any more.

    Constants stay as they are: where no value of a constant fits, none of the other argument does.
    """
    for k in range(len(p.code) - 1, -1, -1):
        i, j, z = p.arg[k, 0], p.arg[k, 1], at(x, p.first + k)
        if not z[0] <= z[1]:
            return False
        a, b = at(x, i), at(x, j)
        if not is_constant(p, i):
            low, high = meet(first_argument(p.code[k], p.par[k], z, a, b), a)
            if not low <= high:
                return False
            x[0][i], x[1][i] = low, high
        if i != j and not is_constant(p, j):
            low, high = meet(second_argument(p.code[k], p.par[k], z, a, b), b)
            if not low <= high:
                return False
            x[0][j], x[1][j] = low, high
    return True


@compiled
def hc4(p: Program, x: Arrays) -> bool:
    """One forward and one backward sweep for `root <= 0`; False where no point of the box is left."""
    forward(p, x)
    for root in p.roots:
        if not x[0][root] <= 0.0:
            return False
        x[1][root] = min(x[1][root], 0.0)
    return backward(p, x)


@compiled
def contract_all(p: Program, leaves: Arrays, boxes: Arrays) -> None:
    """hc4 on B boxes (B, n), in place; NaN where nothing is left."""
    x = np.empty(p.first + len(p.code)), np.empty(p.first + len(p.code))
    for r in range(len(boxes[0])):
        lo, hi = boxes[0][r], boxes[1][r]
        x[0][: p.size], x[1][: p.size] = lo, hi
        x[0][p.size : p.first], x[1][p.size : p.first] = leaves
        if hc4(p, x):
            lo[:], hi[:] = x[0][: p.size], x[1][: p.size]
        else:
            lo[:], hi[:] = np.nan, np.nan


@compiled
def continuity(p: Program, x: Arrays, out: Bools) -> None:
    """Which operations (P,) are continuous at all points that the slots enclose."""
    for k in range(len(p.code)):
        a, b = arguments(p, x, k)
        out[k] = continuous(p.code[k], p.par[k], a, b)


@compiled
def all_partials(p: Program, x: Arrays, out: Floats) -> None:
    """Partial derivatives of every operation over slots: `out` (P, 4)."""
    for k in range(len(p.code)):
        a, b = arguments(p, x, k)
        z = at(x, p.first + k)
        (out[k, 0], out[k, 1]), (out[k, 2], out[k, 3]) = partials(p.code[k], p.par[k], z, a, b)


@compiled
def scaled(g: Bounds, p: Bounds) -> Bounds:
    """The product; exact where one factor is 1 or -1."""
    if g[0] == g[1] and abs(g[0]) == 1.0:
        g, p = p, g
    if p[0] == p[1] and abs(p[0]) == 1.0:
        return g if p[0] == 1.0 else neg(g)
    return mul(g, p)


@compiled
def needed(p: Program) -> Bools:
    """Which operations (P,) some root is computed from."""
    out = np.zeros(len(p.arg), np.bool_)
    for root in p.roots:
        if root >= p.first:
            out[root - p.first] = True
    for k in range(len(p.arg) - 1, -1, -1):
        if out[k]:
            for side in range(2):
                if p.arg[k, side] >= p.first:
                    out[p.arg[k, side] - p.first] = True
    return out


@compiled
def reached(p: Program) -> tuple[Places, Places]:
    """What each root is computed from: slots of operations, then of variables and readings, the last ones first.

    Those of root r stand in the second array, from the r-th number of the first one on.
    """
    seen = np.full(p.first + len(p.arg), -1, np.int32)
    queue, order = np.empty(len(seen), np.int32), np.empty(len(seen), np.int32)
    start = np.zeros(len(p.roots) + 1, np.int32)
    for r in range(len(p.roots)):
        queue[0], head, tail = p.roots[r], 0, 1
        while head < tail:
            k, head = queue[head], head + 1
            for side in range(2 if k >= p.first else 0):
                below = p.arg[k - p.first, side]
                if seen[below] != r and not is_constant(p, below):
                    seen[below] = r
                    queue[tail], tail = below, tail + 1
        start[r + 1] = start[r] + tail
        if start[r + 1] > len(order):
            order = np.append(order, order)  # there is room now, whatever it holds
        order[start[r] : start[r + 1]] = -np.sort(-queue[:tail])
    return start, order[: start[-1]].copy()


@compiled
def gradients(p: Program, reach: Reach, factors: Floats, out: Arrays) -> None:
    """Derivatives of every root by its leaves, from those of the operations (P, 4), where `order` lists the leaves."""
    size = p.first + len(p.arg)
    x = np.zeros(size), np.zeros(size)
    for r in range(len(p.roots)):
        x[0][p.roots[r]] = x[1][p.roots[r]] = 1.0
        for e in range(reach.start[r], reach.start[r + 1]):
            k = reach.order[e]
            g = at(x, k)
            x[0][k] = x[1][k] = 0.0
            if k < p.first:
                out[0][e], out[1][e] = g
                continue
            if g[0] == 0.0 and g[1] == 0.0:
                continue
            f, a, b = factors[k - p.first], p.arg[k - p.first, 0], p.arg[k - p.first, 1]
            if not is_constant(p, a):
                x[0][a], x[1][a] = add(at(x, a), scaled(g, (f[0], f[1])))
            if not is_constant(p, b):
                x[0][b], x[1][b] = add(at(x, b), scaled(g, (f[2], f[3])))


@compiled
def add_moves(p: Program, reach: Reach, g: Arrays, moves: Arrays, out: Arrays) -> None:
    """Add to `out`, of every root, its derivatives by the readings times the `moves` of constants and readings."""
    for r, e, k in zip(reach.row, reach.entry, reach.leaf):  # noqa: B905 - numba knows no `strict`
        if k >= p.given:
            out[0][r], out[1][r] = add(at(out, r), mul(at(g, e), at(moves, k - p.size)))


@compiled
def near_partials(code: int, par: int, z: float, a: float, b: float) -> tuple[float, float]:
    """About the partial derivatives of an operation with the value z."""
    if code in (ADD, SUB):
        return 1.0, 1.0 if code == ADD else -1.0
    if code == MUL:
        return b, a
    one, two = partials(code, par, (z, z), (a, a), (b, b))
    return 0.5 * one[0] + 0.5 * one[1], 0.5 * two[0] + 0.5 * two[1]


@compiled
def total_slopes(p: Program, x: Floats) -> Floats:
    """About the derivatives of the sum of all roots by every leaf at one point, whose values `near` has put into x."""
    g = np.zeros(len(x))
    for root in p.roots:
        g[root] += 1.0
    for k in range(len(p.code) - 1, -1, -1):
        slope, i, j = g[p.first + k], p.arg[k, 0], p.arg[k, 1]
        if slope != 0.0:
            one, two = near_partials(p.code[k], p.par[k], x[p.first + k], x[i], x[j])
            g[i] += slope * one
            g[j] += slope * two
    return g[: p.first]


@compiled
def slopes(p: Program, reach: Reach, slots: Floats, out: Floats) -> None:
    """About the derivatives of every root by its leaves at B points, whose values `near` has put into the slots (B, M).

    `out` (B, K, leaves), zeros, may leave out the last leaves. What is not defined, as the derivative of a norm at
    zero, is 0.
    """
    factors, g = np.empty((len(p.code), 2)), np.zeros(p.first + len(p.code))
    for row in range(len(slots)):
        x = slots[row]
        for k in range(len(p.code)):
            z, a, b = x[p.first + k], x[p.arg[k, 0]], x[p.arg[k, 1]]
            factors[k, 0], factors[k, 1] = near_partials(p.code[k], p.par[k], z, a, b)
        for r in range(len(p.roots)):
            g[p.roots[r]] = 1.0
            for e in range(reach.start[r], reach.start[r + 1]):
                k = reach.order[e]
                slope = g[k]
                g[k] = 0.0
                if k < p.first:
                    if k < out.shape[2] and math.isfinite(slope):
                        out[row, r, k] = slope
                elif slope != 0.0:
                    i, j = p.arg[k - p.first, 0], p.arg[k - p.first, 1]
                    if not is_constant(p, i):
                        g[i] += slope * factors[k - p.first, 0]
                    if not is_constant(p, j):
                        g[j] += slope * factors[k - p.first, 1]
