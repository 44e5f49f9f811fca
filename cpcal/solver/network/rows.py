"""The constraints as rows `r(x, m) <= 0`, evaluated at a point, with derivatives. Nothing here is a proof."""

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cpcal.common.values import ArrayPair, Bools, Floats, Indices
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import sweeps
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.polynomial import one_sided_rows
from cpcal.solver.network.tape import ReadingSets, Tape

_GOLDEN = 0.6180339887498949  # multiples of it, without their whole parts, are spread evenly


class RowValues(NamedTuple):
    """At one point: row values (K,) and Jacobian (K, n), at the readings that make each row smallest, or largest."""

    values: Floats
    jacobian: Floats


class Extremes:
    """The ends of the reading sets at which each element of some roots is smallest or largest, to first order.

    `every`: what is asked of one reading is asked of all of them, and each element is taken where it is largest.
    """

    def __init__(self, network: ConstraintNetwork, *roots: Expr, every: bool = False) -> None:
        self.tape, self._asked = shared_tape(network, roots), int(every)

    @property
    def exclusive(self) -> bool:
        """Whether no component of a reading enters two elements: else one value of it must serve both."""
        reach = self.tape.reach.leaf
        readings = reach[reach >= self.tape.program.given]
        return len(np.unique(readings)) == len(readings)

    def at(self, point: Floats) -> ArrayPair:
        """Values of all readings that make the elements smallest, and largest, at a point (n,).

        For a reading that several elements share, their sum.
        """
        program = self.tape.program
        grows = sweeps.total_slopes(program, self.tape.near(point[None])[0])[program.given :] > 0.0
        sets = self.tape.sets
        return np.where(grows, sets.lo, sets.hi), np.where(grows, sets.hi, sets.lo)

    def slots(self, point: Floats) -> Floats:
        """All slots (1, M) at a point (n,), the readings where they make the elements smallest, or largest."""
        return self.tape.near(point[None], self.at(point)[self._asked] if self.tape.readings else None)

    def linearize(self, point: Floats) -> RowValues:
        """All elements at a point (n,), each where its readings make it smallest, or largest."""
        slots = self.slots(point)
        return RowValues(slots[0, self.tape.program.roots], self.tape.near_jacobians(slots)[0])

    def jacobians(self, points: Floats) -> Floats:
        """Derivatives (B, K, n) at points (B, n), each as `linearize` has it."""
        each = [self.slots(point) for point in points] if self.tape.readings else [self.tape.near(points)]
        return self.tape.near_jacobians(np.concatenate(each))

    def second_order(self, point: Floats) -> float:
        """How far some element is from linear in the readings across their sets: a second difference."""
        if not self.tape.readings:
            return 0.0
        low, high = self.at(point)
        smallest, center, largest = (self.tape.near(point[None], readings) for readings in (low, None, high))
        bend = 0.5 * np.abs(smallest + largest - 2.0 * center)[0, self.tape.program.roots]
        return float(np.max(bend, where=np.isfinite(bend), initial=0.0))


class Rows:
    """All one-sided rows of a network, in the order of its constraints; for some readings, or for `every` one."""

    def __init__(self, network: ConstraintNetwork, *, every: bool = False) -> None:
        rows = one_sided_rows(network)
        # one reading may be at one end for one row and at the other end for the next
        reading = any("reading" in row.expr.ops for row in rows)
        self._constraints, self.every = len(network.constraints), every and reading
        groups = [[row] for row in rows] if reading else [rows]
        self._parts = [Extremes(network, *(row.expr for row in group), every=every) for group in groups if group]
        ends = np.cumsum([0, *(row.expr.size for row in rows)]).tolist()
        # of each row its constraint, where its elements stand, and how many there are along the leading axis
        self._blocks = [
            (row.constraint, slice(start, end), math.prod(row.expr.shape[1:]))
            for row, start, end in zip(rows, ends, ends[1:], strict=False)
        ]
        self.count, self._size = int(ends[-1]), len(network.names)

    def linearize(self, point: Floats) -> RowValues:
        """Values and derivatives at a point (n,)."""
        none = RowValues(np.zeros(0), np.zeros((0, self._size)))
        parts = [none, *(part.linearize(point) for part in self._parts)]
        return RowValues(*map(np.concatenate, zip(*parts, strict=True)))

    def jacobians(self, points: Floats) -> Floats:
        """Derivatives (B, K, n) at points (B, n), B at least 1."""
        parts = [part.jacobians(points) for part in self._parts]
        return np.concatenate([np.zeros((len(points), 0, self._size)), *parts], axis=1)

    def telling(self, point: Floats, most: int) -> list[Indices]:
        """For each constraint the elements (along its leading axis) that say most about boxes around a point.

        For each side those that the point violates most, and as many that are spread over all, at most `most` of both.
        """

        def chosen(own: Floats) -> Indices:
            own = np.where(np.isfinite(own), own, np.inf)
            worst = np.arange(own.size) if own.size <= most else np.argpartition(-own, most)[:most]
            return np.concatenate([worst, (np.arange(most) * _GOLDEN % 1.0 * own.size).astype(np.intp)])

        return self._each(point, chosen)

    def violated(self, point: Floats, most: int) -> list[Indices]:
        """For each constraint the elements (along its leading axis) that a point violates: at most `most` for each
        side, those that it violates most.
        """

        def chosen(own: Floats) -> Indices:
            some = np.flatnonzero(own > 0.0)
            return some[np.argsort(-own[some], kind="stable")[:most]]

        return self._each(point, chosen)

    def _each(self, point: Floats, chosen: Callable[[Floats], Indices]) -> list[Indices]:
        """Of each constraint the elements of the leading axis that are chosen by some row's values at a point."""
        out = [[np.zeros(0, np.intp)] for _ in range(self._constraints)]
        with np.errstate(all="ignore"):
            each = [part.slots(point)[0, part.tape.program.roots] for part in self._parts]
        values = np.concatenate([np.zeros(0), *each])
        for constraint, where, width in self._blocks:
            out[constraint].append(chosen(values[where]) // width)
        return [np.unique(np.concatenate(elements)) for elements in out]

    def second_order(self, point: Floats) -> float:
        """How far some row is from linear in its readings across their sets: a second difference, in the row's unit.

        This is what a relaxation that is exact to first order in the readings may lose.
        """
        with np.errstate(all="ignore"):
            return max((part.second_order(point) for part in self._parts), default=0.0)


# ------------------------------------------------------------------------------------------------------------------
# Tapes, which several contractors, fits and proofs sweep over.


def shared_tape(network: ConstraintNetwork, roots: Sequence[Expr]) -> Tape:
    """Written once for a network and its copies."""
    return network.once(b"".join(root.digest for root in roots), lambda: Tape(network, roots))


def rows_tape(network: ConstraintNetwork) -> Tape:
    """Of all rows `r <= 0`, in the order of the constraints."""
    return shared_tape(network, [row.expr for row in one_sided_rows(network)])


# ------------------------------------------------------------------------------------------------------------------
# Readings that a row can do without: where a row only grows with a reading, the reading's end decides.
#
# A row asks for SOME reading m in its set with `r(x, m) <= 0`. Where the derivative of r with respect to a
# component of m keeps its sign for all x in a box and all readings in their sets, r is smallest at an end of that
# component, so the component may be replaced by that end: nothing is lost, and nothing of second order is added.


class DecisiveReadings:
    """For each one-sided row of a network, on any box, the part of every reading set that can matter."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self.tape = rows_tape(network)

    def on(self, box: Box, least: float = 0.0) -> list[ReadingSets]:
        """One collection of reading sets per row; components that decide at an end are single points.

        Empty collections, for whole sets, where less than the share `least` of the components that can decide does.
        """
        tape = self.tape
        whole: list[ReadingSets] = [{} for _ in tape.roots]
        if not tape.readings:
            return whole
        slots = tape.forward(box.array[None])
        if not tape.continuous(slots):  # monotone on either side of a pole is not monotone
            return whole
        g = tape.gradients(slots[0])
        parts = [self._sets(g, *paths) for paths in self._paths]
        decided, able = (sum(counts[k] for _, *counts in parts) for k in (0, 1))
        return [sets for sets, *_ in parts] if decided >= least * able else whole

    @cached_property
    def _paths(self) -> list[tuple[Indices, Indices, Bools]]:
        """Of each root the components of readings, from the first one on, that enter one of its rows (those that enter
        two stay as they are), where their derivatives stand, and which have a width."""
        reach, first, out = self.tape.reach, self.tape.program.given, []
        for rows in map(self.tape.rows, self.tape.roots):
            mine = (reach.leaf >= first) & (reach.row >= rows.start) & (reach.row < rows.stop)
            leaf = reach.leaf[mine] - first
            alone = np.bincount(leaf)[leaf] == 1
            leaf = leaf[alone]
            out.append((leaf, reach.entry[mine][alone], (self.tape.sets.lo < self.tape.sets.hi)[leaf]))
        return out

    def _sets(self, g: IntervalArray, leaf: Indices, entry: Indices, wide: Bools) -> tuple[ReadingSets, int, int]:
        """How many components decide, and of how many that have a width and enter one row."""
        data, first = self.tape.sets, self.tape.program.given
        lo, hi = data.copied()
        up = g.lo[entry] >= 0.0
        down = (g.hi[entry] <= 0.0) & ~up
        hi[leaf[up]], lo[leaf[down]] = data.lo[leaf[up]], data.hi[leaf[down]]
        places = self.tape.reading_slots.items() if leaf.size else ()
        sets = {digest: IntervalArray(lo, hi)[where - first] for digest, where in places}
        return sets, int((wide & (up | down)).sum()), int(wide.sum())
