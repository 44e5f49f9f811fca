"""The interval Newton operator of Hansen and Sengupta.

It takes m equations `F(x) in value + jacobian (x - c)` and m unknowns, the `columns` of the box X, multiplies by the
approximate inverse C of the Jacobian's midpoint, and gives a box N(X) that holds every zero of F in X. With
y = C F(c), A = C J:

    N_i = c_i - (y_i + sum_{j != i} A_ij (x_j - c_j)) / A_ii, one i after the other, each using the narrowed x_j before
    it (Gauss-Seidel); cut off (to rounding) at the ends of X

If F is continuous on X and N(X) lies in the interior of X, X holds exactly one zero of F, and it lies in N(X)
(Neumaier, Interval Methods for Systems of Equations, 1990, chapter 5; any matrix of slopes serves as J). For columns
that are not unknowns it holds for every value of them in X.

The computation itself comes last, in compiled functions. Bounds are the last axis of an array there: `value` (m, 2),
`jacobian` (m, n, 2), and so on.
"""

import math
from functools import cached_property

import numpy as np

from cpcal.common.values import Floats, Indices, Ints
from cpcal.solver.compiled import compiled
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.interval.kernels import Arrays, Bounds, add, at, factor, meet, mul, neg, sub
from cpcal.solver.interval.operations import continuous
from cpcal.solver.linear import eliminated
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Extremes
from cpcal.solver.network.sweeps import Program, Reach, all_partials, arguments, forward, gradients


def inside(inner: IntervalArray, outer: IntervalArray, columns: Indices) -> bool:
    """Whether the unknowns of one box lie in the interior of another."""
    return bool((inner.lo > outer.lo)[columns].all() and (inner.hi < outer.hi)[columns].all())


# ------------------------------------------------------------------------------------------------------------------
# The equalities `F(x) = 0` among the constraints of a network, and the operator on a box.


class Equalities:
    """The constraints whose two bounds are one number, element by element: m equations in the n components of a box.

    `rest` is the network of all others, `inequalities` their numbers. `rows` estimates F at points, without proof.
    `reads` says whether an equation contains a reading: then its zeros are no single points.
    """

    def __init__(self, network: ConstraintNetwork) -> None:
        self.rest = network.without_constraints()
        self.rest.add([c for c in network.constraints if not c.is_equation])
        self.inequalities = {k for k, c in enumerate(network.constraints) if not c.is_equation}
        self.roots = tuple(c.body - c.lower for c in network.constraints if c.is_equation)  # each is to be 0
        self.rows = Extremes(network, *self.roots)
        self.tape = self.rows.tape
        self.count = self.tape.count
        self.reads = bool(self.tape.readings)

    @classmethod
    def of(cls, network: ConstraintNetwork) -> "Equalities":
        """Those of a network, written once."""
        return network.once("equalities", lambda: cls(network))

    def image(self, box: Box, center: Floats, columns: Indices) -> IntervalArray | None:
        """N(X) about a point of a bounded box X, for as many equations as `columns`; NaN where X holds no zero.

        None where F or a derivative is not defined or not bounded, or where there is no inverse. The derivatives
        (where they exist) at all points of the box enclose all slopes (F(x) - F(y)) between two of its points.
        """
        center, rows = np.array(center, np.float64), np.arange(len(columns))
        value, jacobian = np.empty((self.count, 2)), np.empty((self.count, len(center), 2))
        bounds = np.stack([box.lo, box.hi], axis=1)
        if not linearized(self.program, bounds, center, value, jacobian):
            return None
        out = np.full(bounds.shape, np.nan)
        found = newton_image(value, jacobian, center, rows, np.array(columns), bounds, out)
        return None if found < 0 else IntervalArray(out[:, 0].copy(), out[:, 1].copy())

    @cached_property
    def program(self) -> "Equations":
        """The tape as the compiled functions take it."""
        leaves = self.tape.leaves()
        return self.tape.program, self.tape.reach, (leaves.lo, leaves.hi)


# ------------------------------------------------------------------------------------------------------------------
# Interval Newton on a square part of m equations in n components, compiled.


Equations = tuple[Program, Reach, Arrays]  # a tape and the bounds of its constants and readings


@compiled
def linearized(equations: Equations, box: Floats, center: Floats, value: Floats, jacobian: Floats) -> bool:
    """`value` at the centre and `jacobian` over the box (n, 2) of a tape's roots.

    False where one of them is not bounded or some operation is not continuous.
    """
    p, reach, leaves = equations
    n, size = len(box), p.first + len(p.code)
    x = np.empty(size), np.empty(size)
    x[0][n : p.first], x[1][n : p.first] = leaves
    x[0][:n], x[1][:n] = box[:, 0], box[:, 1]
    forward(p, x)
    for k in range(len(p.code)):
        a, b = arguments(p, x, k)
        if not continuous(p.code[k], p.par[k], a, b):
            return False
    factors, g = np.empty((len(p.code), 4)), (np.zeros(len(reach.order)), np.zeros(len(reach.order)))
    all_partials(p, x, factors)
    gradients(p, reach, factors, g)
    jacobian[:] = 0.0
    for r, e, k in zip(reach.row, reach.entry, reach.leaf):  # noqa: B905 - numba knows no `strict`
        if k < n:
            low, high = at(g, e)
            jacobian[r, k, 0], jacobian[r, k, 1] = low, high
            if not (math.isfinite(low) and math.isfinite(high)):
                return False
    x[0][:n], x[1][:n] = center, center
    forward(p, x)
    for r in range(len(p.roots)):
        value[r, 0], value[r, 1] = at(x, p.roots[r])
        if not (math.isfinite(value[r, 0]) and math.isfinite(value[r, 1])):
            return False
    return True


@compiled
def pair(x: Floats, k: int) -> Bounds:
    """One interval of (n, 2)."""
    return x[k, 0], x[k, 1]


@compiled
def entry(x: Floats, i: int, j: int) -> Bounds:
    """One interval of (m, n, 2)."""
    return x[i, j, 0], x[i, j, 1]


@compiled
def square_part(jacobian: Floats, box: Floats, rows: Ints, columns: Ints) -> int:
    """The rows and columns of a square part that is far from singular, and its size: as many as can be.

    Components of no width are no unknowns. Rows and columns are chosen by Gauss elimination with full pivoting of the
    midpoints, in units of the box.
    """
    m, n = len(jacobian), len(box)
    free = 0
    for j in range(n):
        if box[j, 1] > box[j, 0]:
            columns[free] = j
            free += 1
    size = min(m, free)
    for i in range(m):
        rows[i] = i
    if m == free or size == 0:
        return size
    scaled = np.empty((m, free))
    for i in range(m):
        for j in range(free):
            k = columns[j]
            scaled[i, j] = 0.5 * (jacobian[i, k, 0] + jacobian[i, k, 1]) * (box[k, 1] - box[k, 0])
    for step in range(size):
        best, at_row, at_column = 0.0, -1, -1
        for i in range(step, m):
            for j in range(step, free):
                if abs(scaled[i, j]) > best:
                    best, at_row, at_column = abs(scaled[i, j]), i, j
        if at_row < 0 or not math.isfinite(best):
            return 0
        for j in range(free):
            scaled[step, j], scaled[at_row, j] = scaled[at_row, j], scaled[step, j]
        for i in range(m):
            scaled[i, step], scaled[i, at_column] = scaled[i, at_column], scaled[i, step]
        rows[step], rows[at_row] = rows[at_row], rows[step]
        columns[step], columns[at_column] = columns[at_column], columns[step]
        for i in range(step + 1, m):
            share = scaled[i, step] / scaled[step, step]
            for j in range(step, free):
                scaled[i, j] -= share * scaled[step, j]
    return size


@compiled
def inverse_of_middle(jacobian: Floats, rows: Ints, columns: Ints, out: Floats) -> bool:
    """An approximate inverse (s, s) of the midpoints, False where there is none."""
    s = len(out)
    work = np.zeros((s, 2 * s))
    for i in range(s):
        for j in range(s):
            work[i, j] = 0.5 * (jacobian[rows[i], columns[j], 0] + jacobian[rows[i], columns[j], 1])
        work[i, s + i] = 1.0
    if not eliminated(work, 0.0):
        return False
    out[:, :] = work[:, s:]
    return bool(np.isfinite(out).all())


@compiled
def precondition(inverse: Floats, rows: Ints, value: Floats, jacobian: Floats, y: Floats, matrix: Floats) -> None:
    """y = C F(c) (s, 2) and A = C J (s, n, 2)."""
    s, n = len(inverse), jacobian.shape[1]
    entries, where = np.zeros(s, np.int64), np.empty((s, n), np.int64)  # that are not 0, by row
    for r in range(s):
        for j in range(n):
            if jacobian[rows[r], j, 0] != 0.0 or jacobian[rows[r], j, 1] != 0.0:
                where[r, entries[r]] = j
                entries[r] += 1
    y[:] = 0.0
    matrix[:] = 0.0
    for i in range(s):
        for r in range(s):
            c, row = inverse[i, r], rows[r]
            if c == 0.0:
                continue
            y[i, 0], y[i, 1] = add(pair(y, i), mul((c, c), pair(value, row)))
            for j in where[r, : entries[r]]:
                matrix[i, j, 0], matrix[i, j, 1] = add(entry(matrix, i, j), mul((c, c), entry(jacobian, row, j)))


@compiled
def gauss_seidel(y: Floats, matrix: Floats, columns: Ints, away: Floats) -> bool:
    """Narrows `away` = X - c (n, 2), one unknown after the other; False where X holds no zero."""
    for i in range(len(y)):
        k = columns[i]
        total = pair(y, i)
        for j in range(len(away)):
            if j != k and (matrix[i, j, 0] != 0.0 or matrix[i, j, 1] != 0.0):
                total = add(total, mul(entry(matrix, i, j), pair(away, j)))
        low, high = factor(neg(total), entry(matrix, i, k), pair(away, k))
        if not low <= high:
            return False
        away[k, 0], away[k, 1] = low, high
    return True


@compiled
def newton_image(
    value: Floats, jacobian: Floats, center: Floats, rows: Ints, columns: Ints, box: Floats, out: Floats
) -> int:
    """N(X) in `out` (n, 2): 1; 0 if X holds no zero, -1 if there is no inverse.

    `columns` are the s unknowns.
    """
    s, n = len(columns), len(box)
    inverse, y, matrix, away = np.empty((s, s)), np.empty((s, 2)), np.empty((s, n, 2)), np.empty((n, 2))
    if not inverse_of_middle(jacobian, rows, columns, inverse):
        return -1
    precondition(inverse, rows, value, jacobian, y, matrix)
    for j in range(n):
        away[j, 0], away[j, 1] = sub(pair(box, j), (center[j], center[j]))
    if not gauss_seidel(y, matrix, columns, away):
        return 0
    out[:] = box
    for k in columns:
        out[k, 0], out[k, 1] = add((center[k], center[k]), pair(away, k))
    return 1


@compiled
def newton_all(equations: Equations, most: int, boxes: Floats) -> None:
    """The operator on B boxes (B, n, 2), in place, while it halves some width; NaN where a box holds no zero."""
    m, n = len(equations[0].roots), boxes.shape[1]
    value, jacobian, image, center = np.empty((m, 2)), np.empty((m, n, 2)), np.empty((n, 2)), np.empty(n)
    rows, columns = np.empty(m, np.int64), np.empty(n, np.int64)
    for r in range(len(boxes)):
        box = boxes[r]
        if not np.isfinite(box).all():
            continue
        for _ in range(most):
            for j in range(n):
                center[j] = min(max(0.5 * box[j, 0] + 0.5 * box[j, 1], box[j, 0]), box[j, 1])  # near the middle
            known = linearized(equations, box, center, value, jacobian)
            size = square_part(jacobian, box, rows, columns) if known else 0
            if size == 0:
                break
            square_rows, unknowns = rows[:size], columns[:size]
            found = newton_image(value, jacobian, center, square_rows, unknowns, box, image)
            if found < 0:
                break
            halved = False
            for j in columns[:size]:
                low, high = meet(pair(image, j), pair(box, j))
                if found == 0 or not low <= high:
                    box[:] = np.nan
                    break
                if high - low < 0.5 * (box[j, 1] - box[j, 0]):
                    halved = True
                box[j, 0], box[j, 1] = low, high
            if not halved or math.isnan(box[0, 0]):
                break
