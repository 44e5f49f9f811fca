"""Reverse mode: one sweep from an array-valued expression to its leaves gives all its partial derivatives.

A root of shape (N, *rest) has N rows of D = prod(rest) elements each (a scalar: N = D = 1). A node is *row-wise*
when row k of the root sees nothing of it but its row k: then the adjoints of all rows fit into one array of
shape (D, *S), whose entry [d, k, ...] is the derivative of element (k, d) of the root. Every other node, a
variable above all, has one adjoint per element of the root: shape (D N, *S).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.operations import TABLE, Values, scatter
from cpcal.solver.network.restrict import passes_down
from cpcal.solver.network.sweep import Tape

# The partial derivatives (or slopes) of the node in a slot with respect to its arguments.
Partials = Callable[[int], Values]


class Reverse:
    """The adjoints of some leaves of a tape with respect to one of its roots."""

    def __init__(self, tape: Tape, root: Expr, leaves: Iterable[int]) -> None:
        self._tape, self._root = tape, root
        self.rows = root.shape[0] if root.shape else 1
        self.lanes = int(np.prod(root.shape[1:]))
        self._leaves = list(leaves)
        self._moves = self._moving()
        self.row_wise = self._classified()

    def _moving(self) -> list[bool]:
        """Which slots depend on the leaves."""
        moves: list[bool] = []
        for k in range(len(self._tape.nodes)):
            moves.append(k in self._leaves or any(moves[j] for j in self._tape.arguments(k)))
        return moves

    def _classified(self) -> dict[int, bool]:
        """The slots between root and leaves, and whether each is row-wise for all its uses."""
        start = self._tape.slot(self._root)
        out = {start: bool(self._root.shape)} if self._moves[start] else {}
        self._stays: dict[tuple[int, int], bool] = {}
        for k in range(start, -1, -1):
            if k in out:
                for j in self._moving_arguments(k):
                    self._stays[k, j] = passes_down(self._tape.nodes[k], self._tape.nodes[j])
                    out[j] = out.get(j, True) and out[k] and self._stays[k, j]
        return out

    def _moving_arguments(self, k: int) -> list[int]:
        return [j for j in self._tape.arguments(k) if self._moves[j]]

    def sweep(self, engine: Arithmetic, partials: Partials) -> dict[int, IntervalArray]:
        """For each leaf that the root depends on the derivatives of every element, (D, N, *S).

        A row-wise leaf of shape (N, *rest) gives (D, N, *rest): those with respect to the row's own part.
        """
        adjoints = self._seed()
        for k in sorted(self.row_wise, reverse=True):
            if self._tape.nodes[k].args:
                g = adjoints.pop(k)
                for j, gain in self._gains(engine, k, g, partials):
                    adjoints[j] = engine.add(adjoints[j], gain) if j in adjoints else gain
        return {k: self._unfolded(k, g) for k, g in adjoints.items()}

    def _seed(self) -> dict[int, IntervalArray]:
        start, rest = self._tape.slot(self._root), self._root.shape[1:]
        if start not in self.row_wise:
            return {}
        if not self._root.shape:
            return {start: IntervalArray.point(np.ones(1))}
        unit = np.eye(self.lanes).reshape((self.lanes, 1, *rest))
        return {start: IntervalArray.point(np.broadcast_to(unit, (self.lanes, self.rows, *rest)))}

    def _unfolded(self, k: int, g: IntervalArray) -> IntervalArray:
        shape = self._tape.nodes[k].shape
        return g if self.row_wise[k] else g.reshape((self.lanes, self.rows, *shape))

    def _gains(self, e: Arithmetic, k: int, g: IntervalArray, partials: Partials) -> list[tuple[int, IntervalArray]]:
        """What the adjoint g of slot k adds to those of its arguments."""
        node, args = self._tape.nodes[k], self._tape.arguments(k)
        if self.row_wise[k] and node.op in ("index", "sum") and not self._stays[k, args[0]]:
            if node.op == "index":
                return [(args[0], self._index_of_all(e, node, g))]
            g = self.embedded(g)  # a sum over rows: every row of the node is a sum of its own
        adjoint = TABLE[node.op].adjoint
        moving = [p for p, j in enumerate(args) if self._moves[j]]
        if adjoint is None:
            factors = partials(k)
            shares = {p: e.mul(g, factors[p]) for p in moving}
        else:
            shares = dict(enumerate(adjoint(e, node, g)))
        return [(args[p], self._arrived(e, k, args[p], shares[p])) for p in moving]

    def _arrived(self, e: Arithmetic, k: int, j: int, share: IntervalArray) -> IntervalArray:
        """A share, in the shape of the node in slot k, as part of the adjoint of its argument in slot j."""
        node, shape = self._tape.nodes[k], self._tape.nodes[j].shape
        if self._stays[k, j]:
            share = _summed(e, share, shape)
            return self.embedded(share) if self.row_wise[k] and not self.row_wise[j] else share
        if not self.row_wise[k] or node.op == "sum":
            return _summed(e, share, shape)
        # the argument is repeated for every row
        folded = share.reshape((self.lanes * self.rows, *share.shape[2:]))
        inner = shape[1:] if len(shape) == node.ndim else shape
        return _summed(e, folded, inner).reshape((folded.shape[0], *shape))

    def _index_of_all(self, e: Arithmetic, node: Expr, g: IntervalArray) -> IntervalArray:
        """Rows picked from anywhere: row k of the node adds to the k-th copy of the argument's adjoint."""
        assert isinstance(node.data, np.ndarray)
        shape = node.args[0].shape
        size = int(np.prod(shape))
        copies = node.data.reshape((self.rows, -1)) + size * np.arange(self.rows)[:, None]
        total = scatter(e, g.reshape((self.lanes, -1)), copies.ravel(), size * self.rows)
        return total.reshape((self.lanes * self.rows, *shape))

    def embedded(self, g: IntervalArray) -> IntervalArray:
        """Row-wise adjoints (D, N, *rest) written out for all elements, (D N, N, *rest): zero off the diagonal."""
        k = np.arange(self.rows)
        out = [np.zeros((self.lanes, self.rows, *g.shape[1:])) for _ in range(2)]
        out[0][:, k, k], out[1][:, k, k] = g.lo, g.hi
        return IntervalArray(*out).reshape((self.lanes * self.rows, *g.shape[1:]))


def _summed(e: Arithmetic, x: IntervalArray, shape: tuple[int, ...]) -> IntervalArray:
    """Sums of an array (B, *T) over the axes along which `shape` was broadcast to T; of shape (B, *shape)."""
    for _ in range(x.ndim - 1 - len(shape)):
        x = e.sum(x, 1)
    for axis, size in enumerate(shape, 1):
        if size == 1 and x.shape[axis] != 1:
            x = e.sum(x, axis).reshape((*x.shape[:axis], 1, *x.shape[axis + 1 :]))
    return x
