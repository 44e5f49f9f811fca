"""The interval Newton operators of Hansen and Sengupta, and of Krawczyk.

Both take m equations `F(x) in value + jacobian (x - c)` and m unknowns, the `columns` of the box X, multiply by the
approximate inverse C of the Jacobian's midpoint, and give a box N(X) that holds every zero of F in X. With
y = C F(c), A = C J:

    Hansen-Sengupta    N_i = c_i - (y_i + sum_{j != i} A_ij (x_j - c_j)) / A_ii, one i after the other, each using
                       the narrowed x_j before it (Gauss-Seidel)
    Krawczyk           N   = c - y + (I - A) (X - c)

If F is continuous on X and N(X) lies in the interior of X, X holds exactly one zero of F, and it lies in N(X)
(Neumaier, Interval Methods for Systems of Equations, 1990, chapter 5; any matrix of slopes serves as J). For columns
that are not unknowns both hold for every value of them in X.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import qr

from cpcal.common.arrays import Indices
from cpcal.solver.existence.equalities import Linearization
from cpcal.solver.interval import Arithmetic, IntervalArray

# (engine, linearised equations (m of them), unknowns (m,), box (n,)) -> box (n,); None: no inverse
Operator = Callable[[Arithmetic, Linearization, Indices, IntervalArray], IntervalArray | None]


def hansen_sengupta(
    engine: Arithmetic, linear: Linearization, columns: Indices, box: IntervalArray
) -> IntervalArray | None:
    """N(X), cut off (to rounding) at the ends of X; NaN everywhere when X holds no zero."""
    prepared = _preconditioned(engine, linear, columns)
    if prepared is None:
        return None
    y, matrix = prepared
    c = IntervalArray.point(linear.center)
    away = engine.sub(box, c)
    lo, hi = away.lo.copy(), away.hi.copy()
    for i, k in enumerate(columns):
        others_lo, others_hi = lo.copy(), hi.copy()
        others_lo[k] = others_hi[k] = 0.0
        rest = engine.sum(engine.mul(matrix[i], IntervalArray(others_lo, others_hi))[None], 1)
        total = engine.neg(engine.add(y[i : i + 1], rest))
        step = engine.factor(total, matrix[i, k : k + 1], IntervalArray(lo[k : k + 1], hi[k : k + 1]))
        lo[k], hi[k] = step.lo[0], step.hi[0]
        if np.isnan(lo[k]):
            nothing = np.full(len(lo), np.nan)
            return IntervalArray(nothing, nothing)
    return _moved(engine, box, c, IntervalArray(lo, hi), columns)


def krawczyk(engine: Arithmetic, linear: Linearization, columns: Indices, box: IntervalArray) -> IntervalArray | None:
    """N(X), not intersected with X."""
    prepared = _preconditioned(engine, linear, columns)
    if prepared is None:
        return None
    y, matrix = prepared
    c = IntervalArray.point(linear.center)
    away = engine.sub(box, c)
    identity = np.zeros(matrix.shape)
    identity[np.arange(len(columns)), columns] = 1.0
    remainder = engine.sub(IntervalArray.point(identity), matrix)
    spread = engine.dot(remainder, away.reshape((len(away.lo), 1)))[:, 0]
    step = engine.sub(spread, y)
    lo, hi = away.lo.copy(), away.hi.copy()
    lo[columns], hi[columns] = step.lo, step.hi
    return _moved(engine, box, c, IntervalArray(lo, hi), columns)


def inside(inner: IntervalArray, outer: IntervalArray, columns: Indices) -> bool:
    """Whether the unknowns of one box lie in the interior of another."""
    return bool((inner.lo > outer.lo)[columns].all() and (inner.hi < outer.hi)[columns].all())


def unknowns(linear: Linearization, box: IntervalArray) -> tuple[Indices, Indices] | None:
    """The rows and columns of a square part of the equations that is far from singular: as many as can be.

    Components of no width are no unknowns. Rows and columns are chosen by QR with pivoting, in units of the box.
    """
    free = np.flatnonzero(box.hi > box.lo)
    m, size = linear.jacobian.shape[0], min(linear.jacobian.shape[0], len(free))
    if size == 0:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = (linear.jacobian.mid * (box.hi - box.lo))[:, free]
    if not np.isfinite(scaled).all():
        return None
    rows, columns = np.arange(m), free
    if m > size:
        rows = np.sort(qr(scaled.T, mode="r", pivoting=True)[1][:size])
    elif len(free) > size:
        columns = free[np.sort(qr(scaled, mode="r", pivoting=True)[1][:size])]
    return rows, columns


def chosen(linear: Linearization, rows: Indices) -> Linearization:
    """Some of the equations."""
    return Linearization(linear.value[rows], linear.jacobian[rows], linear.center)


def _preconditioned(
    engine: Arithmetic, linear: Linearization, columns: Indices
) -> tuple[IntervalArray, IntervalArray] | None:
    """C F(c) and C J, for C the inverse of the square part of J's midpoint."""
    try:
        inverse = np.linalg.inv(linear.jacobian.mid[:, columns])
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(inverse).all():
        return None
    c = IntervalArray.point(inverse)
    y = engine.dot(c, linear.value.reshape((len(columns), 1)))[:, 0]
    return y, engine.dot(c, linear.jacobian)


def _moved(
    engine: Arithmetic, box: IntervalArray, center: IntervalArray, step: IntervalArray, columns: Indices
) -> IntervalArray:
    """`center + step` for the unknowns, the box for the others."""
    total = engine.add(center, step)
    lo, hi = box.lo.copy(), box.hi.copy()
    lo[columns], hi[columns] = total.lo[columns], total.hi[columns]
    return IntervalArray(lo, hi)
