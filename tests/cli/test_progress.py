"""While a verb works it says now and then how far it is."""

import io
from collections.abc import Iterable

from rich.console import Console

import cpcal
from cpcal.cli.verbs import Line, line
from cpcal.solver.optimize.bound import Bracket
from cpcal.solver.search import Event


def told_at(times: Iterable[float], every: float = 10.0) -> tuple[Line, list[str]]:
    """A line, and what it shows, by a clock that says these times."""
    told: list[str] = []
    clock = iter(times)
    return Line(told.append, every, lambda: float(next(clock))), told


def test_the_bracket_of_the_leg_at_work_is_told_every_ten_seconds() -> None:
    shown, told = told_at([0.0, 4.0, 9.9, 10.0, 12.0, 21.0])
    for k in range(5):
        shown.leg(2, Bracket(0.25, 0.5, k, 12, float(k)))
    assert told == [f"leg 2: eps in [0.2500000, 0.5000000] mm, {k} s, {k} boxes" for k in (2, 4)]


def test_a_terminal_shows_one_line_that_goes() -> None:
    file = io.StringIO()
    with line(Console(file=file, force_terminal=True, width=80)) as shown:
        shown._show("leg 1: eps >= 0.25 mm")
    assert "\x1b[?25h" in file.getvalue()  # the cursor is back
    assert file.getvalue().endswith("\x1b[2K")
    lines = io.StringIO()
    with line(Console(file=lines, width=80)) as shown:
        shown._show("leg 1: eps >= 0.25 mm")
    assert lines.getvalue() == "leg 1: eps >= 0.25 mm\n"


def test_what_is_counted_has_a_pace_that_leaves_out_what_was_done_before() -> None:
    shown, told = told_at([0.0, 1.0, 20.0])
    shown.count("images", 100, 200)
    shown.count("images", 140, 200)
    assert told == ["images: 140 of 200, 2.00 a second, 30 s left"]


def test_a_search_tells_its_rate_and_the_boxes_that_wait() -> None:
    shown, told = told_at(range(100_000), every=50.0)
    net = cpcal.Network()
    x = net.variable("x", 2, (-2, 2))
    net.add((x[0] * x[0] + x[1] * x[1]).within((1.0, 2.0)))
    events: list[Event] = []

    def both(event: Event) -> None:
        events.append(event)
        shown.searched(event)

    net.solve(width=0.3, progress=both)
    assert told
    assert all("boxes, " in text and "a second" in text and "pending" in text for text in told)
    assert events[-1].pending == 0
    assert events[0].pending == len(events[0].children)
