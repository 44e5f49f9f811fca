"""The undecided nodes of a search, the most urgent first. Many of them wait on disk, in the same order as in memory."""

from __future__ import annotations

import heapq
import pickle
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import IO

from cpcal.solver.search.orders import Node, Priority

IN_MEMORY = 100_000  # nodes, at most, if there is room on the disk: some 100 MB
_CHUNK = 4096  # nodes that go to the disk, and come back, together
_SOON = 256  # nodes
_WASTE = 2**26  # bytes of the file that nobody needs any more

Entry = tuple[float, int, Node]  # priority, serial


@dataclass(frozen=True, order=True)
class _Chunk:
    """Nodes on disk, from the most urgent one on, whose priority and serial these are."""

    priority: float
    serial: int
    offset: int
    size: int
    count: int

    @property
    def key(self) -> tuple[float, int]:
        return self.priority, self.serial


class Frontier:
    """A queue of nodes by priority, then age. The file is without a name and goes with the process."""

    def __init__(self, priority: Priority, in_memory: int | None = None) -> None:
        self._priority, self._limit = priority, in_memory or IN_MEMORY
        self._heap: list[Entry] = []
        self._chunks: list[_Chunk] = []  # a heap, too
        self._file: IO[bytes] | None = None

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()

    def __len__(self) -> int:
        return len(self._heap) + self.on_disk

    @property
    def on_disk(self) -> int:
        """How many of the nodes."""
        return sum(chunk.count for chunk in self._chunks)

    @property
    def lowest(self) -> float | None:
        """The priority of the most urgent node; None where there is none."""
        firsts = [self._heap[0][0]] if self._heap else []
        return min([*firsts, *(chunk.priority for chunk in self._chunks[:1])], default=None)

    def __iter__(self) -> Iterator[Node]:
        """All nodes, in no order; those on disk come and go."""
        for chunk in tuple(self._chunks):
            yield from (node for *_, node in self._read(chunk))
        yield from (node for *_, node in tuple(self._heap))

    def soon(self) -> list[Node]:
        """Some of the most urgent nodes in memory, nearly in their order."""
        return [node for *_, node in sorted(self._heap[:_SOON], key=lambda entry: entry[:2])]

    def push(self, node: Node) -> None:
        heapq.heappush(self._heap, (self._priority(node), node.serial, node))
        if len(self._heap) > self._limit:
            self._spill()

    def extend(self, nodes: Iterable[Node]) -> None:
        for node in nodes:
            self.push(node)

    def first(self) -> Node:
        """The most urgent one."""
        while self._chunks and not (self._heap and self._heap[0][:2] < self._chunks[0].key):
            for entry in self._read(self._chunks[0]):
                heapq.heappush(self._heap, entry)
            heapq.heappop(self._chunks)
        return self._heap[0][2]

    def drop(self) -> None:
        """Without what `first` has told."""
        heapq.heappop(self._heap)

    # Ctrl-C may strike between any two lines: what moves is in both places for a moment, never in none.

    def _spill(self) -> None:
        """The less urgent half goes to the disk; where there is no room, all stay."""
        entries = sorted(self._heap, key=lambda entry: entry[:2])
        half = self._limit // 2
        try:
            self._make_room()
            chunks = [self._written(entries[k : k + _CHUNK]) for k in range(half, len(entries), _CHUNK)]
        except OSError:
            self._limit *= 2
            return
        for chunk in chunks:
            heapq.heappush(self._chunks, chunk)
        self._heap = entries[:half]  # sorted, so that it is a heap

    def _written(self, entries: list[Entry]) -> _Chunk:
        content = pickle.dumps(entries, pickle.HIGHEST_PROTOCOL)
        assert self._file is not None
        offset = self._file.seek(0, 2)
        self._file.write(content)
        self._file.flush()
        return _Chunk(*entries[0][:2], offset, len(content), len(entries))

    def _make_room(self) -> None:
        """A file; a new one that holds what is still waiting, where much of it is not."""
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="cpcal-")  # noqa: SIM115 - it goes with this object
        used = sum(chunk.size for chunk in self._chunks)
        if self._file.seek(0, 2) - used <= max(_WASTE, used):
            return
        fresh, moved = tempfile.TemporaryFile(prefix="cpcal-"), []  # noqa: SIM115
        for chunk in self._chunks:
            moved.append(replace(chunk, offset=fresh.tell()))
            fresh.write(self._bytes(chunk))
        fresh.flush()
        before, self._file, self._chunks = self._file, fresh, moved
        before.close()

    def _read(self, chunk: _Chunk) -> list[Entry]:
        entries: list[Entry] = pickle.loads(self._bytes(chunk))
        return entries

    def _bytes(self, chunk: _Chunk) -> bytes:
        assert self._file is not None
        self._file.seek(chunk.offset)
        return self._file.read(chunk.size)
