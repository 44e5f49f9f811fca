"""While `cpcal solve` works it says now and then how far it is."""

from __future__ import annotations

import cpcal
from cpcal.cli.progress import SearchProgress
from cpcal.solver.optimize.minimum import Bracket
from cpcal.solver.search import Event


def test_a_search_tells_its_rate_and_the_boxes_that_wait() -> None:
    told: list[str] = []
    times = iter(range(100_000))
    progress = SearchProgress(told.append, every=50.0, clock=lambda: float(next(times)))
    net = cpcal.Network()
    x = net.variable("x", 2, (-2, 2))
    net.add((x[0] * x[0] + x[1] * x[1]).within((1.0, 2.0)))
    events: list[Event] = []

    def both(event: Event) -> None:
        events.append(event)
        progress.event(event)

    net.solve(width=0.3, progress=both)
    assert told
    assert all("boxes, " in text and "a second" in text and "pending" in text for text in told)
    assert events[-1].pending == 0
    assert events[0].pending == len(events[0].children)


def test_a_minimum_tells_its_bracket_and_what_this_call_has_done() -> None:
    told: list[str] = []
    times = iter([0.0, 1.0, 11.0, 11.0])
    progress = SearchProgress(told.append, every=10.0, clock=lambda: next(times))
    progress.bracket(Bracket(-2.0, -1.0, nodes=100, programs=0, seconds=1.0, pending=7), largest=True)
    progress.bracket(Bracket(-2.0, -1.0, nodes=150, programs=0, seconds=2.0, pending=7), largest=True)
    (text,) = told
    assert text.startswith("in [1.000000, 2.000000]: 50 boxes, ")
