"""Sweeps over the DAG: values (forward), narrowing (backward), tangents (forward mode derivatives).

Equal expressions are one slot, and every slot holds an array of shape (B, *S): B boxes at once.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.dag import topological
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.network import ConstraintNetwork
from cpcal.solver.network.operations import TABLE, align

Slots = list[IntervalArray]

_LARGE = 2000  # elements, from which on halving beats a reduction by numpy


class Tape:
    """The nodes under some roots in evaluation order, and where each variable sits in a flat box."""

    def __init__(self, network: ConstraintNetwork, roots: Iterable[Expr]) -> None:
        ends = tuple(roots)
        self.nodes = topological(ends)  # before the roots: pickle follows it without deep recursion
        self.roots = ends
        self._slot = {node.digest: k for k, node in enumerate(self.nodes)}
        self._args = [tuple(self._slot[arg.digest] for arg in node.args) for node in self.nodes]
        self.size = len(network.names)
        self._position: dict[int, slice] = {}
        start = 0
        for leaf in network.variables:
            width = int(np.prod(leaf.shape))
            if leaf.digest in self._slot:
                self._position[self._slot[leaf.digest]] = slice(start, start + width)
            start += width

    def slot(self, expr: Expr) -> int:
        return self._slot[expr.digest]

    def arguments(self, k: int) -> tuple[int, ...]:
        """Slots of the arguments of the node in slot k."""
        return self._args[k]

    @property
    def variables(self) -> dict[int, slice]:
        """Slots of the variables, and where each stands in a flat box."""
        return self._position

    @property
    def readings(self) -> list[int]:
        """Slots of the readings, in order."""
        return [k for k, node in enumerate(self.nodes) if node.op == "reading"]

    def forward(
        self, engine: Arithmetic, boxes: IntervalArray, readings: dict[int, IntervalArray] | None = None
    ) -> Slots:
        """Values of every node over `boxes` of shape (B, n); `readings` may replace sets by other values."""
        slots: Slots = []
        for k, node in enumerate(self.nodes):
            if k in self._position:
                slots.append(boxes[:, self._position[k]].reshape((boxes.shape[0], *node.shape)))
            elif node.args:
                values = tuple(slots[j] for j in self._args[k])
                slots.append(TABLE[node.op].forward(engine, node, values))
            else:
                slots.append(self._leaf(k, readings))
        return slots

    def defined(self, slots: Slots) -> bool:
        """Whether every root and quotient is defined, hence continuous, for all points that `slots` enclose."""
        for node in self.nodes:
            if node.op == "sqrt" and not bool(np.all(slots[self.slot(node.args[0])].lo >= 0.0)):
                return False
            if node.op == "div" or (node.op == "power" and node.parameter < 0):
                divisor = slots[self.slot(node.args[-1])]
                if not bool(np.all((divisor.lo > 0.0) | (divisor.hi < 0.0))):
                    return False
        return True

    def _leaf(self, k: int, readings: dict[int, IntervalArray] | None) -> IntervalArray:
        data = self.nodes[k].data
        assert isinstance(data, IntervalArray)
        if readings and k in readings:
            data = readings[k]
        return data[None]

    def backward(self, engine: Arithmetic, slots: Slots, boxes: IntervalArray) -> IntervalArray:
        """Narrow every slot by the operations that use it, last to first; the narrowed boxes.

        Changes `slots` in place. A box without solutions comes back with NaN in some component.
        """
        lo, hi = boxes.lo.copy(), boxes.hi.copy()
        dead = np.zeros(boxes.shape[0], dtype=bool)
        for k in reversed(range(len(self.nodes))):
            node, value = self.nodes[k], slots[k]
            if value.shape[0] == boxes.shape[0]:
                dead |= value.empty.reshape(value.shape[0], -1).any(axis=1)
            elif value.empty.any():
                dead[:] = True
            if k in self._position:
                flat = value.reshape((boxes.shape[0], -1))
                lo[:, self._position[k]], hi[:, self._position[k]] = flat.lo, flat.hi
            elif node.args:
                values = tuple(slots[j] for j in self._args[k])
                for j, narrowed in zip(
                    self._args[k], TABLE[node.op].backward(engine, node, value, values), strict=True
                ):
                    if narrowed is not slots[j]:
                        slots[j] = slots[j].intersect(_reduced(narrowed, slots[j]))
        lo[dead], hi[dead] = np.nan, np.nan
        return IntervalArray(lo, hi)

    def tangents(self, engine: Arithmetic, slots: Slots, seeds: dict[int, IntervalArray]) -> list[IntervalArray | None]:
        """Directional derivatives of every node for D directions at once; None where they vanish.

        `slots` are values with B = 1; `seeds` gives for some leaves an array of shape (D, *S).
        """
        out: list[IntervalArray | None] = []
        for k, node in enumerate(self.nodes):
            if not node.args:
                out.append(seeds.get(k))
                continue
            args = self._args[k]
            moving = [j for j, arg in enumerate(args) if out[arg] is not None]
            operation = TABLE[node.op]
            if not moving:
                out.append(None)
            elif operation.derivative is None:
                only = out[args[0]]
                assert only is not None
                out.append(operation.forward(engine, node, (only,)))
            else:
                values = tuple(slots[j] for j in args)
                partials = operation.derivative(engine, node, slots[k], values)
                out.append(_chain(engine, node, partials, [out[j] for j in args]))
        return out

    def variable_seeds(self) -> dict[int, IntervalArray]:
        """Unit directions of all n components of the box: seeds of shape (n, *S)."""
        seeds = {}
        for k, where in self._position.items():
            unit = np.eye(self.size)[:, where]
            seeds[k] = IntervalArray.point(unit.reshape((self.size, *self.nodes[k].shape)))
        return seeds


def _chain(
    engine: Arithmetic, node: Expr, partials: tuple[IntervalArray, ...], tangents: list[IntervalArray | None]
) -> IntervalArray | None:
    total: IntervalArray | None = None
    for partial, tangent in zip(partials, tangents, strict=True):
        if tangent is None:
            continue
        term = engine.mul(partial, align(tangent, node.ndim))
        total = term if total is None else engine.add(total, term)
    if total is None or total.shape[1:] == node.shape:
        return total
    return total.broadcast_to((total.shape[0], *node.shape))


def _reduced(narrowed: IntervalArray, target: IntervalArray) -> IntervalArray:
    """Intersect over the axes along which the target was broadcast."""
    if narrowed.shape[1:] == target.shape[1:]:
        return narrowed
    lo, hi = narrowed.lo, narrowed.hi
    extra = lo.ndim - target.ndim
    if extra:
        shape = (lo.shape[0], -1, *lo.shape[1 + extra :])
        lo, hi = _highest(lo.reshape(shape)), _lowest(hi.reshape(shape))
    axes = tuple(a for a in range(1, target.ndim) if target.shape[a] == 1 and lo.shape[a] > 1)
    if axes:
        lo, hi = lo.max(axis=axes, keepdims=True), hi.min(axis=axes, keepdims=True)
    return IntervalArray(lo, hi)


def _highest(a: Floats) -> Floats:
    """The maximum along axis 1, NaN if there is one. numpy is slow where short axes follow: halve instead."""
    if a.ndim == 2 or a.size < _LARGE:
        return np.asarray(a.max(axis=1))
    while a.shape[1] > 1:
        half = a.shape[1] // 2
        folded = np.maximum(a[:, :half], a[:, half : 2 * half])
        if a.shape[1] % 2:
            np.maximum(folded[:, :1], a[:, -1:], out=folded[:, :1])
        a = folded
    return a[:, 0]


def _lowest(a: Floats) -> Floats:
    return -_highest(-a)
