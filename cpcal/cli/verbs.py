"""What verbs share: exit statuses, how options are declared and refused, where work runs, where results may go, what is
said, and how far the work is.

A verb is a function whose parameters have `argument`s and `option`s as defaults; one whose type is a class of `options`
takes its fields. It returns its exit status, or None for 0. On a terminal progress is a line that changes and leaves
nothing behind; elsewhere a line every ten seconds.
"""

from __future__ import annotations

import math
import os
import shlex
import sys
import time
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, dataclass_transform

import typer
from typer.models import OptionInfo

from cpcal.common.errors import InputError, printable, refuse, unusable
from cpcal.common.files import unwritable
from cpcal.common.numbers import bracket_text, nearest
from cpcal.files.run_folder import FolderKind, answers_into
from cpcal.solver.execution.executors import Place, executor_for
from cpcal.solver.execution.stopping import asked, heard

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from cpcal.solver.optimize.bound import Bracket
    from cpcal.solver.search.search import Event

T = TypeVar("T")


class Status(IntEnum):
    ANSWERED = 0
    UNKNOWN = 1
    UNUSABLE = 2
    INTERNAL = 3
    INTERRUPTED = 130
    TERMINATED = 143


def warn(text: str) -> None:
    """A line on stderr, whatever --quiet says."""
    with suppress(OSError):
        typer.echo(printable(f"cpcal: {text}"), err=True)


# ------------------------------------------------------------------------------------------------------------------
# How options are declared, and those that several verbs have.


def option(default: Any, help: str, *words: str, panel: str | None = None, **more: Any) -> Any:
    """An option: its default (...: required) and what it does. `words`: its names, where it is not called as its
    parameter, and what stands for its value in the help, where that is not its type."""
    names = [word for word in words if word.startswith("-")]
    metavar = next((word for word in words if word not in names), None)
    return typer.Option(default, *names, metavar=metavar, help=help, rich_help_panel=panel, **more)


expert = partial(option, panel="For experts")  # what few need


def output(metavar: str, help: str, default: Any = ..., **more: Any) -> Any:
    """The option --output."""
    return option(default, help, metavar, "--output", "-o", **more)


def argument(metavar: str, help: str, default: Any = ...) -> Any:
    return typer.Argument(default, metavar=metavar, help=help)


@dataclass_transform(frozen_default=True)
def options(group: type[T]) -> type[T]:
    """A frozen dataclass of options, which are kept as `group.declared`; made by hand it has their defaults."""
    declared = {name: value for name, value in vars(group).items() if isinstance(value, OptionInfo)}
    for name, value in declared.items():
        setattr(group, name, value.default)
    group.declared = declared  # type: ignore[attr-defined]
    return dataclass(frozen=True)(group)


TARGET_FILE = option(..., "target.toml, or a board: acircles:7x11:10:8, chessboard:8x5:30 (`image target`).", "TARGET")
FIRST_ROW = option(
    None,
    "Of a target that looks the same turned: top, bottom, left or right, where the images show its first row; or a "
    "poses.csv whose first pose is near.",
    "SIDE",
)
FORCE = option(False, "Write into a folder that is not empty.")


def refuse_options(names: Sequence[str], given: Container[str], because: str, remedy: str = "leave it out") -> None:
    """InputError that names each of these options that is given, if there are any; they are called as parameters."""
    what = f"has no meaning {because}"
    refuse(*((name in given, f"option --{name.replace('_', '-')}", what, remedy) for name in names))


def numbers_of(text: str | None, kind: Callable[[str], T], what: str, option: str) -> tuple[T, ...] | None:
    """Numbers with commas between them. Raises BadParameter."""
    if text is None:
        return None
    try:
        return tuple(kind(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r:.60} is no list of {what}", param_hint=option) from None


# ------------------------------------------------------------------------------------------------------------------
# Where long work runs and when it stops.

_LOADS = ("cpcal.cli.certify", "cpcal.solver.numba_begun")  # of workers


@options
class Where:
    """Where long work runs, and when it stops."""

    workers: int | None = option(None, "Processes of this machine.", "N", min=1, show_default="1")
    resume: bool = option(False, "Go on from where a stopped run of the same work was.")
    scheduler: str | None = expert(None, "Dask scheduler of a cluster, instead of --workers.", "ADDRESS")

    @contextmanager
    def place(self) -> Iterator[Place]:
        """Where the work is done, which can be stopped; it then ends with the command that goes on with it.

        Raises InputError.
        """
        with heard(terminate=True), executor_for(self.workers, self.scheduler, loads=_LOADS) as place:
            try:
                yield place
            finally:
                if asked() is not None:
                    again = ["cpcal", *sys.argv[1:], *([] if self.resume else ["--resume"])]
                    warn(f"go on with: {shlex.join(again)}")


# ------------------------------------------------------------------------------------------------------------------
# Where results go: refused before the work begins, not after it.


def check_writable(folder: Path) -> None:
    """InputError when `folder` is no folder that can be written, or made."""
    ancestor, what = folder.absolute(), ""
    while not os.path.lexists(ancestor):
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        what = f"cannot be a folder: {ancestor} is not one"
    elif not os.access(ancestor, os.W_OK | os.X_OK):
        what = f"cannot be written: no permission in {ancestor}"
    if what:
        raise unusable(str(folder), what, "choose a folder that can be written to")


def check_new(folder: Path, *, force: bool) -> None:
    """InputError when `folder` holds something, unless `force`d."""
    try:
        full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise unwritable(folder, error) from None
    if full and not force:
        remedy = "choose another one, or overwrite what it holds with --force"
        raise unusable(str(folder), "is a folder that is not empty", remedy)


# The folder of a study beside calibration.json, as `cpcal calibrate` and `cpcal demo` leave it.
STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT = "study", "campaign", "validation", "fits", "run", "timeout"


# ------------------------------------------------------------------------------------------------------------------
# What a verb says: answers, and tables.


@options
class Talk:
    """How much is said, and the consoles that follow."""

    quiet: bool = option(False, "Print nothing but errors.", "--quiet", "-q")
    verbose: bool = option(False, "Print every table and sentence.", "--verbose", "-v")

    def console(self, *, stderr: bool = True) -> Console:
        """Prints text as it is, but for hidden characters. Progress goes to stderr; errors are raised."""
        from rich.console import Console  # here: a check begins before it is loaded

        class Terminal(Console):
            """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

            def render_str(self, text: str, **options: Any) -> Text:
                return super().render_str(printable(text), **options)

        console = Terminal(stderr=stderr, quiet=self.quiet, markup=False, emoji=False, highlight=False)
        if not console.is_terminal:
            console.width = 120
        return console

    def say(self, *lines: str | Text, style: str | None = None) -> None:
        """Lines of the answer."""
        if self.quiet:
            return
        out = self.console(stderr=False)
        for line in lines:
            out.print(line, style=style, soft_wrap=True)

    def table(self, head: Sequence[str], rows: Iterable[Sequence[str | Text]], left: Sequence[int] = (0,)) -> None:
        """A table; the columns `left` are text, the others numbers."""
        from rich import box
        from rich.table import Table

        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
        for k, name in enumerate(head):
            table.add_column(name, justify="left" if k in left else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        self.console(stderr=False).print(table)

    def progress(self) -> Callable[[str], None]:
        """A callback for lines of progress, on a terminal."""
        errors = self.console()
        return errors.print if errors.is_terminal else lambda _: None


# ------------------------------------------------------------------------------------------------------------------
# How far the work is.

_LINES, _TERMINAL = 10.0, 0.2  # seconds between two lines, and between two states of one line
_TELLING = 10  # boxes from which on a rate tells something


class Line:
    """Shows how far work is, when that is due: `leg`, `count`, `searched` and `bracketed` are callbacks."""

    def __init__(
        self, show: Callable[[str], object], every: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._show, self._every, self._clock = show, every, clock
        self._began = self._last = clock()
        self._done: int | None = None

    def _tell(self, text: Callable[[float], str]) -> None:
        """A text of the seconds since the beginning."""
        now = self._clock()
        if now - self._last >= self._every:
            self._last = now
            self._show(text(now - self._began))

    def leg(self, leg: int, bracket: Bracket) -> None:
        """The bracket of the leg at work."""
        self.bracketed(bracket, f"leg {leg}: eps ", " mm")

    def bracketed(self, bracket: Bracket, what: str = "", unit: str = "", *, largest: bool = False) -> None:
        """After every step of a minimisation; `largest`: of what is maximised the negative is minimised."""
        lo, hi = (-bracket.hi, -bracket.lo) if largest else (bracket.lo, bracket.hi)

        def text(_: float) -> str:
            where = ""
            if math.isfinite(lo):
                low, high = bracket_text(lo, hi)
                where = f"in [{low}, {high}]{unit}, " if lo <= hi < math.inf else f">= {low}{unit}, "
            rate = bracket.nodes / bracket.seconds if bracket.seconds > 0.0 else 0.0
            done = _boxes(bracket.nodes, bracket.pending, rate)
            return f"{what}{where}{nearest(bracket.seconds, 0)} s, {done}"

        self._tell(text)

    def searched(self, event: Event) -> None:
        """After every box of a search for all solutions."""
        self._done = nodes = (self._done or 0) + 1
        self._tell(lambda seconds: _boxes(nodes, event.pending, nodes / seconds))

    def count(self, what: str, done: int, of: int) -> None:
        """How many are done, and of how many; the first call says what was done before."""
        before = self._done = done if self._done is None else self._done

        def text(seconds: float) -> str:
            rate = (done - before) / seconds
            left = f", {nearest((of - done) / rate, 0)} s left" if rate > 0.0 else ""
            return f"{what}: {done:,} of {of:,}, {nearest(rate, 2)} a second{left}"

        self._tell(text)


def _boxes(nodes: int, pending: int, rate: float) -> str:
    """What is done and what waits; how long that takes if no more comes of it."""
    done = f"{nodes:,} box{'' if nodes == 1 else 'es'}"
    if nodes < _TELLING or not (pending and rate):
        return done
    left = nearest(pending / rate, 0)
    return f"{done}, {nearest(rate, 1)} a second, {pending:,} pending, at least {left} s left"


@contextmanager
def line(console: Console) -> Iterator[Line]:
    """A line on this console while in the block."""
    if not console.is_terminal:
        yield Line(lambda text: console.print(text, soft_wrap=True), _LINES)
        return
    with console.status("working ...") as status:
        yield Line(status.update, _TERMINAL)


@contextmanager
def counted(what: str, console: Console) -> Iterator[Callable[[int, int], None]]:
    """A callback for how many are done, on a line while in the block."""
    with line(console) as shown:
        yield partial(shown.count, what)


# ------------------------------------------------------------------------------------------------------------------
# An answer: found, written, shown.


def answer(
    folder: Path,
    kind: FolderKind,
    find: Callable[[Path], T],
    save: Callable[[T, Path], object],
    page: Callable[[T, Path], Path],
    show: Callable[[T], object],
    talk: Talk,
) -> T:
    """Find an answer, write it and its page into a folder, show it. The functions get a folder aside, for their files.

    A full disk costs the files, not the answer: why it cannot be written is raised once it is shown.
    """
    found = []
    failure, name = None, ""
    try:
        with answers_into(folder, kind) as draft:
            found.append(find(draft))
            save(found[0], draft)
            name = page(found[0], draft).name
    except InputError as error:
        if not found:
            raise
        failure = error
    show(found[0])
    if failure is not None:
        raise failure
    talk.say(f"Report: {folder / name}")
    return found[0]
