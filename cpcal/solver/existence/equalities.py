"""The equalities `F(x) = 0` among the constraints of a network, linearised on a box: `F(c) + J (x - c)`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.existence import square
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr
from cpcal.solver.network.engines import in_arithmetic
from cpcal.solver.network.expression import as_expr
from cpcal.solver.network.rows import Extremes


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
        kernels = in_arithmetic(engine.name, square)
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
