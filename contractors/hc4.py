"""hc4: one forward and one backward sweep over the whole network (HC4-revise on a shared DAG)."""

from __future__ import annotations

import itertools
import math
import time
from functools import partial

import numpy as np

from cpcal.solver.contract import Composable, Contraction, narrowed, repeated
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, rows_tape


class HC4(Composable):
    """Natural interval evaluation of every constraint, then narrowing of its arguments down to the variables.

    Works on any network and any box, also unbounded ones. Readings are narrowed like variables but never
    reported: a reading is a number that exists in its set. `sweeps` is how often the two sweeps are repeated, unless
    nothing moves.
    """

    def __init__(
        self, network: ConstraintNetwork, *, objective: str | None = None, arithmetic: str = "float64", sweeps: int = 1
    ) -> None:
        self._engine, self._sweeps = get_arithmetic(arithmetic), sweeps
        self._tape = rows_tape(network)

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        left = self.contract_batch(box.array[None])
        return narrowed("hc4", box, box.intersect(box.with_bounds(left.lo[0], left.hi[0])))

    def contract_batch(self, boxes: IntervalArray, deadline: float = math.inf) -> IntervalArray:
        """Contract B boxes at once: shape (B, n) in and out, NaN where a box holds no solution."""
        return self._tape.contract(self._engine, boxes, self._sweeps)


# ------------------------------------------------------------------------------------------------------------------
# box: box consistency. In one variable at a time, the others held at their intervals, the ends that no constraint
# admits are cut off by bisection and univariate interval Newton.
#
# After Benhamou, McAllester and Van Hentenryck, CLP(Intervals) revisited (1994). hc4 loses what several occurrences
# of one variable have in common; a thin slice of that variable does not.

_REFINEMENTS = 20  # of the two ends of one variable


class BoxConsistency(Composable):
    """Narrows every bounded variable until its first and last `precision` of the width can not be refuted.

    The variables have their turns again (at most `most` times) while some width shrinks below 0.9 times what it was.
    """

    monotone_tolerance = np.inf  # where pieces end depends on the box

    def __init__(
        self,
        network: ConstraintNetwork,
        *,
        objective: str | None = None,
        arithmetic: str = "float64",
        precision: float = 1e-2,
        most: int = 5,
    ) -> None:
        self._engine = get_arithmetic(arithmetic)
        self._tape = rows_tape(network)
        self._precision, self._most = precision, most

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        after = repeated(partial(self._round, deadline), box, ratio=0.9, most=self._most).box
        return narrowed("box", box, after)

    def _round(self, deadline: float, box: Box) -> Contraction:
        for component in range(len(box)):
            box = box if time.monotonic() > deadline else self._narrowed(box, component)
        return Contraction(box)

    def _narrowed(self, box: Box, component: int) -> Box:
        """One variable's turn. The pieces not refuted so far are kept in order; the first and last are refined."""
        if box.is_empty or not 0.0 < box.width[component] < np.inf:
            return box
        tolerance = self._precision * float(box.width[component])
        pieces = [(float(box.lo[component]), float(box.hi[component]))]
        for _ in range(_REFINEMENTS):
            ends = [k for k in sorted({0, len(pieces) - 1}) if pieces[k][1] - pieces[k][0] > 1.5 * tolerance]
            if not ends:
                break
            lo, hi = np.array([part for k in ends for part in _graded(*pieces[k], tolerance)]).T
            with np.errstate(all="ignore"):
                tested = self._tested(box, component, IntervalArray(lo, hi))
            left = [(a, b) for a, b in zip(tested.lo.tolist(), tested.hi.tolist(), strict=True) if a <= b]
            pieces = sorted(left + [piece for k, piece in enumerate(pieces) if k not in ends])
            if not pieces:
                return Box.empty(box.names)
        return box.replace(component, lo=pieces[0][0], hi=pieces[-1][1])

    def _tested(self, box: Box, component: int, pieces: IntervalArray) -> IntervalArray:
        """For K pieces (K,) what the rows r <= 0 leave of each; NaN where some row is positive or undefined."""
        slots = self._tape.forward(self._engine, _with(box, component, pieces))
        refuted = (~(self._tape.values(slots).lo <= 0.0)).any(axis=1)
        left = IntervalArray(np.where(refuted, np.nan, pieces.lo), np.where(refuted, np.nan, pieces.hi))
        if not self._tape.continuous(self._engine, slots):
            return left
        return left.intersect(self._newton(box, component, pieces, slots))

    def _newton(self, box: Box, component: int, pieces: IntervalArray, slots: IntervalArray) -> IntervalArray:
        """Of each piece X the x with `r(c) + r'(X) (x - c) <= 0` for all rows, c in its middle."""
        e, tape = self._engine, self._tape
        slope = self._slopes(slots, component)
        c = IntervalArray.point(pieces.mid)
        low = tape.values(tape.forward(e, _with(box, component, c))).lo
        away = e.sub(pieces, c)
        known = np.isfinite(slope.lo) & np.isfinite(slope.hi) & np.isfinite(low)
        room = IntervalArray(np.full(low.shape, -np.inf), np.where(known, -low, np.inf))
        slope = IntervalArray(np.where(known, slope.lo, 0.0), np.where(known, slope.hi, 0.0))
        step = e.factor(room, slope, away.reshape((len(low), 1)).broadcast_to(low.shape))
        lo = np.maximum(away.lo, step.lo.max(axis=1, initial=-np.inf))
        hi = np.minimum(away.hi, step.hi.min(axis=1, initial=np.inf))
        empty = ~(lo <= hi)
        return e.add(c, IntervalArray(np.where(empty, np.nan, lo), np.where(empty, np.nan, hi)))

    def _slopes(self, slots: IntervalArray, component: int) -> IntervalArray:
        """Derivatives (K, rows) by one component, from the slots (K, M) of the pieces."""
        e, tape = self._engine, self._tape
        parts = [tape.jacobian(e, tape.derivatives(e, slots[k]))[:, component] for k in range(slots.shape[0])]
        return IntervalArray(np.stack([part.lo for part in parts]), np.stack([part.hi for part in parts]))


def _graded(lo: float, hi: float, tolerance: float) -> list[tuple[float, float]]:
    """A cover of an interval by pieces that are finest, of size `tolerance`, at both ends and double inwards."""
    half = 0.5 * hi - 0.5 * lo
    with np.errstate(over="ignore"):
        steps = tolerance * (2.0 ** np.arange(1, 64) - 1.0)
    steps = steps[steps < half]
    ends = np.unique(np.clip(np.concatenate([[lo, hi], lo + steps, hi - steps]), lo, hi))
    return [(float(a), float(b)) for a, b in itertools.pairwise(ends)]


def _with(box: Box, component: int, values: IntervalArray) -> IntervalArray:
    """One box for each value (K,) of one component: shape (K, n)."""
    lo, hi = (np.repeat(bound[None], len(values.lo), axis=0) for bound in (box.lo, box.hi))
    lo[:, component], hi[:, component] = values.lo, values.hi
    return IntervalArray(lo, hi)
