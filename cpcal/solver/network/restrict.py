"""A network with some of its measurements: the same constraints, fewer elements of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cpcal.solver.interval import IntervalArray
from cpcal.solver.network.dag import topological
from cpcal.solver.network.expression import Constraint, Expr
from cpcal.solver.network.network import ConstraintNetwork

Rows = npt.NDArray[np.intp]


def restricted(network: ConstraintNetwork, keep: Sequence[Rows]) -> ConstraintNetwork:
    """The network with, of each constraint, only the elements `keep[c]` along its leading axis.

    What is computed per measurement is computed for those alone. Dropping elements loses no solution.
    """
    smaller = network.without_constraints()
    for constraint, rows in zip(network.constraints, keep, strict=True):
        if not constraint.body.shape:
            smaller.add(constraint)
        elif rows.size:
            parts = (constraint.lower, constraint.upper)
            body = select(constraint.body, rows)
            smaller.add(Constraint(body, *(_bound(e, constraint.body, rows) for e in parts)))
    return smaller


def _bound(bound: Expr, body: Expr, rows: Rows) -> Expr:
    along = bound.ndim == body.ndim and bound.shape[0] == body.shape[0]
    return select(bound, rows) if along else bound


def select(root: Expr, rows: Rows) -> Expr:
    """`root[rows]`, with the selection moved down to the leaves as far as it goes."""
    wanted = _wanted(root)
    done: dict[bytes, Expr] = {}
    for node in topological((root,)):
        if node.digest in wanted:
            done[node.digest] = _selected(node, rows, done)
    return done[root.digest]


def _wanted(root: Expr) -> set[bytes]:
    """The nodes whose leading axis is the one that is selected from, found from the root down."""
    wanted = {root.digest}
    for node in reversed(topological((root,))):
        if node.digest in wanted:
            wanted.update(arg.digest for arg in node.args if passes_down(node, arg))
    return wanted


def passes_down(node: Expr, arg: Expr) -> bool:
    """Whether element k of the node is computed from row k of the argument alone."""
    if not arg.shape or not node.shape or arg.shape[0] != node.shape[0]:
        return False
    if node.op == "sum":
        return node.parameter > 0
    if node.op == "index":
        return bool((_index_rows(node) == np.arange(node.shape[0])[:, None]).all())
    return arg.ndim == node.ndim


def _index_rows(node: Expr) -> Rows:
    """For every element of an "index" node the row of its argument that it comes from, shape (N, -1)."""
    assert isinstance(node.data, np.ndarray)
    width = max(int(np.prod(node.args[0].shape[1:])), 1)
    return np.asarray(node.data.reshape((node.shape[0], -1)) // width)


def _selected(node: Expr, rows: Rows, done: dict[bytes, Expr]) -> Expr:
    shape = (len(rows), *node.shape[1:])
    if node.op in ("constant", "reading") and isinstance(node.data, IntervalArray):
        return replace(node, shape=shape, data=node.data[rows])
    if not node.args or (node.op == "sum" and node.parameter == 0):  # of all rows: select from the result
        return node[rows]
    below = tuple(done[arg.digest] if passes_down(node, arg) else arg for arg in node.args)
    if node.op != "index":
        return replace(node, args=below, shape=shape)
    assert isinstance(node.data, np.ndarray)
    chosen = node.data.reshape((node.shape[0], -1))[rows]
    if passes_down(node, node.args[0]):
        width = max(int(np.prod(node.args[0].shape[1:])), 1)
        chosen = np.arange(len(rows))[:, None] * width + chosen % width
    return replace(node, args=below, shape=shape, data=chosen.reshape(shape))
