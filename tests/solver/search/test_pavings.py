"""The search forgets nothing; what `Network.solve` says of its boxes: proved, inside, outside, clusters, volumes."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import HC4, Newton
from cpcal import Interval, Limits, Verdict, norm, sqr
from cpcal.solver.contract import Contraction, Then
from cpcal.solver.existence.unique import UniquenessProver
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.search.passes import STRATEGIES, Divide, LargestFirst, Smear, bisect
from cpcal.solver.search.paving import Paving
from cpcal.solver.search.search import ORDERS, EventKind, Search, clusters, difference, volume
from tests.networks import network


def proved(paving: Paving) -> list[Box]:
    return [s.box for s in paving.solutions if s.verdict is Verdict.PROVED]


# single solutions -------------------------------------------------------------------------------------------


def test_all_solutions_of_a_square_system_are_proved() -> None:
    """Two ellipses."""
    net, x, y = network(x=(-4, 4), y=(-4, 4))
    net.add([sqr(x) + 4 * sqr(y) == 4, 4 * sqr(x) + sqr(y) == 4])
    paving = net.solve(width=1e-3, contractors=("hc4",))
    assert paving.complete
    assert len(paving.solutions) == len(proved(paving)) == len(paving.clusters)
    assert "exactly one solution each, and there are no others: proved" in paving.status
    assert all(box.width.max() < 1e-12 for box in proved(paving))
    root = np.sqrt(0.8)
    for p, q in itertools.product((-root, root), repeat=2):
        assert sum(abs(box.mid - (p, q)).max() < 1e-12 for box in proved(paving)) == 1


@pytest.mark.parametrize("seed", [0, 6, 7, 11, 36])  # in most draws no box only touches a region of uniqueness
def test_close_zeros_of_polynomials_are_all_in_the_boxes(seed: int) -> None:
    """Some of them closer than boxes are wide: a box that touches the region of one may hold the next. Exact zeros."""
    rng = np.random.default_rng(seed)
    first = rng.integers(-8, 8, 3) / 8.0
    zeros = np.unique(np.concatenate([first, first + 2.0 ** -rng.integers(5, 16, 3)]))
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    body = x - float(zeros[0])
    for zero in zeros[1:].tolist():
        body = body * (x - zero)
    net.add([body == 0, y - x * 0.5 == 0])
    for width in (1e-2, 1e-3, 1e-4):
        paving = net.solve(width=width, contractors=("hc4",))
        assert paving.complete
        for zero in zeros:
            assert any((zero, 0.5 * zero) in s.box for s in paving.solutions), (width, zero)
        for box in proved(paving):
            assert sum((zero, 0.5 * zero) in box for zero in zeros) == 1, (width, box)


def test_a_solution_on_the_faces_of_boxes_is_one_solution() -> None:
    net, x, y = network(x=(-1, 1), y=(-1, 1))
    net.add([x * 1.5 + y * y * y == 0, y * 1.5 - x * x * x == 0])
    for strategy in STRATEGIES:
        paving = net.solve(width=0.01, contractors=("hc4",), strategy=strategy)
        assert len(paving.solutions) == 1
        assert (0.0, 0.0) in proved(paving)[0]
        assert paving.status.startswith("1 box holds exactly one solution, and there are no others")


def test_inside_outside_and_single_solutions_cover_the_domain() -> None:
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    net.add([sqr(x) + sqr(y) == 2, sqr(x - 1) * (x + 1) == y - x])
    paving = net.solve(width=0.05, contractors=("hc4",), inner=True)
    assert proved(paving)
    everything = (*paving.outside, *(s.box for s in paving.solutions))
    points = np.random.default_rng(2).uniform(-2, 2, (2000, 2))
    assert within(points, everything).all()
    assert volume(everything).lo <= 16.0 <= volume(everything).hi + 1e-9
    for box in proved(paving):
        assert not within(box.mid[None], paving.outside).any()


def test_a_double_solution_stays_unknown_next_to_a_proved_one() -> None:
    net, x, y = network(x=(-2, 2), y=(-2, 2))
    net.add([sqr(x - 1) * (x + 1) == 0, y == x])
    paving = net.solve(width=1e-4, contractors=("hc4",))
    assert [box.mid.tolist() for box in proved(paving)] == [pytest.approx([-1, -1])]
    assert len(paving.clusters) == 2
    assert any((1.0, 1.0) in box for box in paving.boundary)
    assert "more may hold others" in paving.status


def test_a_limit_or_ctrl_c_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    net, x, y = network(x=(-4, 4), y=(-4, 4))
    net.add([sqr(x) + sqr(y) == 5, x * y == 2])
    points = [(1, 2), (2, 1), (-1, -2), (-2, -1)]

    def covers(paving: Paving) -> bool:
        return all(any(point in s.box for s in paving.solutions) for point in points)

    for nodes in range(1, 20, 4):
        paving = net.solve(contractors=("hc4",), limits=Limits(nodes=nodes), inner=True)
        assert covers(paving)
    assert covers(net.solve(contractors=("hc4",)))

    def stop(event: object) -> None:
        raise KeyboardInterrupt

    stopped = net.solve(contractors=("hc4",), progress=stop)
    assert covers(stopped)
    assert not stopped.complete
    real, calls = UniquenessProver.prove, itertools.count()

    def interrupted(self: UniquenessProver, box: Box) -> Any:
        if next(calls) == 2:
            raise KeyboardInterrupt
        return real(self, box)

    monkeypatch.setattr(UniquenessProver, "prove", interrupted)
    paving = net.solve(contractors=("hc4",))
    assert covers(paving)
    assert 0 < len(proved(paving)) < 4


def within(points: np.ndarray[Any, Any], boxes: tuple[Box, ...]) -> np.ndarray[Any, Any]:
    """Which points lie in some of the boxes."""
    lo, hi = np.stack([box.lo for box in boxes]), np.stack([box.hi for box in boxes])
    return np.asarray(((points[:, None] >= lo) & (points[:, None] <= hi)).all(axis=2).any(axis=1))


# options ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("order", ORDERS)
def test_every_strategy_and_order_gives_a_correct_paving(strategy: str, order: str) -> None:
    net, x, y = network(x=(-3, 3), y=(-3, 3))
    net.add((sqr(x) + sqr(y)).within((1, 4)))
    paving = net.solve(width=0.6, contractors=("hc4",), strategy=strategy, order=order, inner=True)
    assert paving.complete
    assert net.solve(width=0.6, contractors=("hc4",), strategy=strategy, order=order, inner=True) == paving
    assert Interval(3 * np.pi).subset(paving.volume)
    points = np.random.default_rng(1).uniform(-3, 3, (2000, 2))
    square = (points**2).sum(axis=1)
    member = (square >= 1) & (square <= 4)
    inside, outside, boundary = (within(points, boxes) for boxes in (paving.inside, paving.outside, paving.boundary))
    assert not (inside & ~member).any()
    assert not (outside & member).any()
    assert (inside | outside | boundary).all()
    assert inside.any()


# regions ----------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_difference_clusters_and_volume(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    names = [f"x{k}" for k in range(n)]

    def random_box(within: Box | None = None) -> Box:
        lo, hi = np.sort(rng.integers(0, 9, (2, n)), axis=0).astype(float)
        made = Box(names, lo, hi)
        return made if within is None else made.intersect(within)

    box = random_box()
    part = random_box(box)
    pieces = difference(box, part)
    assert len(pieces) <= 2 * n
    exact = float(np.prod(box.hi - box.lo))
    assert exact in volume([box])
    assert exact in volume([*pieces, part])
    for point in rng.uniform(box.lo, box.hi, (20, n)):
        held = sum(point in piece for piece in pieces)
        on_face = bool(((point == part.lo) | (point == part.hi)).any())
        assert (held == 0) == (point in part) or (point in part and held > 0 and on_face)
    boxes = [random_box() for _ in range(int(rng.integers(0, 9)))]
    labels = clusters(boxes)
    for i, j in itertools.combinations(range(len(boxes)), 2):
        if not boxes[i].intersect(boxes[j]).is_empty:
            assert labels[i] == labels[j]
    assert sorted(set(labels.tolist())) == list(range(len(set(labels.tolist()))))
    for label in set(labels.tolist()):  # connected: no proper part of a cluster touches none of the rest
        members = [boxes[k] for k in np.flatnonzero(labels == label)]
        reached = [members.pop(0)]
        while members:
            near = [b for b in members if any(not b.intersect(r).is_empty for r in reached)]
            assert near
            reached += near
            members = [b for b in members if b not in near]


def test_readings_have_inner_boxes_only_where_that_is_proved() -> None:
    net, p = network(2, p=(-2, 2))
    net.add(norm(p) == net.reading(1.0, 0.25))
    paving = net.solve(width=0.2, contractors=("hc4",), inner=True)
    assert paving.inside
    for box in paving.inside:
        corners = np.array(list(itertools.product(*zip(box.lo, box.hi, strict=True))))
        assert (np.abs(np.linalg.norm(corners, axis=1) - 1) <= 0.25 + 1e-12).all()
    assert Interval(np.pi * (1.25**2 - 0.75**2)).subset(paving.volume)
    assert "nothing but solutions" in paving.status


def test_an_inequality_through_the_solution_leaves_it_unknown() -> None:
    net, x = network(x=(0, 4))
    net.add([sqr(x) == 2, x * x * x * x <= 4])
    paving = net.solve(contractors=("hc4",))
    assert proved(paving) == []
    assert len(paving.clusters) == 1
    assert "not proved" in paving.status


@pytest.mark.parametrize("contractors", [("hc4",), ("hc4", "newton"), ("cid",), ("hc4", "lifted")])
def test_whatever_contracts_the_solutions_are_the_same(contractors: tuple[str, ...]) -> None:
    net, x = network(3, x=(-4, 4))
    net.add([x[0] * x[1] + sqr(x[2]) == 2, x[1] * x[2] - sqr(x[0]) == -1, x[0] * x[2] + sqr(x[1]) * x[0] == 1])
    paving = net.solve(width=1e-3, contractors=contractors)
    assert paving.status == "4 boxes hold exactly one solution each, and there are no others: proved."
    for box in proved(paving):
        a, b, c = box.mid
        assert np.abs([a * b + c**2 - 2, b * c - a**2 + 1, a * c + b**2 * a - 1]).max() < 1e-12
    assert len(paving.clusters) == 4


BOUND = st.sampled_from([-np.inf, -1e300, -1.0, 0.0, 5e-324, 1.0, 1.0 + 2**-52, 1e300, np.inf])


def ring() -> ConstraintNetwork:
    net, x, y = network(x=(-4, 4), y=(-3, 5))
    net.add((x**2 + y**2).within((4.0, 4.1)))
    return net


POINTS = [(2 * np.cos(a) * 1.01, 2 * np.sin(a) * 1.01) for a in np.linspace(0, 6.28, 40)]


def covered(boxes: list[Box]) -> bool:
    return all(any(point in box for box in boxes) for point in POINTS)


@pytest.mark.parametrize("strategy", ["largest", "smear"])
@pytest.mark.parametrize("order", ["depth", "breadth"])
def test_kept_boxes_hold_all_solutions_and_every_node_is_one_event(strategy: str, order: str) -> None:
    net = ring()
    how = LargestFirst(0.2) if strategy == "largest" else Smear(net, 0.2)
    priority = {} if order == "depth" else {"priority": ORDERS["breadth"]}
    search = Search([net.domain], Divide(HC4(net), how), **priority)  # type: ignore[arg-type]
    events = list(search)
    serials = [event.node.serial for event in events]
    assert sorted(serials) == list(range(len(events)))
    assert search.pending == ()
    kinds = [event.kind for event in events]
    assert len(events) == 1 + 2 * kinds.count(EventKind.SPLIT)
    kept = [event.contraction.box for event in events if event.kind is EventKind.KEPT]
    assert covered(kept)
    assert all(box.width.max() <= 0.2 for box in kept)
    for event in events:
        assert event.contraction.box.subset(event.node.box)
        assert (event.kind is EventKind.PRUNED) == event.contraction.box.is_empty
    if order == "breadth":
        depths = [event.node.depth for event in events]
        assert depths == sorted(depths)
    with pytest.raises(StopIteration):
        next(search)


@pytest.mark.parametrize("stop", [0, 1, 5, 37])
def test_what_was_kept_and_what_is_pending_cover_the_domain_at_any_stop(stop: int) -> None:
    net = ring()
    search = Search([net.domain], Divide(HC4(net), LargestFirst(0.1)))
    events = [next(search) for _ in range(stop)]
    kept = [event.contraction.box for event in events if event.kind is EventKind.KEPT]
    assert covered(kept + [node.box for node in search.pending])
    again = Search([node.box for node in search.pending], Divide(HC4(net), LargestFirst(0.1)))
    kept += [event.contraction.box for event in again if event.kind is EventKind.KEPT]
    assert covered(kept)


@pytest.mark.parametrize("where", ["contractor", "strategy"])
def test_an_interrupted_node_stays_pending(where: str) -> None:
    net = ring()

    class Interrupting(LargestFirst):
        calls = 0

        def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
            if where == "contractor":
                self._count()
            return Contraction(box)

        def split(self, box: Box) -> tuple[Box, ...]:
            if where == "strategy":
                self._count()
            return super().split(box)

        def _count(self) -> None:
            self.calls += 1
            if self.calls == 4:
                raise KeyboardInterrupt

    spoilt = Interrupting(1.0)
    search = Search([net.domain], Divide(spoilt, spoilt))
    for _ in range(3):
        next(search)
    before = search.pending
    with pytest.raises(KeyboardInterrupt):
        next(search)
    assert search.pending == before
    assert covered([node.box for node in search.pending])
    assert covered([event.contraction.box for event in search if event.kind is EventKind.KEPT])


@pytest.mark.parametrize("order", [{}, {"priority": ORDERS["breadth"]}])
def test_the_size_of_batches_changes_nothing(order: dict[str, Any]) -> None:
    """Events, kept boxes and what is pending at a stop are the same one node at a time and 64 at a time."""
    net, x = network(2, x=(-3.0, 3.1))
    net.add([x[0] ** 2 + x[1] ** 2 == 4, x[1] == x[0] ** 2 - 1])
    told = []
    for batch in (1, 5, 64):
        process = Divide(Then(HC4(net), Newton(net)), LargestFirst(1e-3))
        search = Search([net.domain], process, **order, abreast=64, batch=batch)
        first = [(event.node.box, event.kind, event.contraction.box) for event in itertools.islice(search, 9)]
        pending = sorted(repr(node.box) for node in search.pending)
        rest = [(event.node.box, event.kind, event.contraction.box) for event in search]
        told.append((first, pending, rest, [piece.box for piece in search.kept]))
    assert told[0] == told[1] == told[2]
    assert len(told[0][3]) == 2


@settings(max_examples=60, deadline=None)
@given(pairs=st.lists(st.tuples(BOUND, BOUND).filter(lambda p: p[0] != p[1]), min_size=1, max_size=4))
def test_pieces_cover_the_box_and_are_smaller(pairs: list[tuple[float, float]]) -> None:
    lo, hi = np.array([min(p) for p in pairs]), np.array([max(p) for p in pairs])
    box = Box([f"x{k}" for k in range(len(pairs))], lo, hi)
    for component in range(len(pairs)):
        pieces = bisect(box, component)
        if not pieces:
            assert np.nextafter(lo[component], np.inf) == hi[component]
            continue
        left, right = pieces
        assert left.hull(right) == box
        assert left.hi[component] == right.lo[component]
        assert left != box
        assert right != box
    pieces = LargestFirst().split(box)
    assert not pieces or pieces[0].hull(pieces[1]) == box


def test_no_sentence_says_proved_while_a_box_is_undivided() -> None:
    net, x, y = network(x=(-10, 10), y=(-10, 10))
    net.add([x**2 + y**2 == 25, x - y == 1])
    stops = [net.solve(width=1e-9, contractors=("hc4", "lifted"), limits=Limits(nodes=n)) for n in (4, 8, 9)]
    said = [paving.status.split(" undivided")[0] for paving in stops[:2]]
    assert said == ["Stopped with 3 boxes", "Stopped with 1 box"]
    assert [paving.complete for paving in stops] == [False, False, True]
    assert "proved" in stops[2].status
