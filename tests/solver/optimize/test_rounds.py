"""Rounds of a search, decided by others: the same answer, certificate and order as here, whoever does the work."""

from concurrent.futures import ThreadPoolExecutor

import pytest

import cpcal
from contractors.hc4 import HC4
from cpcal.solver.search import Divide, EventKind, LargestFirst, Node, Search
from cpcal.solver.search.spread import DecideTask, grown


@pytest.fixture(scope="module")
def problem():
    """A minimum among many, so that more than sixteen boxes wait."""
    net = cpcal.Network()
    x, t = net.variable("x", shape=5, domain=(-2, 2)), net.variable("t", domain=(-50, 50))
    twisted = sum((x[k] * x[k + 1] - 0.3 * k) * (x[k] * x[k + 1] - 0.3 * k) + 0.1 * x[k] for k in range(4))
    net.add(twisted + x[4] * x[0] <= t)
    return net, t


@pytest.fixture(scope="module")
def paved():
    net = cpcal.Network()
    y = net.variable("y", shape=2, domain=(-2, 2))
    net.add((y[0] * y[0] + y[1] * y[1]).within((1, 2)))
    net.add((y[0] * y[1]).within((0.1, 0.5)))
    return net


def minimised(problem, path, **place):
    net, t = problem
    seen, limits = [], cpcal.Limits(nodes=40)
    found = net.minimize(
        t,
        limits=limits,
        certificate=path,
        progress=lambda b: seen.append((b.lo, b.hi, b.nodes)),
        **place,
    )
    return (found.lo, found.hi, found.nodes, found.programs, found.pending), seen, path.read_bytes()


@pytest.mark.parametrize("workers", [1, 2])
def test_a_minimum_is_the_same_with_workers(problem, tmp_path, workers):
    here = minimised(problem, tmp_path / "here")
    assert any(later[2] - earlier[2] > 1 for earlier, later in zip(here[1], here[1][1:], strict=False))  # rounds
    assert minimised(problem, tmp_path / "there", workers=workers) == here


def test_a_minimum_is_the_same_with_threads(problem, tmp_path):
    with ThreadPoolExecutor(3) as threads:
        assert minimised(problem, tmp_path / "there", executor=threads) == minimised(problem, tmp_path / "here")


def test_a_paving_is_the_same_with_workers(paved):
    def solved(**place):
        found = paved.solve(width=0.2, inner=True, **place)
        return found.nodes, found.inside, found.outside, [(s.verdict, s.box, s.cluster) for s in found.solutions]

    here = solved()
    assert solved(workers=2) == here
    with ThreadPoolExecutor(3) as threads:
        assert solved(executor=threads) == here


@pytest.mark.parametrize("span", [0.0, 10.0])
def test_how_far_a_worker_looks_ahead_changes_no_decision(paved, span):
    process = Divide(HC4(paved), LargestFirst(0.3), outside=True)
    search = Search([paved.domain], process, abreast=64)
    for _ in search:
        if search.waiting > 8 and not search.within_round:
            break
    forest = grown(process, DecideTask(list(search.pending), span))
    roots = [forest.decision(k) for k in range(search.waiting)]
    assert [ahead(one) for one in roots] == [0 if span == 0.0 else below(process, node) for node in search.pending]
    for node, one in zip(search.pending, roots, strict=True):
        same(process, node, one)


def made_ahead(decision):
    made = [piece.decided.decision for piece in decision.pieces if piece.decided is not None]
    return [one for one in made if one is not None]


def ahead(decision):
    return sum(1 + ahead(one) for one in made_ahead(decision))


def below(process, node):
    """How many nodes come of one."""
    decision = process(node)
    if decision.kind is not EventKind.SPLIT:
        return 0
    return sum(1 + below(process, Node(piece.box, node.depth + 1, -1, piece.state)) for piece in decision.pieces)


def same(process, node, decision):
    """That a decision, and all that it carries, is what is decided here."""
    here = process(node)
    assert (here.kind, here.box, here.uses, here.removed) == (
        decision.kind,
        decision.box,
        decision.uses,
        decision.removed,
    )
    assert [piece.box for piece in here.pieces] == [piece.box for piece in decision.pieces]
    for piece in decision.pieces:
        if piece.decided is not None and piece.decided.decision is not None:
            same(process, Node(piece.box, node.depth + 1, -1, piece.state), piece.decided.decision)


def test_one_leg_uses_all_workers_and_its_certificate_is_the_same(tmp_path):
    campaign = cpcal.simulate(seed=1, joint_error=40.0, factor=0.0, extremal=False, random_poses=10)

    def certified(name, **place):
        found = cpcal.certify(campaign, legs=[6], delta=200.0, support="none", certificates=tmp_path / name, **place)
        return found.legs[0].work.nodes, (tmp_path / name / "leg6.cert.jsonl").read_bytes()

    with Counting(2) as threads:
        assert certified("there", executor=threads) == certified("here")
        assert threads.count > 2


class Counting(ThreadPoolExecutor):
    """Counts its tasks."""

    count = 0

    def submit(self, *given, **named):
        self.count += 1
        return super().submit(*given, **named)
