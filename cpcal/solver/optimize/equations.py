"""The equations of a network, as a proof of a feasible point needs them: a solution exists near an approximate one.

Of m equations in n components, m components are unknowns; the others stay at the point's own values. The unknowns are
chosen far from the ends of their domains and so that the square Jacobian is far from singular.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.existence import Equalities, UniquenessProver, reads
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, Expr

_SINGULAR = 1e-11  # of the largest pivot
_WIDEST = 1e6  # of the distance to the ends of a domain, in units of the point
_CORRECTIONS = 3
_NEAR = 1e-9  # relative to the point: a component so near to an end of its domain is put there


class Equations:
    """Those without readings. `rest` is the network of everything else; `enter` says which components they hold."""

    def __init__(self, network: ConstraintNetwork, engine: Arithmetic) -> None:
        plain = network.without_constraints()
        plain.add([c for c in network.constraints if not reads(c)])
        self._domain, self._equalities = network.domain, Equalities(plain)
        self._whole = network.whole
        self.count, self.rest = self._equalities.count, self._equalities.rest
        reach = self._equalities.tape.reach.leaf
        self.enter = frozenset(reach[reach < len(network.names)].tolist())
        self._network, self._engine = plain, engine
        self._flat = [part for root in self._equalities.roots for part in _elements(root)]
        self._provers: dict[tuple[int, ...], UniquenessProver] = {}  # by the equations that they are about

    def within(self, domain: Box) -> Equations:
        """The same in a part of the domain."""
        other = copy(self)
        other._domain = domain
        return other

    def estimate(self, point: Floats) -> tuple[Floats, Floats]:
        """F (m,) and its Jacobian (m, n) at a point, without proof."""
        return self._equalities.estimate(point)

    def solved(self, point: Floats) -> Box | None:
        """A tiny box around the point (n,) in which the equations have a solution; the others are single numbers."""
        point, free = self._at_ends(point)
        rows = self._open(point, free)
        if not rows.size:
            return Box(self._domain.names, point, point)
        unknowns = self._unknowns(point, rows, free)
        if unknowns is None:
            return None
        point = self._corrected(point, rows, unknowns)
        found = self._prover(rows).among(point, unknowns).prove(Box(self._domain.names, point, point))
        return None if found is None else found.box

    def _at_ends(self, point: Floats) -> tuple[Floats, Bools]:
        """The point with components that are next to an end of their domain put there; which ones are not."""
        lo, hi = self._domain.lo, self._domain.hi
        near = _NEAR * np.maximum(np.abs(point), 1.0)
        low, high = point - lo <= near, hi - point <= near
        return np.where(low, lo, np.where(high, hi, point)), ~(low | high | self._whole)

    def _open(self, point: Floats, free: Bools) -> Indices:
        """The equations that do not hold already, whatever the components are that are at no end: 0 times them, say."""
        tape = self._equalities.tape
        lo, hi = np.where(free, self._domain.lo, point), np.where(free, self._domain.hi, point)
        with np.errstate(all="ignore"):
            slots = tape.forward(self._engine, IntervalArray(lo[None], hi[None]))
            values = tape.values(slots)
            if not tape.defined(self._engine, slots):
                return np.arange(self.count)
        return np.flatnonzero((values.lo[0] != 0.0) | (values.hi[0] != 0.0))

    def _prover(self, rows: Indices) -> UniquenessProver:
        key = tuple(rows.tolist())
        if key not in self._provers:
            alone = self._network.without_constraints()
            alone.add([self._flat[k] == 0.0 for k in key])
            self._provers[key] = UniquenessProver(alone, self._engine)
        return self._provers[key]

    def _unknowns(self, point: Floats, rows: Indices, free: Bools) -> Indices | None:
        jacobian = self.estimate(point)[1][rows]
        lo, hi = self._domain.lo, self._domain.hi
        with np.errstate(all="ignore"):
            room = np.minimum(np.minimum(point - lo, hi - point), _WIDEST * np.maximum(np.abs(point), 1.0))
            scaled = jacobian * np.where(free, room, 0.0)
        if len(rows) > len(point) or not np.isfinite(scaled).all():
            return None
        from scipy import linalg  # here: it takes a third of a second to load

        _, r, order = linalg.qr(scaled, mode="economic", pivoting=True)
        pivots = np.abs(np.diag(r))
        if not pivots[-1] > _SINGULAR * pivots[0]:
            return None
        return np.sort(order[: len(rows)])

    def _corrected(self, point: Floats, rows: Indices, unknowns: Indices) -> Floats:
        """Newton's method in the unknowns alone, as long as it stays in the domain."""
        for _ in range(_CORRECTIONS):
            value, jacobian = self.estimate(point)
            new = point.copy()
            try:
                new[unknowns] -= np.linalg.solve(jacobian[np.ix_(rows, unknowns)], value[rows])
            except np.linalg.LinAlgError:
                break
            if not np.isfinite(new).all() or (new < self._domain.lo).any() or (new > self._domain.hi).any():
                break
            point = new
        return point


def _elements(root: Expr) -> list[Expr]:
    return [root] if not root.shape else list(root.reshape(-1))
