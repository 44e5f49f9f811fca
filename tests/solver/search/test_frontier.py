"""Nodes that wait on disk come in the same order as from memory, and none is lost."""

from __future__ import annotations

import random

import pytest

from cpcal.solver.interval import Box
from cpcal.solver.search import Node, search
from cpcal.solver.search.search import Frontier


def urgency(node: Node) -> float:
    return float(node.box.lo[0])


def some(count: int, seed: int) -> list[Node]:
    """Of few different priorities, so that age decides often."""
    numbers = random.Random(seed)
    return [Node(Box(["x"], [float(numbers.randrange(40))], [99.0]), 0, k) for k in range(count)]


def first(frontier: Frontier) -> Node:
    """The most urgent node, which leaves."""
    found: list[Node] = []
    frontier.move_first(found)
    return found[0]


def test_the_order_is_that_of_memory_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_CHUNK", 7)
    small, large, numbers = Frontier(urgency, 20), Frontier(urgency), random.Random(1)
    seen = 0
    for node in some(600, 2):
        small.push(node)
        large.push(node)
        seen = max(seen, small.on_disk)
        while numbers.random() < 0.45 and len(large):
            assert small.lowest == large.lowest
            assert first(small) == first(large)
    assert seen > 100
    assert len(small) == len(large)
    assert sorted(node.serial for node in small) == sorted(node.serial for node in large)
    while len(large):
        assert first(small) == first(large)
    assert not len(small)


def test_a_full_disk_keeps_all_in_memory() -> None:
    frontier = Frontier(urgency, 10)
    frontier._disk.execute("PRAGMA max_page_count = 1")
    nodes = some(50, 3)
    for node in nodes:
        frontier.push(node)
    assert len(frontier._heap) > 30
    assert {node.serial for node in frontier} == {node.serial for node in nodes}
