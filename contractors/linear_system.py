"""linear_system: interval Newton with the classical methods for the linear system, for comparison with krawczyk."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from contractors.hc4 import moved_bounds
from cpcal.common.values import Floats
from cpcal.solver.contract import Composable, Contraction, Step, shrunk
from cpcal.solver.interval import Arithmetic, Box, IntervalArray, get_arithmetic
from cpcal.solver.network import CentredForm, Constraint, ConstraintNetwork

# ------------------------------------------------------------------------------------------------------------------
# Classical enclosures of the solutions of an interval linear system (what the paper compares its method to).
#
# For an interval matrix A (m, n), m >= n, and an interval vector b (m,), each function encloses
#
#     Sigma(A, b) = { x : A' x = b' for some A' in A and some b' in b }                              (eq. 10)
#
# or returns None where the method fails. NaN (the empty interval) proves that Sigma is empty. All but the third
# multiply over-determined systems by the pseudo-inverse C of the midpoint: A' x = b' implies C A' x = C b', square.

_ROUNDS = 50  # of Krawczyk's iteration, while the widths still shrink by a hundredth
_INFLATIONS = 15  # attempts to find a box that is mapped into itself
_LARGEST = 1000  # unknowns of the square system that is inverted for the third method


def enclose_gauss(A: IntervalArray, b: IntervalArray, engine: Arithmetic | None = None) -> IntervalArray | None:
    """Gauss elimination in interval arithmetic on the preconditioned system; fails when a pivot holds zero."""
    e = engine or get_arithmetic("float64")
    square = _preconditioned(e, A, b)
    if square is None:
        return None
    table = _joined(square[0], square[1][:, None])
    n = table.shape[0]
    with np.errstate(all="ignore"):
        for k in range(n):
            pivot = k + int(np.argmax(_mignitude(table[k:, k])))
            order = np.arange(n)
            order[[k, pivot]] = pivot, k
            table = table[order]
            if not _mignitude(table[k, k]) > 0.0:
                return None
            below = table[k + 1 :]
            factor = e.div(below[:, k : k + 1], table[k, k])
            table = _stacked(table[: k + 1], e.sub(below, e.mul(factor, table[k][None])))
        return _back_substituted(e, table)


def _back_substituted(e: Arithmetic, table: IntervalArray) -> IntervalArray | None:
    """Solution of an upper triangular system (n, n + 1), its right side last."""
    n = table.shape[0]
    lo, hi = np.zeros(n), np.zeros(n)
    for k in reversed(range(n)):
        known = e.sum(e.mul(table[k, k + 1 : n], IntervalArray(lo[k + 1 :], hi[k + 1 :])), 0)
        value = e.div(e.sub(table[k, n], known), table[k, k])
        lo[k], hi[k] = value.lo, value.hi
    return IntervalArray(lo, hi) if np.isfinite(lo).all() and np.isfinite(hi).all() else None


def enclose_krawczyk(
    A: IntervalArray, b: IntervalArray, engine: Arithmetic | None = None, start: IntervalArray | None = None
) -> IntervalArray | None:
    """Krawczyk's iteration X := (C b + (I - C A) X) with X, from `start` or from a bound by norms.

    Without a start it needs ||I - C A|| < 1 in the maximum norm: then |x| <= ||C b|| / (1 - ||I - C A||).
    """
    e = engine or get_arithmetic("float64")
    square = _preconditioned(e, A, b)
    if square is None:
        return None
    with np.errstate(all="ignore"):
        matrix, right = e.sub(IntervalArray.point(np.eye(square[0].shape[0])), square[0]), square[1]
        x = start or _norm_bound(e, matrix, right)
        for _ in range(_ROUNDS if x is not None else 0):
            assert x is not None
            new = x.intersect(e.add(right, e.dot(matrix, x[:, None])[:, 0]))
            if bool(np.any(new.empty)):
                return IntervalArray.point(np.full(x.shape, np.nan))
            pays = shrunk(x.hi - x.lo, new.hi - new.lo, 0.99)
            x = new
            if not pays:
                break
        return x


def _norm_bound(e: Arithmetic, matrix: IntervalArray, right: IntervalArray) -> IntervalArray | None:
    norm = float(e.sum(IntervalArray.point(matrix.mag), 1).hi.max(initial=0.0))
    if not norm < 1.0:
        return None
    rest = e.sub(IntervalArray.point(1.0), IntervalArray.point(norm))
    largest = float(e.div(IntervalArray.point(right.mag.max(initial=0.0)), rest).hi)
    size = np.full(right.shape, largest)
    return IntervalArray(-size, size) if np.isfinite(largest) else None


def enclose_rump(A: IntervalArray, b: IntervalArray, engine: Arithmetic | None = None) -> IntervalArray | None:
    """A verified enclosure after Rump: the residual iteration with inflation, x~ + X with Z + C X inside X.

    An over-determined system is embedded in the square one of its least squares solutions, A x - y = b and
    A^T y = 0, in m + n unknowns: the enclosure holds those of all systems in (A, b), solvable or not.
    """
    e = engine or get_arithmetic("float64")
    m, n = A.shape
    if m + n > _LARGEST or m < n:
        return None
    if m == n:
        return _verified(e, A, b)
    unit, zero = IntervalArray.point(np.eye(m)), IntervalArray.point(np.zeros((n, n)))
    transposed = IntervalArray(A.lo.T, A.hi.T)
    whole = _stacked(_joined(A, e.neg(unit)), _joined(zero, transposed))
    found = _verified(e, whole, _stacked(b, IntervalArray.point(np.zeros(n))))
    return None if found is None else found[:n]


def _verified(e: Arithmetic, A: IntervalArray, b: IntervalArray) -> IntervalArray | None:
    try:
        inverse = np.linalg.inv(A.mid)
    except np.linalg.LinAlgError:
        return None
    near = inverse @ b.mid
    if not (np.isfinite(inverse).all() and np.isfinite(near).all()):
        return None
    with np.errstate(all="ignore"):
        R = IntervalArray.point(inverse)
        residual = e.sub(b, e.dot(A, IntervalArray.point(near[:, None]))[:, 0])
        z = e.dot(R, residual[:, None])[:, 0]
        matrix = e.sub(IntervalArray.point(np.eye(len(near))), e.dot(R, A))
        x = z
        for _ in range(_INFLATIONS):
            y = IntervalArray(*(_inflated(x, side) for side in (-1.0, 1.0)))
            x = e.add(z, e.dot(matrix, y[:, None])[:, 0])
            if bool(np.all((y.lo < x.lo) & (x.hi < y.hi))):
                return e.add(IntervalArray.point(near), x)
            if not (np.isfinite(x.lo).all() and np.isfinite(x.hi).all()):
                break
    return None


def _inflated(x: IntervalArray, side: float) -> Floats:
    """A bound further out by a tenth of the width and a little more; any other box would do as well."""
    bound = x.lo if side < 0.0 else x.hi
    return np.asarray(bound + side * (0.1 * (x.hi - x.lo) + 1e-15 * np.abs(bound) + 1e-300))


def _preconditioned(e: Arithmetic, A: IntervalArray, b: IntervalArray) -> tuple[IntervalArray, IntervalArray] | None:
    """C A (n, n) and C b (n,) for the pseudo-inverse C of the midpoint of A."""
    if A.shape[0] < A.shape[1]:
        return None
    try:
        inverse = np.linalg.pinv(A.mid)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(inverse).all():
        return None
    C = IntervalArray.point(inverse)
    with np.errstate(all="ignore"):
        return e.dot(C, A), e.dot(C, b[:, None])[:, 0]


def _mignitude(x: IntervalArray) -> Floats:
    """The smallest absolute value in each interval."""
    return np.asarray(np.maximum(np.maximum(x.lo, -x.hi), 0.0))


def _joined(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Side by side."""
    return IntervalArray(np.concatenate([x.lo, y.lo], axis=1), np.concatenate([x.hi, y.hi], axis=1))


def _stacked(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """One above the other."""
    return IntervalArray(np.concatenate([x.lo, y.lo]), np.concatenate([x.hi, y.hi]))


Method = Literal["gauss", "krawczyk", "rump"]


class LinearSystem(Composable):
    """Encloses the solutions of `A (x - c) in [lower, upper] - f(c, M)`, c the midpoint of the box; once.

    All constraints that are bounded on both sides take part, if they are at least as many as the variables in
    them. `method`: Gauss elimination, Krawczyk's iteration or a verified enclosure after Rump (`interval_linear`).
    """

    monotone_tolerance = np.inf  # a system may be singular on the whole and regular on a part

    def __init__(
        self,
        network: ConstraintNetwork,
        *,
        objective: str | None = None,
        arithmetic: str = "float64",
        method: Method = "krawczyk",
    ) -> None:
        if method not in get_args(Method):
            raise ValueError(f"{method!r} is no method: {', '.join(get_args(Method))}")
        self._engine, self._method = get_arithmetic(arithmetic), method
        self._equations = [_Equations(network, c, self._engine) for c in network.constraints]

    def contract(self, box: Box) -> Contraction:
        if box.is_empty or not box.is_bounded or not len(box):
            return Contraction(box)
        e = self._engine
        matrix, right = self._system(box)
        moves = e.sub(box.array, IntervalArray.point(box.mid))
        unknown = (matrix.mag > 0.0).any(axis=0) & (box.rad > 0.0)
        if not unknown.any() or len(right.lo) < np.count_nonzero(unknown):
            return Contraction(box)
        with np.errstate(all="ignore"):
            fixed = e.sum(e.mul(matrix[:, ~unknown], moves[~unknown]), 1)
            scale = IntervalArray.point(box.rad[unknown])
            system = e.mul(matrix[:, unknown], scale), e.sub(right, fixed)
            found = self._enclosed(*system, e.div(moves[unknown], scale))
        if found is None:
            return Contraction(box)
        whole = e.add(IntervalArray.point(box.mid[unknown]), e.mul(scale, found))
        lo, hi = box.lo.copy(), box.hi.copy()
        lo[unknown], hi[unknown] = np.maximum(lo[unknown], whole.lo), np.minimum(hi[unknown], whole.hi)
        result = box.with_bounds(lo, hi)
        steps = (
            (Step("linear_system", None, "", np.nan),)
            if result.is_empty
            else moved_bounds("linear_system", box, result)
        )
        return Contraction(result, steps)

    def _enclosed(self, matrix: IntervalArray, right: IntervalArray, start: IntervalArray) -> IntervalArray | None:
        if self._method == "krawczyk":
            return enclose_krawczyk(matrix, right, self._engine, start)
        return (enclose_gauss if self._method == "gauss" else enclose_rump)(matrix, right, self._engine)

    def _system(self, box: Box) -> tuple[IntervalArray, IntervalArray]:
        """Matrix (K, n) and right side (K,) of all usable equations."""
        parts = [equations.on(box) for equations in self._equations]
        empty = np.zeros((0, len(box))), np.zeros(0)
        matrix = IntervalArray(*(np.concatenate([empty[0], *(getattr(m, s) for m, _ in parts)]) for s in ("lo", "hi")))
        right = IntervalArray(*(np.concatenate([empty[1], *(getattr(b, s) for _, b in parts)]) for s in ("lo", "hi")))
        bounds = np.column_stack([matrix.lo, matrix.hi, right.lo, right.hi])
        usable = np.isfinite(bounds).all(axis=1)
        return matrix[usable], right[usable]


class _Equations:
    """One constraint `lower <= body <= upper` as K interval equations."""

    def __init__(self, network: ConstraintNetwork, constraint: Constraint, engine: Arithmetic) -> None:
        self._engine = engine
        self._body, self._lower, self._upper = (
            CentredForm(network, expr, engine) for expr in (constraint.body, constraint.lower, constraint.upper)
        )
        self._shapes = constraint.body.shape, constraint.lower.shape, constraint.upper.shape

    def on(self, box: Box) -> tuple[IntervalArray, IntervalArray]:
        """A (K, n) and b (K,), on a box, about its midpoint: `A (x - mid) in b`."""
        shape, below, above = self._shapes
        lower = np.broadcast_to(self._lower.natural(box).lo.reshape(below), shape).ravel()
        upper = np.broadcast_to(self._upper.natural(box).hi.reshape(above), shape).ravel()
        some = np.where(lower <= upper, 0.0, np.nan)  # an inverted range is left to other contractors
        with np.errstate(all="ignore"):
            right = self._engine.sub(IntervalArray(lower + some, upper + some), self._body.at(box.mid))
        return self._body.jacobian(box), right
