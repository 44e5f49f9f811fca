"""Proof of a point: x solves the network at a value of the objective, for some readings in their sets.

All in interval arithmetic. A constraint without readings is evaluated; for one with readings see
`cpcal.solver.existence.ReadingConstraint`. Equations hold at no point of float64 numbers as a rule: a solution of them
is proved to exist in a tiny box, on which everything else must hold.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cpcal.common.values import ArrayLike, Bools, Floats, Indices, Places, all_finite, floats
from cpcal.solver.existence.operators import Equalities
from cpcal.solver.existence.unique import (
    ReadingConstraint,
    UniquenessProver,
    excess_for_some,
    reads,
    sides,
    upper_ends,
)
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import Constraint, ConstraintNetwork, one_sided_rows, rows_tape
from cpcal.solver.network.expression import topological
from cpcal.solver.network.rows import DecisiveReadings, Rows, shared_tape

# ------------------------------------------------------------------------------------------------------------------
# The equations of a network, as a proof of a feasible point needs them: a solution exists near an approximate one.
#
# Of m equations in n components, m components are unknowns; the others stay at the point's own values. The unknowns are
# chosen far from the ends of their domains and so that the square Jacobian is far from singular.

_SINGULAR = 1e-11  # of the largest pivot
_WIDEST = 1e6  # of the distance to the ends of a domain, in units of the point
_NEAR = 1e-9  # relative to the point: a component so near to an end of its domain is put there


class Equations:
    """Those without readings. `rest` is the network of everything else; `enter` says which components they hold."""

    def __init__(self, network: ConstraintNetwork) -> None:
        plain = network.without_constraints()
        plain.add([c for c in network.constraints if not reads(c)])
        self._equalities = Equalities(plain)
        self.count, self.rest, self.rows = self._equalities.count, self._equalities.rest, self._equalities.rows
        reach = self._equalities.tape.reach.leaf
        self.enter = frozenset(reach[reach < len(network.names)].tolist())
        self._network = plain
        self._flat = [part for root in self._equalities.roots for part in (root.reshape(-1) if root.shape else [root])]
        self._provers = dict[Places, UniquenessProver]()  # by the equations that they are about

    def solved(self, point: Floats, domain: Box) -> Box | None:
        """A tiny box around the point (n,) in which the equations have a solution; the others are single numbers."""
        lo, hi = domain.lo, domain.hi
        near = _NEAR * np.maximum(np.abs(point), 1.0)
        low, high = point - lo <= near, hi - point <= near  # components next to an end of their domain are put there
        point, free = np.where(low, lo, np.where(high, hi, point)), ~(low | high)
        rows = self._open(np.where(free, lo, point), np.where(free, hi, point))
        if not rows.size:
            return Box(domain.names, point, point)
        room = np.minimum(np.minimum(point - lo, hi - point), _WIDEST * np.maximum(np.abs(point), 1.0))
        unknowns = self._unknowns(point, rows, np.where(free, room, 0.0))
        if unknowns is None:
            return None
        key = tuple(rows.tolist())
        if key not in self._provers:
            alone = self._network.without_constraints()
            alone.add([self._flat[k] == 0.0 for k in key])
            self._provers[key] = UniquenessProver(alone)
        found = self._provers[key].among(point, unknowns).prove(Box(domain.names, point, point))
        return None if found is None else found.box

    def _open(self, lo: Floats, hi: Floats) -> Indices:
        """The equations that do not hold on all of a box already, as 0 times what is free in it does."""
        tape = self._equalities.tape
        with np.errstate(all="ignore"):
            slots = tape.forward(IntervalArray(lo[None], hi[None]))
            values = tape.values(slots)
            if not tape.continuous(slots):
                return np.arange(self.count)
        return np.flatnonzero((values.lo[0] != 0.0) | (values.hi[0] != 0.0))

    def _unknowns(self, point: Floats, rows: Indices, room: Floats) -> Indices | None:
        """`room` (n,): how far components may move, 0 for those that may not."""
        with np.errstate(all="ignore"):
            scaled = self.rows.linearize(point).jacobian[rows] * room
        if len(rows) > len(point) or not all_finite(scaled):
            return None
        from scipy import linalg  # here: it takes a third of a second to load

        _, r, order = linalg.qr(scaled, mode="economic", pivoting=True)
        pivots = np.abs(np.diag(r))
        if not pivots[-1] > _SINGULAR * pivots[0]:
            return None
        return np.sort(order[: len(rows)])


_TRIES = 60
_PATIENCE = 6  # tries after which each must lower the worst row


@dataclass(frozen=True)
class Witness:
    """A point (n,) proved to solve the network; `value` is its objective component.

    `around`: where there are equations, the tiny box in which a solution is proved to exist, with an objective of at
    most `value`; `point` is its middle, and solves them up to rounding. None: the point itself is the solution.
    """

    point: Floats
    value: float
    around: Box | None = None


class WitnessProver:
    """Proves points of one network."""

    def __init__(self, network: ConstraintNetwork, objective: int) -> None:
        self.objective, self._network, self._domain = objective, network, network.domain
        self._plain = _Rows(network, objective)
        self.reading = [ReadingConstraint(network, c) for c in network.constraints if reads(c)]

    def within(self, domain: Box) -> WitnessProver:
        """The same for points in a part of the network's domain."""
        other = copy(self)
        other._domain = domain
        return other

    @cached_property
    def equations(self) -> Equations:
        """Made where a point needs them: in most networks there are none."""
        return Equations(self._network)

    @cached_property
    def _rest(self) -> _Rows:
        return _Rows(self.equations.rest, self.objective)

    def prove(self, point: Floats) -> Witness | None:
        """The smallest objective (within rounding) at which the rest of `point` is proved, or None.

        The objective component of `point` is only where the search for it begins.
        """
        candidate = np.clip(point, self._domain.lo, self._domain.hi)
        if not all_finite(candidate):
            return None
        found = self._raised(self._plain, IntervalArray.point(candidate), candidate)
        if found is not None or not self.equations.count:
            return found
        solved = self.equations.solved(candidate, self._domain)  # a box that is known to hold a solution of them
        if solved is None:
            return None
        middle = solved.mid
        if self.objective in self.equations.enter:  # then they say what the objective is
            if not self._excess(self._rest, solved.array, middle)[0] <= 0.0:
                return None
            return Witness(middle, float(solved.hi[self.objective]), solved)
        found = self._raised(self._rest, solved.array, middle)
        if found is None:
            return None
        return replace(found, around=solved.replace(self.objective, lo=found.value, hi=found.value))

    def _raised(self, rows: _Rows, box: IntervalArray, middle: Floats) -> Witness | None:
        """Raise the objective until all rows hold on the box; None where that does not help, or too far."""
        candidate, o = middle.copy(), self.objective
        lo, hi = box.lo.copy(), box.hi.copy()
        increment, last = 0.0, np.inf
        for attempt in range(_TRIES):
            lo[o] = hi[o] = candidate[o]
            excess, stuck = self._excess(rows, IntervalArray(lo, hi), candidate)
            if excess <= 0.0:
                return Witness(candidate, float(candidate[o]))
            if stuck or not np.isfinite(excess) or (attempt > _PATIENCE and excess >= last):
                return None
            last = min(last, excess)
            increment = max(2.0 * increment, excess, np.spacing(abs(candidate[o])))
            candidate[o] += increment
            if candidate[o] > self._domain.hi[o]:
                return None
        return None

    def _excess(self, rows: _Rows, box: IntervalArray, point: Floats) -> tuple[float, bool]:
        """The worst row on a tiny box around the point; and whether one fails that the objective does not enter."""
        values, tape = box[None], rows.tape
        with np.errstate(all="ignore"):
            slots = tape.forward(values)
            if not tape.continuous(slots):
                return np.inf, True
            ends = upper_ends(tape.values(slots), tape.count)
            worst, stuck = float(np.max(ends, initial=-np.inf)), bool((ends[~rows.mended] > 0.0).any())
            if stuck or worst == np.inf:
                return np.inf, stuck
            return max(worst, excess_for_some(self.reading, values, point)), False


class _Rows:
    """Constraints without readings as rows `r <= 0`, and which of their elements the objective may mend."""

    def __init__(self, network: ConstraintNetwork, objective: int) -> None:
        each = zip(network.constraints, sides(network), _entered(network, objective), strict=True)
        rows = [(row, mended) for constraint, own, mended in each if not reads(constraint) for row in own]
        self.tape = shared_tape(network, [row for row, _ in rows])
        self.mended = np.concatenate([np.zeros(0, bool), *(np.full(row.size, mended) for row, mended in rows)])


# ------------------------------------------------------------------------------------------------------------------
# What proposing and proving points of one network takes, set up once for all questions about it.


class Prepared:
    """A network whose variable `objective` is to be minimised, over its domain or over parts of it.

    Each part is made when it is first wanted: a search that begins with a proved point may never propose one.
    """

    def __init__(self, network: ConstraintNetwork, objective: str) -> None:
        self.network = network
        self.name, self.objective = objective, network.names.index(objective)

    @cached_property
    def rows(self) -> Rows:
        return Rows(self.network)

    @cached_property
    def prover(self) -> WitnessProver:
        return WitnessProver(self.network, self.objective)

    @cached_property
    def minimax(self) -> bool:
        """Whether every constraint may be mended by the objective."""
        return all(_entered(self.network, self.objective))


def _entered(network: ConstraintNetwork, component: int) -> list[bool]:
    """Which constraints the variable enters that has this component."""
    leaf = next(leaf for leaf, places in network.places.items() if component in places)
    each = (topological(constraint.parts) for constraint in network.constraints)
    return network.once(("enters", leaf), lambda: [any(node.digest == leaf for node in nodes) for nodes in each])


# ------------------------------------------------------------------------------------------------------------------
# A given point, element by element: is it proved to satisfy the constraints for some reading, or to fail for all?


class PointVerdicts(NamedTuple):
    """For each element (along the constraints' leading axis, N of them): proved to hold, proved to fail, or neither."""

    holds: Bools
    fails: Bools


def verify_point(network: ConstraintNetwork, point: ArrayLike) -> PointVerdicts:
    """Verify a point (n,), one value for each component in the order of `names`.

    Element k holds when THERE EXIST readings in their sets with which all constraints hold at k; it fails when some
    constraint does not hold at k for any readings. Constraints of one element count for all.
    """
    x = floats(point)
    box, constraints = IntervalArray.point(x[None]), network.constraints
    count = max((c.body.shape[0] for c in constraints if c.body.shape), default=1)
    holds, fails = np.ones(count, bool), np.zeros(count, bool)
    for_some = np.zeros(count, np.intp)  # constraints at an element that hold, but not for all readings
    with np.errstate(all="ignore"):
        tape, decisive = rows_tape(network), DecisiveReadings(network)
        slots = tape.forward(box)
        good = (upper_ends(tape.values(slots), tape.count) <= 0.0) & tape.continuous_rows(slots[0])
        for row, sets in zip(one_sided_rows(network), decisive.on(Box(network.names, x, x)), strict=True):
            constraint, elements = constraints[row.constraint], slice(None) if row.elements is None else row.elements
            if not reads(constraint):
                met = np.ones(constraint.body.size, bool)
                met[elements] = good[tape.rows(row.expr)]
                holds &= _by_row(met, constraint, count, every=True)
            values = tape.value(tape.forward(box, sets) if sets else slots, row.expr)
            violated = np.zeros(constraint.body.size, bool)
            violated[elements] = np.where(values.empty, -np.inf, values.lo).ravel() > 0.0  # for all readings
            fails |= _by_row(violated, constraint, count, every=False)
        for constraint in filter(reads, constraints):
            one = ReadingConstraint(network, constraint)
            for_all = one.for_all(box)
            for_some += ~_by_row(for_all, constraint, count, every=True)
            holds &= _by_row(for_all | (one.excesses(box, x) <= 0.0), constraint, count, every=True)
    # two constraints that hold for some reading each need not hold for a common one
    return PointVerdicts(holds & (for_some <= 1), fails)


def _by_row(flags: Bools, constraint: Constraint, count: int, *, every: bool) -> Bools:
    """For each of `count` rows, whether every (or any) element of the constraint there has its flag set."""
    if not constraint.body.shape:
        return np.full(count, flags[0])
    rows = flags.reshape((constraint.body.shape[0], -1))
    out = np.asarray(rows.all(axis=1) if every else rows.any(axis=1))
    return np.concatenate([out, np.full(count - len(out), every)])
