"""The constraints as rows `r(x, m) <= 0`, evaluated in floating point at a point, with derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network.dependence import owners
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.point import Point
from cpcal.solver.network.rewrite import one_sided_rows
from cpcal.solver.network.sweep import Slots, Tape

Readings = dict[int, IntervalArray]


@dataclass(frozen=True)
class RowValues:
    """At one point: row values (K,) and Jacobian (K, n), at the readings that make each row smallest."""

    values: Floats
    jacobian: Floats


class Extremes:
    """The ends of the reading sets at which an expression is smallest or largest, to first order."""

    def __init__(self, network: ConstraintNetwork, root: Expr) -> None:
        self.root = root
        self.tape = Tape(network, [root])
        self._engine = Point()
        leaves = [k for k, node in enumerate(self.tape.nodes) if node.op in ("constant", "reading")]
        self._sets = {k: _data(self.tape.nodes[k]) for k in leaves}
        self.owners = owners(self.tape, root)
        self.centers: Readings = {k: IntervalArray.point(values.mid) for k, values in self._sets.items()}

    def at(self, point: Floats) -> tuple[Readings, Readings]:
        """Values for every constant and reading that make the root smallest, and largest, at a point (n,)."""
        slots = self.tape.forward(self._engine, IntervalArray.point(point[None]), self.centers)
        smallest, largest = dict(self.centers), dict(self.centers)
        for k in self.tape.readings:
            slope, data = self._slope(slots, k), self._sets[k]
            smallest[k] = IntervalArray.point(np.where(slope > 0.0, data.lo, data.hi))
            largest[k] = IntervalArray.point(np.where(slope > 0.0, data.hi, data.lo))
        return smallest, largest

    def _slope(self, slots: Slots, k: int) -> Floats:
        """Derivative, with respect to each component of reading k, of the element that it enters.

        One direction per column of the reading, for all measurements at once; for a single element one per component.
        """
        shape = self.tape.nodes[k].shape
        size = int(np.prod(shape))
        width = size if int(np.prod(self.root.shape)) == 1 else int(np.prod(shape[1:]))
        column, component = np.arange(size) % max(width, 1), np.arange(size)
        seed = np.zeros((width, size))
        seed[column, component] = 1.0
        seeds = {k: IntervalArray.point(seed.reshape((width, *shape)))}
        tangent = self.tape.tangents(self._engine, slots, seeds)[self.tape.slot(self.root)]
        if tangent is None:
            return np.zeros(shape)
        element = self.owners.element[k]
        columns = tangent.lo.reshape((width, -1))
        if not shape:  # a reading that all elements share
            return np.asarray(columns.sum())
        return np.asarray(np.where(element >= 0, columns[column, element], 0.0).reshape(shape))


def _data(node: Expr) -> IntervalArray:
    assert isinstance(node.data, IntervalArray)
    return node.data


class Rows:
    """All one-sided rows of a network, in the order of its constraints."""

    def __init__(self, network: ConstraintNetwork) -> None:
        self._engine = Point()
        rows = one_sided_rows(network)
        self._size = len(network.names)
        self._constraint = [row.constraint for row in rows]
        self._parts = [Extremes(network, row.expr) for row in rows]

    def linearize(self, point: Floats) -> RowValues:
        """Values and derivatives at a point (n,)."""
        with np.errstate(all="ignore"):
            parts = [self._part(part, point) for part in self._parts]
        values: Sequence[Floats] = [np.zeros(0), *(v for v, _ in parts)]
        jacobians: Sequence[Floats] = [np.zeros((0, self._size)), *(j for _, j in parts)]
        return RowValues(np.concatenate(values), np.concatenate(jacobians))

    def likely(self, box: Box, most: int) -> list[npt.NDArray[np.intp]]:
        """For each constraint the elements (along its leading axis) that are likely to exclude points of a box.

        At most `most` for each side: those that the midpoint violates most, without those that to first order no
        point of the box violates.
        """
        chosen: list[set[int]] = [set() for _ in range(1 + max(self._constraint, default=-1))]
        with np.errstate(all="ignore"):
            for number, part in zip(self._constraint, self._parts, strict=True):
                values, jacobian = self._part(part, box.mid)
                possible = np.flatnonzero(values + np.abs(jacobian) @ box.rad > 0.0)
                worst = possible[np.argsort(-values[possible], kind="stable")[:most]]
                width = max(int(np.prod(part.root.shape[1:])), 1)
                chosen[number].update((worst // width).tolist())
        return [np.array(sorted(elements), dtype=np.intp) for elements in chosen]

    def second_order(self, point: Floats) -> float:
        """How far some row is from linear in its readings across their sets: a second difference, in the row's unit.

        This is what a relaxation that is exact to first order in the readings may lose.
        """
        worst = 0.0
        with np.errstate(all="ignore"):
            for part in (part for part in self._parts if part.tape.readings):
                k = part.tape.slot(part.root)
                low, high = part.at(point)
                smallest, center, largest = (
                    part.tape.forward(self._engine, IntervalArray.point(point[None]), readings)[k].lo
                    for readings in (low, part.centers, high)
                )
                bend = 0.5 * np.abs(smallest + largest - 2.0 * center)
                worst = max(worst, float(np.max(bend, where=np.isfinite(bend), initial=0.0)))
        return worst

    def _part(self, part: Extremes, point: Floats) -> tuple[Floats, Floats]:
        tape = part.tape
        readings = part.at(point)[0] if tape.readings else part.centers
        slots = tape.forward(self._engine, IntervalArray.point(point[None]), readings)
        k, count = tape.slot(part.root), int(np.prod(part.root.shape))
        tangent = tape.tangents(self._engine, slots, tape.variable_seeds())[k]
        jacobian = np.zeros((count, self._size)) if tangent is None else tangent.lo.reshape((self._size, count)).T
        # a derivative that is not defined, as that of a norm at zero, counts as zero
        return slots[k].lo.reshape(count), np.where(np.isfinite(jacobian), jacobian, 0.0)
