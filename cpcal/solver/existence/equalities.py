"""The equalities `F(x) = 0` among the constraints of a network, linearised on a box: `F(c) + J (x - c)`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr, Tape
from cpcal.solver.network.dag import leaves
from cpcal.solver.network.expression import as_expr
from cpcal.solver.network.point import Point


@dataclass(frozen=True)
class Linearization:
    """`F(x)` lies in `value + jacobian (x - center)` for every x of the box: shapes (m,), (m, n), (n,)."""

    value: IntervalArray
    jacobian: IntervalArray
    center: Floats


class Equalities:
    """All elements of constraints whose two bounds are one number: m equations in the n components of a box.

    `rest` is the network of everything else. `reads` says whether an equation contains a reading: then its zeros
    are no single points.
    """

    def __init__(self, network: ConstraintNetwork) -> None:
        self.rest = network.without_constraints()
        roots: list[Expr] = []
        for constraint in network.constraints:
            equal = _equalities(constraint)
            if equal.any():
                roots.append(_difference(constraint, equal))
            if not equal.all():
                self.rest.add(_others(constraint, equal))
        self._tape = Tape(network, roots)
        self._seeds = self._tape.variable_seeds()
        self._size = len(network.names)
        self.count = sum(int(np.prod(root.shape)) for root in roots)
        self.reads = any(leaf.op == "reading" for leaf in leaves(roots))

    def linearize(self, engine: Arithmetic, box: Box, center: Floats) -> Linearization | None:
        """On a bounded box, at a point of it; None where F or a derivative is not defined or not bounded.

        The Jacobian encloses the derivatives (where they exist) at all points of the box, so that it encloses all
        slopes (F(x) - F(y)) between two of its points.
        """
        both = IntervalArray(np.stack([box.lo, center]), np.stack([box.hi, center]))
        with np.errstate(all="ignore"):
            slots = self._tape.forward(engine, both)
            if not self._tape.defined(slots):
                return None
            value = self._values([slots[self._tape.slot(root)][-1:] for root in self._tape.roots])
            slots = [slot[:1] for slot in slots]
            tangents = self._tape.tangents(engine, slots, self._seeds)
            jacobian = self._stacked([tangents[self._tape.slot(root)] for root in self._tape.roots])
        bounds = (jacobian.lo, jacobian.hi, value.lo, value.hi)
        if not all(bool(np.isfinite(bound).all()) for bound in bounds):
            return None
        return Linearization(value, jacobian, center)

    def estimate(self, point: Floats) -> tuple[Floats, Floats]:
        """F (m,) and its Jacobian (m, n) at a point, in floating point without proof."""
        engine = Point()
        with np.errstate(all="ignore"):
            slots = self._tape.forward(engine, IntervalArray.point(point[None]))
            tangents = self._tape.tangents(engine, slots, self._seeds)
            jacobian = self._stacked([tangents[self._tape.slot(root)] for root in self._tape.roots])
            return self._values([slots[self._tape.slot(root)] for root in self._tape.roots]).lo, jacobian.lo

    def _values(self, parts: list[IntervalArray]) -> IntervalArray:
        flat = [part.reshape((-1,)) for part in parts]
        return _joined(flat, np.zeros(0))

    def _stacked(self, parts: list[IntervalArray | None]) -> IntervalArray:
        """Tangents of shape (n, *S) as rows of the Jacobian."""
        n = self._size
        rows = []
        for root, part in zip(self._tape.roots, parts, strict=True):
            count = int(np.prod(root.shape))
            if part is None:
                part = IntervalArray.point(np.zeros((n, count)))
            flat = part.reshape((n, count))
            rows.append(IntervalArray(flat.lo.T, flat.hi.T))
        return _joined(rows, np.zeros((0, n)))


def _joined(parts: list[IntervalArray], nothing: Floats) -> IntervalArray:
    lo = np.concatenate([nothing, *(part.lo for part in parts)])
    return IntervalArray(lo, np.concatenate([nothing, *(part.hi for part in parts)]))


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
