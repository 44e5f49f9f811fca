"""The rounds of a search, decided by the workers of an executor. Decisions and their order are the same as here."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Protocol

from cpcal.execution.shared import Shared
from cpcal.solver.search.orders import Node
from cpcal.solver.search.search import Decision


class Rounds(Protocol):
    """A process that decides rounds, each node by itself."""

    def __call__(self, node: Node) -> Decision: ...

    def all(self, nodes: Sequence[Node]) -> list[Decision]: ...


class Spread:
    """A process whose rounds are divided among as many tasks as the executor takes at a time."""

    def __init__(self, process: Rounds, place: tuple[Executor, int]) -> None:
        self._process, self._shared, self._place = process, Shared(process), place

    def __call__(self, node: Node) -> Decision:
        return self._process(node)

    def all(self, nodes: Sequence[Node]) -> list[Decision]:
        size = -(-len(nodes) // self._place[1])
        parts = [nodes[k : k + size] for k in range(0, len(nodes), size)]
        return [one for part in self._shared.mapped(self._place, _decided, parts) for one in part]


def _decided(process: Rounds, nodes: Sequence[Node]) -> list[Decision]:
    return process.all(nodes)
