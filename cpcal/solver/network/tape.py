"""The tape: the expressions under some roots, written out once as a flat list of operations on scalars.

Bounds of all slots, for B boxes, are an `IntervalArray` of shape (B, M): first the n components of the box, then
constants, then readings, then the operations. The sweeps over it are `sweeps`; for their arithmetic see `engines`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpcal.common.values import Bools, Floats, Ints
from cpcal.solver.compiled import compiled
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.interval.arithmetic import in_arithmetic
from cpcal.solver.interval.operations import ADD, CODES, CONTINUOUS, DEFINED, MUL, SQR, SUB, value
from cpcal.solver.network import sweeps
from cpcal.solver.network.expression import SELECTS, Expr, topological
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.sweeps import needed, reach

# ------------------------------------------------------------------------------------------------------------------
# A tape at one point in plain numbers, for proposals: nothing here is a bound.


@compiled
def near(code: Ints, arg: Ints, par: Ints, first: int, slots: Floats) -> None:
    """Numbers near the values of all operations at one point, from the leaves: for proposals, three times faster."""
    for k in range(len(code)):
        c, a, b = code[k], slots[arg[k, 0]], slots[arg[k, 1]]
        if c == ADD:
            slots[first + k] = a + b
        elif c == MUL:
            slots[first + k] = a * b
        elif c == SUB:
            slots[first + k] = a - b
        elif c == SQR:
            slots[first + k] = a * a
        else:
            lo, hi = value(c, par[k], a, a, b, b)
            slots[first + k] = 0.5 * lo + 0.5 * hi


def sweeps_of(engine: Arithmetic) -> Any:
    """The functions of `sweeps`, and of the table of operations, by name, in an engine's arithmetic."""
    return in_arithmetic(engine.name, sweeps)


# For readings, by the digest of their leaf: values or smaller sets.
ReadingSets = Mapping[bytes, IntervalArray]


@dataclass(frozen=True)
class Reach:
    """Sparse derivatives of the roots' elements by variables and readings: entry p is that of `row[p]` by `leaf[p]`.

    `order` lists, from `start[r]` on, what element r is computed from; `entry` are the places of its leaves in it.
    """

    start: Ints
    order: Ints
    entry: Ints
    row: Ints
    leaf: Ints


class Tape:
    """Immutable. `size` n is the number of a box's components, `count` K that of all roots' elements."""

    def __init__(self, network: ConstraintNetwork, roots: Iterable[Expr]) -> None:
        self.roots = tuple(roots)
        writer = _Writer(network, self.roots)
        self.size, self.first, self.given = len(network.names), writer.first, writer.given
        self.readings = writer.readings
        self.reading_slots = {leaf.digest: writer.slots[leaf.digest] for leaf in self.readings}
        self._leaves = writer.leaves
        self.code, self.arg, self.par = writer.table()
        self._slots = {root.digest: writer.slots[root.digest] for root in self.roots}
        self._drop_unused()
        flat = [self._slots[root.digest].ravel() for root in self.roots]
        self.root_slots: Ints = np.concatenate([np.zeros(0, np.int64), *flat])
        self.count = len(self.root_slots)

    def _drop_unused(self) -> None:
        """Elements that no root takes, as of `sqrt(v)[0]` the others: where they are defined restricts nothing."""
        flat = [slots.ravel() for slots in self._slots.values()]
        used = needed(self.arg, self.first, np.concatenate([np.zeros(0, np.int64), *flat]))
        if used.all():
            return
        number = np.concatenate([np.arange(self.first), self.first + np.cumsum(used) - 1])
        self.code, self.arg, self.par = self.code[used], number[self.arg[used]], self.par[used]
        self._slots = {digest: number[slots] for digest, slots in self._slots.items()}

    def rows(self, expr: Expr) -> slice:
        """Where the elements of a root stand among those of all roots."""
        start = 0
        for root in self.roots:
            width = int(np.prod(root.shape))
            if root.digest == expr.digest:
                return slice(start, start + width)
            start += width
        raise KeyError(expr)

    @property
    def program(self) -> tuple[Ints, Ints, Ints, int]:
        """Codes, arguments, exponents and the first operation's slot: how every sweep begins."""
        return self.code, self.arg, self.par, self.first

    def leaves(self, readings: ReadingSets | None = None) -> IntervalArray:
        """Bounds of constants and readings, which `readings` may replace."""
        if not readings:
            return self._leaves
        lo, hi = self._leaves.lo.copy(), self._leaves.hi.copy()
        for digest, values in readings.items():
            if digest in self.reading_slots:
                where = self.reading_slots[digest] - self.size
                lo[where], hi[where] = values.lo, values.hi
        return IntervalArray(lo, hi)

    def forward(self, engine: Arithmetic, boxes: IntervalArray, readings: ReadingSets | None = None) -> IntervalArray:
        """Bounds (B, M) of every slot over boxes (B, n); `readings` may replace sets by other values."""
        lo, hi = np.empty((2, boxes.shape[0], self.first + len(self.code)))
        leaves = self.leaves(readings)
        lo[:, self.size : self.first], hi[:, self.size : self.first] = leaves.lo, leaves.hi
        sweeps_of(engine).forward_all(*self.program, *_own(boxes), lo, hi)
        return IntervalArray(lo, hi)

    def near(self, point: Floats, readings: ReadingSets | None = None) -> Floats:
        """Numbers near all roots' elements (K,) at a point (n,) and the middles of constants and readings."""
        slots = np.concatenate([point, self.leaves(readings).mid, np.empty(len(self.code))])
        near(*self.program, slots)
        return np.asarray(slots[self.root_slots])

    def value(self, slots: IntervalArray, root: Expr) -> IntervalArray:
        """Bounds (B, *S) of a root."""
        return slots[:, self._slots[root.digest]]

    def values(self, slots: IntervalArray) -> IntervalArray:
        """Bounds (B, K) of all roots' elements."""
        return slots[:, self.root_slots]

    def contract(self, engine: Arithmetic, boxes: IntervalArray, sweeps: int = 1) -> IntervalArray:
        """hc4 for `root <= 0`: what is left of boxes (B, n); NaN where nothing is."""
        lo, hi = _own(boxes)
        leaves = self.leaves()
        program = (*self.program, self.given, self.root_slots, leaves.lo, leaves.hi)
        sweeps_of(engine).contract_all(*program, lo, hi, sweeps)
        return IntervalArray(lo, hi)

    def continuous(self, engine: Arithmetic, slots: IntervalArray) -> bool:
        """Whether every operation is defined and continuous at all points that the slots (B, M) enclose."""
        return self._quality(engine, slots) == CONTINUOUS

    def defined(self, engine: Arithmetic, slots: IntervalArray) -> bool:
        """Whether every operation is defined at all points that the slots (B, M) enclose."""
        return self._quality(engine, slots) >= DEFINED

    def _quality(self, engine: Arithmetic, slots: IntervalArray) -> int:
        out = [self.qualities(engine, slots[k]) for k in range(slots.shape[0])]
        return int(np.min(out, initial=CONTINUOUS))

    def qualities(self, engine: Arithmetic, slots: IntervalArray) -> Ints:
        """The quality of every operation (P,) over slots (M,)."""
        out = np.empty(len(self.code), np.int64)
        sweeps_of(engine).qualities(self.code, self.arg, self.par, slots.lo, slots.hi, out)
        return out

    def continuous_rows(self, engine: Arithmetic, slots: IntervalArray) -> Bools:
        """Which of the roots' elements (K,) are continuous at all points that the slots (M,) enclose."""
        out = np.full(self.count, CONTINUOUS, np.int64)
        paths = self.reach
        sweeps_of(engine).row_qualities(self.first, paths.start, paths.order, self.qualities(engine, slots), out)
        return np.asarray(out == CONTINUOUS)

    @cached_property
    def reach(self) -> Reach:
        """What every element of the roots is computed from."""
        start, room = np.zeros(self.count + 1, np.int64), 4 * (self.first + len(self.code))
        while True:
            order = np.empty(room, np.int64)
            count = reach(self.arg, self.first, self.size, self.given, self.root_slots, start, order)
            if count <= room:
                break
            room = count
        order = order[:count].copy()
        entry = np.flatnonzero(order < self.first)
        row = np.repeat(np.arange(self.count), np.diff(start))[entry]
        return Reach(start, order, entry, row, order[entry])

    def derivatives(self, engine: Arithmetic, slots: IntervalArray) -> Floats:
        """Bounds of every operation's partial derivatives over slots (M,), for `gradients`: shape (P, 4)."""
        out = np.empty((len(self.code), 4))
        sweeps_of(engine).all_partials(*self.program, slots.lo, slots.hi, out)
        return out

    def slopes(self, engine: Arithmetic, center: IntervalArray, slots: IntervalArray) -> Floats:
        """Bounds of every operation's slopes from the slots (M,) at a centre to those anywhere: shape (P, 4)."""
        out = np.empty((len(self.code), 4))
        sweeps_of(engine).all_slopes(*self.program, center.lo, center.hi, slots.lo, slots.hi, out)
        return out

    def gradients(self, engine: Arithmetic, factors: Floats) -> IntervalArray:
        """Derivatives (or slopes) of all roots' elements along `reach.order`: those at `reach.entry` mean something."""
        paths = self.reach
        lo, hi = np.zeros(len(paths.order)), np.zeros(len(paths.order))
        where = (self.arg, self.first, self.size, self.given, self.root_slots, paths.start, paths.order)
        sweeps_of(engine).gradients(*where, factors, lo, hi)
        return IntervalArray(lo, hi)

    def moved(self, engine: Arithmetic, factors: Floats, start: IntervalArray, moves: IntervalArray) -> IntervalArray:
        """`start` (K,) plus the derivatives by all readings times their `moves` (constants and readings)."""
        g, paths = self.gradients(engine, factors), self.reach
        x = np.zeros((self.first, 2))
        x[self.size :, 0], x[self.size :, 1] = moves.lo, moves.hi
        lo, hi = start.lo.copy(), start.hi.copy()
        sweeps_of(engine).row_products(paths.start, paths.order, self.given, self.first, g.lo, g.hi, x, lo, hi)
        return IntervalArray(lo, hi)

    def jacobian(self, engine: Arithmetic, factors: Floats) -> IntervalArray:
        """Derivatives (or slopes) of all roots' elements by the box's components: (K, n)."""
        g, paths = self.gradients(engine, factors), self.reach
        lo, hi = np.zeros((self.count, self.size)), np.zeros((self.count, self.size))
        of_box = paths.leaf < self.size
        row, column, entry = paths.row[of_box], paths.leaf[of_box], paths.entry[of_box]
        lo[row, column], hi[row, column] = g.lo[entry], g.hi[entry]
        return IntervalArray(lo, hi)

    def point_jacobians(self, engine: Arithmetic, points: Floats) -> Floats:
        """About the derivatives of all roots' elements by the box's components (B, K, n), at points (B, n)."""
        out, paths = np.zeros((len(points), self.count, self.size)), self.reach
        where = (self.given, self.root_slots, paths.start, paths.order, self._leaves.lo, self._leaves.hi)
        sweeps_of(engine).point_jacobians(*self.program, *where, np.array(points, np.float64, order="C"), out)
        return out


def _own(boxes: IntervalArray) -> tuple[Floats, Floats]:
    """Bounds in new arrays: kernels are compiled for arrays that may be written."""
    return np.array(boxes.lo, np.float64, order="C"), np.array(boxes.hi, np.float64, order="C")


class _Writer:
    """Writes expressions out; `slots` holds for every node, by its digest, the slots of its elements."""

    def __init__(self, network: ConstraintNetwork, roots: tuple[Expr, ...]) -> None:
        nodes = topological(roots)
        self.slots: dict[bytes, Ints] = {}
        self._next = 0
        for leaf in network.variables:
            self._place(leaf)
        constants = [node for node in nodes if node.op == "constant"]
        self.readings = tuple(node for node in nodes if node.op == "reading")
        for leaf in constants:
            self._place(leaf)
        self.given = self._next
        for leaf in self.readings:
            self._place(leaf)
        self.first = self._next
        data = [leaf.data for leaf in (*constants, *self.readings)]
        known = [values for values in data if isinstance(values, IntervalArray)]
        self.leaves = IntervalArray(
            np.concatenate([np.zeros(0), *(values.lo.ravel() for values in known)]),
            np.concatenate([np.zeros(0), *(values.hi.ravel() for values in known)]),
        )
        self._blocks: list[Ints] = [np.zeros((0, 4), np.int64)]  # code, two arguments, exponent
        self._single: list[tuple[int, int, int, int]] = []  # operations after them
        for node in nodes:
            if node.args:
                self.slots[node.digest] = self._written(node, [self.slots[arg.digest] for arg in node.args])

    def table(self) -> tuple[Ints, Ints, Ints]:
        self._gather()
        rows = np.concatenate(self._blocks)
        return rows[:, 0].copy(), rows[:, 1:3].copy(), rows[:, 3].copy()

    def _place(self, leaf: Expr) -> None:
        size = math.prod(leaf.shape)
        self.slots[leaf.digest] = np.arange(self._next, self._next + size).reshape(leaf.shape)
        self._next += size

    def _written(self, node: Expr, args: list[Ints]) -> Ints:
        if node.op == "index":
            assert isinstance(node.data, np.ndarray)
            return np.asarray(args[0].ravel()[node.data])
        if node.op == "mul" and node.parameter == SELECTS:
            return np.where(self._ones(node.args[1]), *(np.broadcast_to(arg, node.shape) for arg in args))
        if node.op == "sum":
            return self._total(np.moveaxis(args[0], node.parameter, 0))
        if node.shape:
            args = [np.broadcast_to(arg, node.shape) for arg in args]
        return self._emitted(CODES[node.op], args, node.parameter)

    @staticmethod
    def _ones(mask: Expr) -> Bools:
        assert isinstance(mask.data, IntervalArray)
        return np.asarray(mask.data.lo == 1.0)

    def _total(self, terms: Ints) -> Ints:
        """Sums along axis 0, as a tree: rounding errors grow with its depth."""
        while len(terms) > 1:
            half = len(terms) // 2
            paired = self._emitted(ADD, [terms[:half], terms[half : 2 * half]])
            terms = np.concatenate([paired, terms[2 * half :]])
        return np.asarray(terms[0])

    def _emitted(self, code: int, args: list[Ints], parameter: int = 0) -> Ints:
        """The slots of one operation on all elements. Many networks have thousands of single ones: no arrays then."""
        shape = args[0].shape
        size, start = math.prod(shape), self._next
        self._next += size
        if size == 1:
            self._single.append((code, args[0].item(), args[-1].item(), parameter))
            return np.full(shape, start)
        self._gather()
        block = np.empty((size, 4), np.int64)
        block[:, 0], block[:, 1], block[:, 2], block[:, 3] = code, args[0].ravel(), args[-1].ravel(), parameter
        self._blocks.append(block)
        return np.arange(start, start + size).reshape(shape)

    def _gather(self) -> None:
        """Single operations as a block."""
        if self._single:
            self._blocks.append(np.array(self._single, np.int64))
            self._single = []
