"""What a person watches: a line a leg while certify runs, with its bracket; a bar over images; the state of a search.

Where no terminal is, a line is written now and then.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress_bar import ProgressBar
from rich.text import Text

from cpcal.cli.options import record
from cpcal.common.numbers import bracket_text, nearest
from cpcal.solver.optimize.minimum import Bracket
from cpcal.solver.search import Event

# ------------------------------------------------------------------------------------------------------------------
# What a person watches: a line a leg while certify runs, with its bracket; a bar over images.
#
# Where no terminal is, a line is written now and then.

_CLOSED = 1e-9  # mm, as in Limits.gap_absolute
_WAITING = "waiting"
_TELLING = 10  # boxes from which on a rate tells something
_EVERY = 10.0  # seconds between lines where no terminal is


class _Seconds(ProgressColumn):
    """Seconds since the leg was begun."""

    def render(self, task: Task) -> Text:
        elapsed = task.finished_time if task.finished else task.elapsed
        return Text("" if elapsed is None else f"{nearest(elapsed, 1)} s", justify="right")


class _Spinner(SpinnerColumn):
    """Turns for the leg at work only."""

    def render(self, task: Task) -> RenderableType:
        return super().render(task) if task.started else Text(" ")


class _Bar(BarColumn):
    """Pulses until the first bracket; empty for a leg that waits."""

    def render(self, task: Task) -> ProgressBar:
        bar = super().render(task)
        bar.pulse = task.started and not task.completed
        return bar


class Watch:
    """The `progress` callback of certify, drawing on a rich Progress."""

    def __init__(self, display: Progress, legs: Sequence[int], gap: float) -> None:
        self._display, self._gap = display, gap
        self._tasks: dict[int, TaskID] = {}
        for leg in legs:
            self._tasks[leg] = display.add_task(f"leg {leg}", start=False, total=1.0, state=_WAITING, work="")
        self._begin(next(iter(self._tasks), None))

    def __call__(self, leg: int, bracket: Bracket) -> None:
        """Show the bracket; legs before this one have ended."""
        for earlier in self._until(leg):
            self._display.stop_task(self._tasks[earlier])
        self._begin(leg)
        share = self._share(bracket)
        self._display.update(
            self._tasks[leg],
            completed=share,
            state=_state(bracket),
            work=_work(bracket),
        )
        if share == 1.0:
            self._begin(self._after(leg))

    def _share(self, bracket: Bracket) -> float:
        """How far the bracket has closed, 0 to 1, in digits."""
        width = bracket.hi - bracket.lo
        if math.isnan(width) or width <= max(_CLOSED, self._gap * abs(bracket.hi)):
            return 1.0
        if not math.isfinite(width):
            return 0.0
        goal = max(self._gap, _CLOSED / bracket.hi)
        return min(max(math.log(width / bracket.hi) / math.log(goal), 0.0), 0.99)

    def _until(self, leg: int) -> list[int]:
        legs = list(self._tasks)
        return legs[: legs.index(leg)]

    def _after(self, leg: int) -> int | None:
        legs = list(self._tasks)
        return next(iter(legs[legs.index(leg) + 1 :]), None)

    def _begin(self, leg: int | None) -> None:
        if leg is None or self._display.tasks[self._tasks[leg]].started:
            return
        self._display.start_task(self._tasks[leg])
        self._display.update(self._tasks[leg], state="fitting and bounding ...")


class ProgressLines:
    """The `progress` callback of certify where no terminal is: a line with the bracket every ten seconds."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console, self._clock = console, clock
        self._last = clock()

    def __call__(self, leg: int, bracket: Bracket) -> None:
        now = self._clock()
        if now - self._last >= _EVERY:
            self._last = now
            state = f"leg {leg}: {_state(bracket)}, {nearest(bracket.seconds, 0)} s, {_work(bracket)}"
            self._console.print(state, soft_wrap=True)


def _state(bracket: Bracket) -> str:
    lo, hi = bracket_text(bracket.lo, bracket.hi)
    return f"eps in [{lo}, {hi}] mm" if bracket.lo <= bracket.hi < math.inf else f"eps >= {lo} mm"


def _work(bracket: Bracket) -> str:
    """What is done and what waits; how long that takes if no more comes of it."""
    done = f"{bracket.nodes:,} box{'' if bracket.nodes == 1 else 'es'}"
    if bracket.nodes < _TELLING or not bracket.pending:
        return done
    left = nearest(bracket.pending / bracket.rate, 0)
    return f"{done}, {nearest(bracket.rate, 1)} a second, {bracket.pending:,} pending, at least {left} s left"


@contextmanager
def watch(legs: Sequence[int], gap: float, console: Console) -> Generator[Callable[[int, Bracket], None], None, None]:
    """A progress callback while in the block; on a terminal it leaves nothing behind."""
    if not console.is_terminal:
        yield ProgressLines(console)
        return
    columns = (
        _Spinner(finished_text="✓"),
        TextColumn("{task.description}", markup=False),
        _Bar(bar_width=10),
        TextColumn("{task.fields[state]}", markup=False),
        TextColumn("{task.fields[work]}", markup=False, style="dim"),
        _Seconds(),
    )
    with Progress(*columns, console=console, transient=True, refresh_per_second=8) as display:
        yield Watch(display, legs, gap)


class Counted:
    """A callback for how many are done, and of how many, where no terminal is: a line every ten seconds."""

    def __init__(self, what: str, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._what, self._console, self._clock = what, console, clock
        self._began = self._last = clock()
        self._first: int | None = None  # that were done before

    def __call__(self, done: int, count: int) -> None:
        now = self._clock()
        if self._first is None:
            self._first = done
        if now - self._last < _EVERY:
            return
        self._last = now
        rate = (done - self._first) / (now - self._began)
        left = f", {nearest((count - done) / rate, 0)} s left" if rate > 0.0 else ""
        said = f"{self._what}: {done:,} of {count:,}, {nearest(rate, 2)} a second{left}"
        self._console.print(said, soft_wrap=True)


@contextmanager
def bar(what: str, *, quiet: bool = False) -> Generator[Callable[[int, int], None] | None, None, None]:
    """A callback for how many are done, and of how many: a bar on stderr, or lines where that is no terminal."""
    console = Console(stderr=True)
    if quiet:
        yield None
        return
    if not console.is_terminal:
        yield Counted(what, console)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as display:
        task = display.add_task(what, total=None)
        yield lambda done, count: display.update(task, completed=done, total=count)


# ------------------------------------------------------------------------------------------------------------------
# What a person watches while `cpcal solve` searches: boxes done, their rate, boxes pending, a minimum's bracket.

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
