"""What is written of a search: the steps that matter, in a tree whose boxes are named in order."""

import json
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cpcal
from contractors import HC4
from cpcal.checker import check
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.prover import claims
from cpcal.solver.certificate.recording import Recording, UncertifiedError, claims_of
from cpcal.solver.contract import Contraction, Limits
from cpcal.solver.interval import Box
from cpcal.solver.optimize.bound import minimize, run
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
        path = recording.write(tmp_path / "c.jsonl", claims(2.0, point=np.array([1.0, 0.0])))
    steps = [json.loads(line) for line in path.read_text().splitlines()[2 + len(net.constraints) :]]
    assert [(step["split"], step["into"]) for step in steps] == [(0, [1, 2]), (1, [3, 4])]
    assert steps[1]["unknown"] == 0
    assert check(path).claims.point is not None


def test_steps_that_are_too_large_for_the_checker_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search goes on without them, and what is written is accepted by a checker with these limits."""
    for most, least in ((500_000, 2.9), (3, 0.0)):
        monkeypatch.setattr("cpcal.checker.polynomial.MOST_HELD", most)
        net = cpcal.Network()
        x, eps = net.variable("x", domain=(-1, 1)), net.variable("eps", domain=(0, 8))
        net.add([x * x >= 4 - eps])
        found = net.minimize(eps, limits=cpcal.Limits(nodes=1), certificate=tmp_path / "c.jsonl")
        claims = check(tmp_path / "c.jsonl").claims
        assert float(claims.eps_lo) == found.lo
        assert least <= found.lo <= 3.0 * (least > 0)


def test_steps_are_not_kept_in_memory() -> None:
    """Three thousand of them, of 200 bytes and more, take less than a third of that."""
    net = problem()
    with Recording(network_statement(net, "eps"), net.domain) as recording:
        node, serial = Node(net.domain, 0, 0), 1
        tracemalloc.start()
        for k in range(1_200):
            if k == 200:
                tracemalloc.reset_peak()
                before = tracemalloc.get_traced_memory()[0]
            event = split(node, "x", float(node.box.lo[0] + node.box.hi[0]) / 2 if k % 2 else 0.0, serial)
            recording.event(event)
            serial += 2
            for child in event.children:  # both are excluded: the tree stays narrow
                recording.event(Event(child, Decision(EventKind.PRUNED, Contraction(Box.empty(net.names)))))
            node = Node(net.domain, 0, serial)
            serial += 1
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak - before < 200_000


def test_a_certificate_that_cannot_be_written_does_not_lose_the_answer(tmp_path: Path) -> None:
    net = problem()
    (tmp_path / "c.jsonl").mkdir()  # in the way
    with pytest.raises(UncertifiedError, match="regular file") as raised:
        net.minimize(net.variables[1], certificate=tmp_path / "c.jsonl")
    assert raised.value.answer.lo <= 0.0 <= raised.value.answer.hi


def test_a_search_that_found_no_point_yet_does_not_claim_that_there_is_none() -> None:
    net = problem()
    states = minimize(net, "eps", HC4(net), limits=Limits(nodes=1))
    nothing = replace(run(states, None), witness=None, hi=np.inf)
    for lo, infeasible in ((0.25, False), (np.inf, True)):
        claims = claims_of(replace(nothing, lo=lo), net.domain, "eps")
        assert claims["infeasible"] == infeasible
        assert claims["point"] is None
