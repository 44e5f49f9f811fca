"""The tape: the expressions under some roots, written out once as a flat list of operations on scalars.

Bounds of all slots, for B boxes, are an `IntervalArray` of shape (B, M): first the n components of the box, then
constants, then readings, then the operations. The sweeps over it are `sweeps`.
"""

import math
from collections.abc import Iterable, Mapping
from functools import cached_property, lru_cache

import numpy as np

from cpcal.common.values import Bools, Floats, Shape
from cpcal.solver.interval import IntervalArray
from cpcal.solver.interval.kernels import check_rounding
from cpcal.solver.interval.operations import ADD, CODES
from cpcal.solver.network import sweeps
from cpcal.solver.network.expression import SELECTS, Expr, topological
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.sweeps import Places, Program, Reach

# For readings, by the digest of their leaf: values or smaller sets.
ReadingSets = Mapping[bytes, IntervalArray]


class Tape:
    """Immutable. `size` n is the number of a box's components, `count` K that of all roots' elements."""

    def __init__(self, network: ConstraintNetwork, roots: Iterable[Expr]) -> None:
        check_rounding()
        self.roots = tuple(roots)
        nodes = topological(self.roots)
        constants, self.readings = (tuple(node for node in nodes if node.op == op) for op in ("constant", "reading"))
        order = (*network.variables, *constants, *self.readings, *(node for node in nodes if node.args))
        number = {node.digest: k for k, node in enumerate(order)}
        sizes = [sum(leaf.size for leaf in some) for some in (network.variables, constants, self.readings)]
        form, taken = tuple(_form(node, number) for node in order), tuple(number[root.digest] for root in self.roots)
        self.program, slots = _written(form, taken, tuple(np.cumsum(sizes).tolist()))
        self._slots = {node.digest: own for node, own in zip(order, slots, strict=True)}
        self.reading_slots = {leaf.digest: self._slots[leaf.digest] for leaf in self.readings}
        sides = ([getattr(node.data, side).ravel() for node in order] for side in ("lo", "hi"))  # only leaves hold any
        self._leaves = IntervalArray(*(np.concatenate([np.zeros(0), *side]) for side in sides))
        self.size, self.count = self.program.size, len(self.program.roots)
        self.sets = self._leaves[self.program.given - self.size :]  # of all readings

    def rows(self, expr: Expr) -> slice:
        """Where the elements of a root stand among those of all roots."""
        start = 0
        for root in self.roots:
            if root.digest == expr.digest:
                return slice(start, start + root.size)
            start += root.size
        raise KeyError(expr)

    def leaves(self, readings: ReadingSets | None = None) -> IntervalArray:
        """Bounds of constants and readings, which `readings` may replace."""
        if not readings:
            return self._leaves
        lo, hi = self._leaves.lo.copy(), self._leaves.hi.copy()
        for digest, values in readings.items():
            where = self.reading_slots[digest] - self.size
            lo[where], hi[where] = values.lo, values.hi
        return IntervalArray(lo, hi)

    def forward(self, boxes: IntervalArray, readings: ReadingSets | None = None) -> IntervalArray:
        """Bounds (B, M) of every slot over boxes (B, n); `readings` may replace sets by other values."""
        first = self.program.first
        lo, hi = np.empty((2, boxes.shape[0], first + len(self.program.code)))
        leaves = self.leaves(readings)
        lo[:, : self.size], hi[:, : self.size] = boxes.lo, boxes.hi
        lo[:, self.size : first], hi[:, self.size : first] = leaves.lo, leaves.hi
        sweeps.forward_all(self.program, (lo, hi))
        return IntervalArray(lo, hi)

    def near(self, points: Floats, readings: Floats | None = None) -> Floats:
        """Numbers near all slots (B, M) at points (B, n), for readings at these values (default: in their middles).

        For proposals: nothing here is a bound.
        """
        p = self.program
        slots = np.empty((len(points), p.first + len(p.code)))
        slots[:, : self.size], slots[:, self.size : p.first] = points, self.middles
        if readings is not None:
            slots[:, p.given : p.first] = readings
        sweeps.near(p, slots)
        return slots

    def near_jacobians(self, slots: Floats) -> Floats:
        """About the derivatives (B, K, n) of all roots' elements by the box's components where `near` gives slots."""
        out = np.zeros((len(slots), self.count, self.size))
        sweeps.slopes(self.program, self.reach, slots, out)
        return out

    def value(self, slots: IntervalArray, root: Expr) -> IntervalArray:
        """Bounds (B, *S) of a root."""
        return slots[:, self._slots[root.digest]]

    def values(self, slots: IntervalArray) -> IntervalArray:
        """Bounds (B, K) of all roots' elements."""
        return slots[:, self.program.roots]

    def contract(self, boxes: IntervalArray) -> IntervalArray:
        """hc4 for `root <= 0`: what is left of boxes (B, n); NaN where nothing is."""
        left = boxes.copied()
        sweeps.contract_all(self.program, (self._leaves.lo, self._leaves.hi), left)
        return IntervalArray(*left)

    def continuous(self, slots: IntervalArray) -> bool:
        """Whether every operation is defined and continuous at all points that the slots (1, M) enclose."""
        return bool(self._continuity(slots[0]).all())

    def _continuity(self, slots: IntervalArray) -> Bools:
        out = np.empty(len(self.program.code), np.bool_)
        sweeps.continuity(self.program, (slots.lo, slots.hi), out)
        return out

    def continuous_rows(self, slots: IntervalArray) -> Bools:
        """Which of the roots' elements (K,) are continuous at all points that the slots (M,) enclose."""
        operations = self._continuity(slots)
        if operations.all():  # nothing has to know what rows are computed from
            return np.ones(self.count, bool)
        defined = np.append(np.ones(self.program.first, bool), operations)[self.reach.order]
        return np.logical_and.reduceat(defined, self.reach.start[:-1])

    @cached_property
    def middles(self) -> Floats:
        """Of constants and readings."""
        return self._leaves.mid

    @cached_property
    def reach(self) -> Reach:
        """What every element of the roots is computed from."""
        start, order = sweeps.reached(self.program)
        entry = np.flatnonzero(order < self.program.first).astype(np.int32)
        row = np.repeat(np.arange(self.count, dtype=np.int32), np.diff(start))[entry]
        return Reach(start, order, entry, row, order[entry])

    def gradients(self, slots: IntervalArray) -> IntervalArray:
        """Derivatives of all roots' elements over slots (M,) along `reach.order`: those at `reach.entry` mean
        something."""
        partials = np.empty((len(self.program.code), 4))  # of every operation
        sweeps.all_partials(self.program, (slots.lo, slots.hi), partials)
        lo, hi = np.zeros((2, len(self.reach.order)))
        sweeps.gradients(self.program, self.reach, partials, (lo, hi))
        return IntervalArray(lo, hi)

    def moved(self, slots: IntervalArray, start: IntervalArray, moves: IntervalArray) -> IntervalArray:
        """`start` (K,) plus the derivatives by all readings times their `moves` (constants and readings)."""
        g, out = self.gradients(slots), start.copied()
        sweeps.add_moves(self.program, self.reach, (g.lo, g.hi), (moves.lo, moves.hi), out)
        return IntervalArray(*out)

    def jacobian(self, slots: IntervalArray) -> IntervalArray:
        """Derivatives of all roots' elements over slots (M,) by the box's components: (K, n)."""
        g, paths = self.gradients(slots), self.reach
        lo, hi = np.zeros((2, self.count, self.size))
        of_box = paths.leaf < self.size
        row, column, entry = paths.row[of_box], paths.leaf[of_box], paths.entry[of_box]
        lo[row, column], hi[row, column] = g.lo[entry], g.hi[entry]
        return IntervalArray(lo, hi)


# ------------------------------------------------------------------------------------------------------------------
# Writing expressions out. This takes as long as some sweeps and depends on no numbers: the legs of a campaign share it.

_Form = tuple[str, Shape, int, bytes, tuple[int, ...]]  # operation, shape, parameter, what it picks, arguments


def _form(node: Expr, number: Mapping[bytes, int]) -> _Form:
    """All that a program takes of a node, its arguments by number."""
    selects = node.op == "mul" and node.parameter == SELECTS
    picked = np.broadcast_to(node.args[1].data.lo == 1.0, node.shape) if selects else node.places
    args = tuple(number[arg.digest] for arg in node.args)
    return "where" if selects else node.op, node.shape, node.parameter, picked.tobytes(), args


@lru_cache(maxsize=32)  # a leg of uncertain readings has some twenty
def _written(nodes: tuple[_Form, ...], roots: Shape, ends: Shape) -> tuple[Program, list[Places]]:
    """The program, and of each node the slots of its elements. `ends`: of variables, constants, readings."""
    writer = _Writer(nodes)
    slots = writer.slots
    flat = np.concatenate([np.zeros(0, np.int32), *(slots[root].ravel() for root in roots)])
    program = Program(*writer.table(), flat, *ends)
    used = sweeps.needed(program)
    if not used.all():  # elements that no root takes: where they are defined restricts nothing
        number = np.concatenate([np.arange(program.first), program.first + np.cumsum(used) - 1]).astype(np.int32)
        code, arg, par = program.code[used], number[program.arg[used]], program.par[used]
        program = program._replace(code=code, arg=arg, par=par, roots=number[flat])
        slots = [number[own] for own in slots]
    return program, slots


class _Writer:
    """Writes nodes out; `slots` holds for each the slots of its elements."""

    def __init__(self, nodes: tuple[_Form, ...]) -> None:
        self.slots, self._next = list[Places](), 0
        self._args = [np.zeros((0, 2), np.int32)]
        self._single = list[tuple[int, int]]()  # arguments of single operations after them
        self._kinds = [(0, 0, 0)]  # code, exponent, how many operations
        for op, shape, parameter, picked, args in nodes:
            self.slots.append(self._written(op, shape, parameter, picked, [self.slots[k] for k in args]))

    def table(self) -> tuple[Places, Places, Places]:
        """Codes, arguments and exponents."""
        self._gather()
        code, exponent, sizes = np.array(self._kinds, np.int32).T
        return np.repeat(code, sizes), np.concatenate(self._args), np.repeat(exponent, sizes)

    def _written(self, op: str, shape: Shape, parameter: int, picked: bytes, args: list[Places]) -> Places:
        if not args:
            start, self._next = self._next, self._next + math.prod(shape)
            return np.arange(start, self._next, dtype=np.int32).reshape(shape)
        if op == "index":
            return np.asarray(args[0].ravel()[np.frombuffer(picked, np.intp)].reshape(shape))
        if op == "sum":
            terms = np.moveaxis(args[0], parameter, 0)
            while len(terms) > 1:  # as a tree: rounding errors grow with its depth
                half = len(terms) // 2
                paired = self._emitted(ADD, [terms[:half], terms[half : 2 * half]])
                terms = np.concatenate([paired, terms[2 * half :]])
            return np.asarray(terms[0])
        if shape:
            args = [arg if arg.shape == shape else np.broadcast_to(arg, shape) for arg in args]
        if op == "where":
            return np.where(np.frombuffer(picked, bool).reshape(shape), *args)
        return self._emitted(CODES[op], args, parameter)

    def _emitted(self, code: int, args: list[Places], parameter: int = 0) -> Places:
        """The slots of one operation on all elements. Many networks have thousands of single ones: no arrays then."""
        shape = args[0].shape
        size, start = math.prod(shape), self._next
        self._next += size
        self._kinds.append((code, parameter, size))
        if size == 1:
            self._single.append((args[0].item(), args[-1].item()))
            return np.full(shape, start, np.int32)
        self._gather()
        block = np.empty((size, 2), np.int32)
        block[:, 0], block[:, 1] = args[0].ravel(), args[-1].ravel()
        self._args.append(block)
        return np.arange(start, start + size, dtype=np.int32).reshape(shape)

    def _gather(self) -> None:
        """Single operations as a block."""
        if self._single:
            self._args.append(np.array(self._single, np.int32))
            self._single = []
