"""What a person watches while `cpcal solve` searches: boxes done, their rate, boxes pending, a minimum's bracket."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from cpcal.cli.talk import record
from cpcal.common.numbers import bracket_text, nearest
from cpcal.solver.optimize.minimum import Bracket
from cpcal.solver.search import Event

_LINES, _TERMINAL = 10.0, 0.2  # seconds between two lines, and between two states of one line


class SearchProgress:
    """Callbacks for a search and for a minimisation; `show` is told a line now and then, and so is the log."""

    def __init__(
        self, show: Callable[[str], object], every: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._show, self._every, self._clock = show, every, clock
        self._began = self._last = clock()
        self._nodes = self._before = 0

    def event(self, event: Event) -> None:
        """After every box of a search for all solutions."""
        self._nodes += 1
        if self._due():
            self._tell(self._nodes, event.pending)

    def bracket(self, bracket: Bracket, *, largest: bool = False) -> None:
        """After every step of a minimisation; `largest`: of what is maximised the negative is minimised."""
        if not self._nodes:
            self._before = bracket.nodes  # of an earlier call
        self._nodes = bracket.nodes
        if self._due():
            lo, hi = (-bracket.hi, -bracket.lo) if largest else (bracket.lo, bracket.hi)
            self._tell(bracket.nodes - self._before, bracket.pending, lo, hi)

    def _due(self) -> bool:
        if self._clock() - self._last < self._every:
            return False
        self._last = self._clock()
        return True

    def _tell(self, nodes: int, pending: int, lo: float = -math.inf, hi: float = math.inf) -> None:
        seconds = self._last - self._began
        rate = nodes / seconds
        record("searched", nodes=nodes, pending=pending, rate=rate, seconds=seconds, lo=lo, hi=hi)
        left = f", at least {nearest(pending / rate, 0)} s left" if rate > 0.0 else ""
        said = f"{nodes:,} boxes, {nearest(rate, 1)} a second, {pending:,} pending{left}"
        self._show(f"{_between(lo, hi)}{said}")


def _between(lo: float, hi: float) -> str:
    """The bracket in front of a sentence, where there is one."""
    if math.isfinite(lo) and math.isfinite(hi):
        least, most = bracket_text(lo, hi)
        return f"in [{least}, {most}]: "
    return ""


@contextmanager
def search_progress(console: Console) -> Iterator[SearchProgress]:
    """On a terminal a line that changes and leaves nothing behind; elsewhere a line every ten seconds."""
    if not console.is_terminal:
        yield SearchProgress(lambda text: console.print(text, soft_wrap=True), _LINES)
        return
    with console.status("searching ...") as status:
        yield SearchProgress(status.update, _TERMINAL)
