"""Where long work runs and when it stops: options that long-running verbs share."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import shlex
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

import typer
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

from cpcal.cli.talk import Status, record
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.numbers import bracket_text, nearest
from cpcal.execution.executors import Place, Reason, Stopped, asked, executor_for, heard, within_memory
from cpcal.solver.optimize import Bracket
from cpcal.solver.search import Event

_LOADS = ("cpcal.cli.certify", "cpcal.solver.numba_begun")  # of workers
_PANEL = "Where it runs"
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kKMGT]?)i?B?")
_UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


@dataclass(frozen=True)
class Where:
    """Options of the command line; a dataclass of a verb's options inherits them."""

    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Processes of this machine.", show_default="1", rich_help_panel=_PANEL),
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler of a cluster, instead.", rich_help_panel=_PANEL),
    ] = None
    memory_limit: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Stop, with what is proved, beyond SIZE (such as 2G) of memory in this process.",
            rich_help_panel=_PANEL,
        ),
    ] = None

    @contextmanager
    def place(self) -> Iterator[Place]:
        """Where the work is done, which can be stopped. Raises InputError, BadParameter."""
        with self.stoppable(), executor_for(self.workers, self.scheduler, loads=_LOADS) as place:
            yield place

    @contextmanager
    def stoppable(self) -> Iterator[None]:
        """Until the end of the block a signal, or the limit of memory, asks the work to stop. Raises BadParameter."""
        limit = None if self.memory_limit is None else _bytes(self.memory_limit)
        with heard(terminate=True), within_memory(limit):
            yield


@dataclass(frozen=True)
class Running(Where):
    """The same, of a verb that keeps checkpoints."""

    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on from where a stopped run of the same work was.", rich_help_panel=_PANEL),
    ] = False

    @contextmanager
    def place(self) -> Iterator[Place]:
        """The same; a run that is stopped ends with the command that goes on with it."""
        with super().place() as place:
            try:
                yield place
            finally:
                if asked() is not None:
                    command = ["cpcal", *sys.argv[1:], *([] if self.resume else ["--resume"])]
                    typer.echo(printable(f"cpcal: go on with: {shlex.join(command)}"), err=True)


def _bytes(text: str) -> int:
    """Raises BadParameter."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        message = f"{text!r:.60} is no size of memory: give one such as 500M or 2G"
        raise typer.BadParameter(message, param_hint="--memory-limit")
    return int(float(found[1]) * _UNITS[found[2].upper()])


# ------------------------------------------------------------------------------------------------------------------
# How errors leave the program: one message on stderr and an exit status; never a traceback.
#
# CPCAL_TRACEBACK=1 in the environment shows the traceback of an internal error, for a report.

# typer's own way out; its ClickException has no public name: UsageError's base, which is BadParameter's
_TYPER: tuple[type[BaseException], ...] = (typer.Exit, typer.Abort, typer.BadParameter.__mro__[2])


@contextlib.contextmanager
def leaving() -> Iterator[None]:
    """Turns what was raised inside into a message and an exit status (`cpcal.cli`), warnings into a line each."""
    shown, warnings.showwarning = warnings.showwarning, _warn
    try:
        yield
        sys.stdout.flush()
    except _TYPER:
        raise
    except CpcalError as error:
        _leave(Status.UNUSABLE, "\n".join(map(printable, str(error).split("\n"))))
    except KeyboardInterrupt as stop:
        reason = stop.reason if isinstance(stop, Stopped) else Reason.INTERRUPTED
        _leave(Status(reason), reason.sentence)
    except MemoryError as error:
        _leave(Status.UNUSABLE, printable(f"too little memory: {error or 'nothing is left'}"))
    except OSError as error:
        if error.errno == errno.EPIPE:
            raise  # nobody reads on: click leaves without a word
        _give_up_stdout()
        name = "" if error.filename is None else f"{error.filename}: "
        _leave(Status.UNUSABLE, printable(f"{name}{error.strerror or error}"))
    except Exception as error:
        if os.environ.get("CPCAL_TRACEBACK"):
            traceback.print_exc()
        _leave(Status.INTERNAL, internal(error))
    finally:
        warnings.showwarning = shown


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    with contextlib.suppress(OSError):
        typer.echo(printable(f"cpcal: warning: {message}"), err=True)


def internal(error: Exception) -> str:
    """The sentence on an internal error: what, where, and a request for a report."""
    frames = traceback.extract_tb(error.__traceback__)
    place = next((f for f in reversed(frames) if "cpcal" in f.filename or "contractors" in f.filename), None)
    at = "" if place is None else f" at {os.path.basename(place.filename)}:{place.lineno}"
    what = f"{type(error).__name__}{at}: {error}"[:300]
    return printable(f"internal error, please report it with the command and its files ({what})")


def refuse_empty(arguments: Sequence[str]) -> None:
    """InputError for an empty argument: `-o ""` would mean the folder one stands in."""
    problems = []
    for k, text in enumerate(arguments):
        if not text.strip() or (text.startswith("--") and text.endswith("=")):
            name = text.rstrip("=") or (f"after {arguments[k - 1]}" if k else "first")
            problems.append(Problem(f"argument {name}", "is empty", "name a file, a folder or a value"))
    if problems:
        raise InputError(problems)


def _leave(status: Status, message: str) -> None:
    with contextlib.suppress(OSError):
        typer.echo(f"cpcal: {message}", err=True)
    raise typer.Exit(status) from None


def _give_up_stdout() -> None:
    """What is left in the buffer of a full disk must not fail again at the end."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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
