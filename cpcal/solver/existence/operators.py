"""The interval Newton operators of Hansen and Sengupta, and of Krawczyk.

Both take m equations `F(x) in value + jacobian (x - c)` and m unknowns, the `columns` of the box X, multiply by the
approximate inverse C of the Jacobian's midpoint, and give a box N(X) that holds every zero of F in X. With
y = C F(c), A = C J:

    Hansen-Sengupta    N_i = c_i - (y_i + sum_{j != i} A_ij (x_j - c_j)) / A_ii, one i after the other, each using
                       the narrowed x_j before it (Gauss-Seidel); cut off (to rounding) at the ends of X
    Krawczyk           N   = c - y + (I - A) (X - c); not intersected with X

If F is continuous on X and N(X) lies in the interior of X, X holds exactly one zero of F, and it lies in N(X)
(Neumaier, Interval Methods for Systems of Equations, 1990, chapter 5; any matrix of slopes serves as J). For columns
that are not unknowns both hold for every value of them in X. The computation itself is in `square`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from threading import Timer
from typing import Any

import numpy as np

from cpcal.common.values import Bools, Floats, Indices, Ints
from cpcal.solver.existence import square
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.interval.arithmetic import in_arithmetic
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr, sweeps
from cpcal.solver.network.expression import as_expr
from cpcal.solver.network.rows import Extremes

# ------------------------------------------------------------------------------------------------------------------
# How compiled functions hear of a deadline: they cannot read the clock, and hold no lock while they run.

_QUICK = 100**3  # steps of an elimination: some milliseconds, not worth a thread


@contextmanager
def stop_flag(deadline: float, unknowns: int, boxes: int = 1) -> Iterator[Ints]:
    """A flag (1,) that becomes 1 at the deadline (of time.monotonic()), for Newton's method on so many boxes.

    Where that takes some milliseconds only, it stays 0.
    """
    flag = np.zeros(1, np.int64)
    if math.isinf(deadline) or boxes * unknowns**3 < _QUICK:
        yield flag
        return
    timer = Timer(max(0.0, deadline - time.monotonic()), flag.fill, (1,))
    timer.daemon = True
    timer.start()
    try:
        yield flag
    finally:
        timer.cancel()


class Operator(Enum):
    """Which of the two."""

    HANSEN_SENGUPTA = 0
    KRAWCZYK = 1


hansen_sengupta, krawczyk = Operator


def square_of(engine: Arithmetic) -> Any:
    """The functions of `square`, by name, in an engine's arithmetic."""
    return in_arithmetic(engine.name, sweeps, square)


def image(
    operator: Operator,
    engine: Arithmetic,
    linear: Linearization,
    columns: Indices,
    box: IntervalArray,
    deadline: float = math.inf,
) -> IntervalArray | None:
    """N(X) for as many equations as `columns`; NaN everywhere when X holds no zero.

    None where there is no inverse, or it was not finished at the deadline (of time.monotonic()).
    """
    bounds = np.stack([box.lo, box.hi], axis=1)
    out = np.full(bounds.shape, np.nan)
    rows = np.arange(len(columns))
    given = (_pairs(linear.value), _pairs(linear.jacobian), np.array(linear.center), rows, np.array(columns))
    with stop_flag(deadline, len(columns)) as stop:
        found = square_of(engine).newton_image(operator.value, *given, stop, bounds, out)
    return None if found < 0 else IntervalArray(out[:, 0].copy(), out[:, 1].copy())


def _pairs(x: IntervalArray) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.stack([x.lo, x.hi], axis=-1)


def inside(inner: IntervalArray, outer: IntervalArray, columns: Indices) -> bool:
    """Whether the unknowns of one box lie in the interior of another."""
    return bool((inner.lo > outer.lo)[columns].all() and (inner.hi < outer.hi)[columns].all())


# ------------------------------------------------------------------------------------------------------------------
# The equalities `F(x) = 0` among the constraints of a network, linearised on a box: `F(c) + J (x - c)`.


@dataclass(frozen=True)
class Linearization:
    """`F(x)` lies in `value + jacobian (x - center)` for every x of the box: shapes (m,), (m, n), (n,)."""

    value: IntervalArray
    jacobian: IntervalArray
    center: Floats


class Equalities:
    """All elements of constraints whose two bounds are one number: m equations in the n components of a box.

    `rest` is the network of everything else, `inequalities` the numbers of constraints without any equation. `reads`
    says whether an equation contains a reading: then its zeros are no single points.
    """

    def __init__(self, network: ConstraintNetwork) -> None:
        self.rest = network.without_constraints()
        roots: list[Expr] = []
        self.inequalities: set[int] = set()
        for k, constraint in enumerate(network.constraints):
            equal = _equalities(constraint)
            if not equal.any():
                self.inequalities.add(k)
            if equal.any():
                roots.append(_difference(constraint, equal))
            if not equal.all():
                self.rest.add(_others(constraint, equal))
        self.roots = tuple(roots)  # each is to be 0
        self._rows = Extremes(network, *roots)
        self.tape = self._rows.tape
        self.count = self.tape.count
        self.reads = bool(self.tape.readings)

    @classmethod
    def of(cls, network: ConstraintNetwork) -> Equalities:
        """Those of a network, written once."""
        return network.once("equalities", lambda: cls(network))

    def linearize(self, engine: Arithmetic, box: Box, center: Floats) -> Linearization | None:
        """On a bounded box, at a point of it; None where F or a derivative is not defined or not bounded.

        The Jacobian encloses the derivatives (where they exist) at all points of the box, so that it encloses all
        slopes (F(x) - F(y)) between two of its points.
        """
        value, jacobian = np.empty((self.count, 2)), np.empty((self.count, len(center), 2))
        bounds = np.stack([box.lo, box.hi], axis=1)
        kernels = square_of(engine)
        if not kernels.linearize(*self.program, bounds, np.array(center, np.float64), value, jacobian):
            return None
        return Linearization(_array(value), _array(jacobian), center)

    @cached_property
    def program(self) -> tuple[Any, ...]:
        """The tape as the functions of `square` take it."""
        tape, paths, leaves = self.tape, self.tape.reach, self.tape.leaves()
        both = np.stack([leaves.lo, leaves.hi], axis=1)
        return (*tape.program, tape.given, tape.root_slots, paths.start, paths.order, both)

    def estimate(self, point: Floats) -> tuple[Floats, Floats]:
        """F (m,) and its Jacobian (m, n) at a point, without proof."""
        rows = self._rows.linearize(point)
        return rows.values, rows.jacobian


def _array(bounds: Floats) -> IntervalArray:
    return IntervalArray(bounds[..., 0], bounds[..., 1])


def _equalities(constraint: Constraint) -> Bools:
    """Which elements of the body must equal one number, shape of the body."""
    shape, lower, upper = constraint.body.shape, constraint.lower, constraint.upper
    if isinstance(lower.data, IntervalArray) and isinstance(upper.data, IntervalArray):
        low, high = lower.data, upper.data
        same = (low.lo == high.hi) & np.isfinite(low.lo) & (low.lo == low.hi) & (high.lo == high.hi)
        if lower.digest != upper.digest:
            return np.broadcast_to(same, shape)
        return np.broadcast_to(np.isfinite(low.lo) & np.isfinite(low.hi), shape)
    return np.full(shape, lower.digest == upper.digest)


def _difference(constraint: Constraint, equal: Bools) -> Expr:
    """`body - bound` for the elements that are equalities."""
    if equal.all():
        return constraint.body - constraint.lower
    return _part(constraint.body, constraint, equal) - _part(constraint.lower, constraint, equal)


def _others(constraint: Constraint, equal: Bools) -> Constraint:
    """The constraint without its equalities."""
    if not equal.any():
        return constraint
    parts = (constraint.body, constraint.lower, constraint.upper)
    return Constraint(*(_part(expr, constraint, ~equal) for expr in parts))


def _part(expr: Expr, constraint: Constraint, elements: Bools) -> Expr:
    """The given elements of the body, or of a bound that is constant wherever only some are equalities."""
    where = np.nonzero(elements)
    if expr is constraint.body:
        return expr[where]
    assert isinstance(expr.data, IntervalArray)
    return as_expr(expr.data.broadcast_to(constraint.body.shape)[where])
