"""The search: one event per node, nothing forgotten, stoppable anywhere."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import HC4, Newton
from cpcal import Limits, Network
from cpcal.solver.contract import Contraction, Then
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.search import ORDERS, Divide, EventKind, LargestFirst, Search, bisect
from cpcal.solver.search.passes import Smear


def two_roots() -> Network:
    net = Network()
    x, y = net.variable("x", (), (-10, 10)), net.variable("y", (), (-10, 10))
    net.add([x**2 + y**2 == 25, x - y == 1])
    return net


BOUND = st.sampled_from([-np.inf, -1e300, -1.0, 0.0, 5e-324, 1.0, 1.0 + 2**-52, 1e300, np.inf])


def ring() -> ConstraintNetwork:
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (-4, 4)), net.variable("y", (), (-3, 5))
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
    rest = [event.contraction.box for event in search if event.kind is EventKind.KEPT]
    assert covered(rest)


# strategies -------------------------------------------------------------------------------------------------


# Network.solve ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [{}, {"priority": ORDERS["breadth"]}])
def test_the_size_of_batches_changes_nothing(order: dict[str, Any]) -> None:
    """Events, kept boxes and what is pending at a stop are the same one node at a time and 64 at a time."""
    net = Network()
    x = net.variable("x", 2, (-3.0, 3.1))
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
    stops = [two_roots().solve(width=1e-9, contractors=("hc4", "lifted"), limits=Limits(nodes=n)) for n in (4, 8, 9)]
    assert [paving.status.split(" undivided")[0] for paving in stops[:2]] == [
        "Stopped with 3 boxes",
        "Stopped with 1 box",
    ]
    assert [paving.complete for paving in stops] == [False, False, True]
    assert "proved" in stops[2].status
