"""Which elements of an expression depend on which components of its readings: by structure, not by derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from cpcal.common.arrays import Indices
from cpcal.solver.network.expression import Expr
from cpcal.solver.network.sweep import Tape


@dataclass(frozen=True)
class Owners:
    """For every reading (by its slot) the flat element of the root that each component enters, -1 for none.

    `exclusive` is False when some component enters two elements: then one value of it must serve both.
    """

    element: dict[int, Indices]
    exclusive: bool


def owners(tape: Tape, root: Expr) -> Owners:
    """Where the readings of a tape enter `root`, one of its nodes."""
    if not tape.readings:
        return Owners({}, True)
    sizes = [_size(tape.nodes[k]) for k in tape.readings]
    ends = np.cumsum(sizes)
    first = {k: int(end) - size for k, end, size in zip(tape.readings, ends, sizes, strict=True)}
    matrix = _dependence(tape, first, int(ends[-1]))[tape.slot(root)].tocoo()
    element = np.full(ends[-1], -1, dtype=np.intp)
    element[matrix.col] = matrix.row
    exclusive = matrix.nnz == int(np.count_nonzero(element >= 0))
    return Owners({k: element[first[k] : first[k] + n] for k, n in zip(tape.readings, sizes, strict=True)}, exclusive)


def _size(node: Expr) -> int:
    return int(np.prod(node.shape))


def _dependence(tape: Tape, first: dict[int, int], count: int) -> list[sparse.csr_array]:
    """For every slot, which of its elements (rows) depend on which components of readings (columns)."""
    out: list[sparse.csr_array] = []
    for k, node in enumerate(tape.nodes):
        size = _size(node)
        total = sparse.csr_array((size, count))
        if k in first:
            where = np.arange(size)
            total = sparse.csr_array((np.ones(size), (where, first[k] + where)), shape=(size, count))
        for arg in node.args:
            source = out[tape.slot(arg)]
            if source.nnz:
                rows, sources = _reaches(node, arg)
                gather = sparse.csr_array((np.ones(len(rows)), (rows, sources)), shape=(size, source.shape[0]))
                total = total + gather @ source
        out.append(total)
    return out


def _reaches(node: Expr, arg: Expr) -> tuple[Indices, Indices]:
    """Pairs (element of the node, element of its argument that it is computed from)."""
    positions = np.arange(_size(arg)).reshape(arg.shape)
    if node.op == "index":
        assert isinstance(node.data, np.ndarray)
        return np.arange(node.data.size), node.data.ravel()
    if node.op == "sum":
        target = np.expand_dims(np.arange(_size(node)).reshape(node.shape), node.parameter)
        return np.broadcast_to(target, arg.shape).ravel(), positions.ravel()
    return np.arange(_size(node)), np.broadcast_to(positions, node.shape).ravel()
