"""linear_system: interval Newton with the classical methods for the linear system, for comparison with krawczyk."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from contractors.hc4 import moved_bounds
from contractors.interval_linear import enclose_gauss, enclose_krawczyk, enclose_rump
from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Arithmetic, Box, IntervalArray, get_arithmetic
from cpcal.solver.network import CentredForm, Constraint, ConstraintNetwork

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
