"""What is written of a search: the steps that matter, in a tree whose boxes are named in order."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import cpcal
from cpcal.checker import check
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.recording import Recording, claims_at
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box
from cpcal.solver.search import Decision, Event, EventKind, Node


def problem() -> cpcal.Network:
    net = cpcal.Network()
    x, eps = net.variable("x", domain=(-4, 4)), net.variable("eps", domain=(0, 8))
    net.add([x * x <= 1 + eps])
    return net


def split(node: Node, name: str, at: float, serial: int) -> Event:
    parts = node.box.replace(name, hi=at), node.box.replace(name, lo=at)
    children = tuple(Node(box, node.depth + 1, serial + k) for k, box in enumerate(parts))
    return Event(node, Decision(EventKind.SPLIT, Contraction(node.box)), children)


def test_steps_on_boxes_above_the_claim_are_left_out(tmp_path: Path) -> None:
    net = problem()
    with Recording(network_statement(net, "eps"), net.domain) as recording:
        first = split(Node(net.domain, 0, 0), "eps", 4.0, 1)
        low, high = first.children
        second = split(high, "x", 0.0, 3)  # of no use once the objective need not reach 4
        third = split(low, "x", 0.5, 5)
        for event in (first, second, third):
            recording.event(event)
        path = recording.write(tmp_path / "c.jsonl", claims_at(2.0, refuted=False, point=np.array([1.0, 0.0])))
    steps = [json.loads(line) for line in path.read_text().splitlines()[2 + len(net.constraints) :]]
    assert [(step["split"], step["into"]) for step in steps] == [(0, [1, 2]), (1, [3, 4])]
    assert steps[1]["unknown"] == 0
    assert check(path).claims.point is not None


def test_many_steps_take_little_memory(tmp_path: Path) -> None:
    import tracemalloc

    net = problem()
    with Recording(network_statement(net, "eps"), net.domain) as recording:
        node, serial = Node(net.domain, 0, 0), 1
        tracemalloc.start()
        for k in range(20_000):
            event = split(node, "x", float(node.box.lo[0] + node.box.hi[0]) / 2 if k % 2 else 0.0, serial)
            recording.event(event)
            serial += 2
            for child in event.children:  # both are excluded: the tree stays narrow
                recording.event(Event(child, Decision(EventKind.PRUNED, Contraction(Box.empty(net.names)))))
            recording._names[serial] = 0
            node = Node(net.domain, 0, serial)
            serial += 1
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 4 << 20
