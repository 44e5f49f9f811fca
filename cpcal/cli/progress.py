"""What a person watches while a verb works: on a terminal a line that changes and leaves nothing behind.

Where no terminal is, a line is written every ten seconds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from cpcal.cli.options import record
from cpcal.common.numbers import bracket_text, nearest
from cpcal.solver.optimize.minimum import Bracket
from cpcal.solver.search import Event

_LINES, _TERMINAL = 10.0, 0.2  # seconds between two lines, and between two states of one line
_TELLING = 10  # boxes from which on a rate tells something


class Line:
    """Shows a text when it is due."""

    def __init__(
        self, show: Callable[[str], object], every: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.show, self._every, self._clock = show, every, clock
        self._began = self._last = clock()

    def due(self) -> float | None:
        """Seconds since the beginning, where it is time for a text."""
        now = self._clock()
        if now - self._last < self._every:
            return None
        self._last = now
        return now - self._began


@contextmanager
def line(console: Console) -> Iterator[Line]:
    """A line on this console while in the block."""
    if not console.is_terminal:
        yield Line(lambda text: console.print(text, soft_wrap=True), _LINES)
        return
    with console.status("working ...") as status:
        yield Line(status.update, _TERMINAL)


def _work(nodes: int, pending: int, rate: float) -> str:
    """What is done and what waits; how long that takes if no more comes of it."""
    done = f"{nodes:,} box{'' if nodes == 1 else 'es'}"
    if nodes < _TELLING or not (pending and rate):
        return done
    left = nearest(pending / rate, 0)
    return f"{done}, {nearest(rate, 1)} a second, {pending:,} pending, at least {left} s left"


class Legs:
    """The `progress` callback of certify: the bracket of the leg at work. Every one is recorded."""

    def __init__(self, line: Line) -> None:
        self._line = line

    def __call__(self, leg: int, bracket: Bracket) -> None:
        done = {"nodes": bracket.nodes, "pending": bracket.pending, "rate": bracket.rate, "seconds": bracket.seconds}
        record("bracket", leg=leg, eps_lo=bracket.lo, eps_hi=bracket.hi, **done)
        if self._line.due() is not None:
            lo, hi = bracket_text(bracket.lo, bracket.hi)
            state = f"eps in [{lo}, {hi}] mm" if bracket.lo <= bracket.hi < math.inf else f"eps >= {lo} mm"
            work = _work(bracket.nodes, bracket.pending, bracket.rate)
            self._line.show(f"leg {leg}: {state}, {nearest(bracket.seconds, 0)} s, {work}")


class Counted:
    """A callback for how many are done, and of how many."""

    def __init__(self, what: str, line: Line) -> None:
        self._what, self._line = what, line
        self._first: int | None = None  # that were done before

    def __call__(self, done: int, count: int) -> None:
        if self._first is None:
            self._first = done
        if (seconds := self._line.due()) is not None:
            rate = (done - self._first) / seconds
            left = f", {nearest((count - done) / rate, 0)} s left" if rate > 0.0 else ""
            self._line.show(f"{self._what}: {done:,} of {count:,}, {nearest(rate, 2)} a second{left}")


@contextmanager
def counted(what: str, console: Console) -> Iterator[Counted]:
    """The same, on a line while in the block."""
    with line(console) as shown:
        yield Counted(what, shown)


class SearchProgress:
    """Callbacks for a search and for a minimisation; the record is told too."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._nodes = self._before = 0

    def event(self, event: Event) -> None:
        """After every box of a search for all solutions."""
        self._nodes += 1
        self._tell(event.pending, -math.inf, math.inf)

    def bracket(self, bracket: Bracket, *, largest: bool = False) -> None:
        """After every step of a minimisation; `largest`: of what is maximised the negative is minimised."""
        if not self._nodes:
            self._before = bracket.nodes  # of an earlier call
        self._nodes = bracket.nodes
        lo, hi = (-bracket.hi, -bracket.lo) if largest else (bracket.lo, bracket.hi)
        self._tell(bracket.pending, lo, hi)

    def _tell(self, pending: int, lo: float, hi: float) -> None:
        seconds = self._line.due()
        if seconds is None:
            return
        nodes = self._nodes - self._before
        rate = nodes / seconds
        record("searched", nodes=nodes, pending=pending, rate=rate, seconds=seconds, lo=lo, hi=hi)
        known = math.isfinite(lo) and math.isfinite(hi)
        between = f"in [{', '.join(bracket_text(lo, hi))}]: " if known else ""
        self._line.show(f"{between}{_work(nodes, pending, rate)}")
