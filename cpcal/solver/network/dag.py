"""Walks over the DAG of expressions, without recursion: a sum of thousands of terms is thousands of levels deep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cpcal.solver.network.expression import Expr


def topological(roots: Iterable[Expr]) -> list[Expr]:
    """All distinct nodes under `roots`, arguments first; equal expressions are one node."""
    order: dict[bytes, Expr] = {}
    stack: list[tuple[Expr, bool]] = [(root, False) for root in reversed(list(roots))]
    while stack:
        node, expanded = stack.pop()
        if node.digest in order:
            continue
        if expanded:
            order[node.digest] = node
        else:
            stack.append((node, True))
            stack.extend((arg, False) for arg in reversed(node.args))
    return list(order.values())


def leaves(roots: Iterable[Expr]) -> Iterator[Expr]:
    """The variables, constants and readings under `roots`, each once."""
    return (node for node in topological(roots) if not node.args)
