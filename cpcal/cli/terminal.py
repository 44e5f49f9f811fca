"""What a verb says: answers, tables, and how far the work is.

On a terminal progress is a line that changes and leaves nothing behind; elsewhere a line every ten seconds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.text import Text

from cpcal.cli.options import option, options
from cpcal.common.errors import InputError, printable
from cpcal.common.numbers import bracket_text, nearest
from cpcal.files.run_folder import FolderKind, answers_into

if TYPE_CHECKING:
    from cpcal.robot import Campaign
    from cpcal.solver.optimize.bound import Bracket
    from cpcal.solver.search import Event

T = TypeVar("T")


class _Terminal(Console):
    """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


@options
class Talk:
    """How much is said, and the consoles that follow."""

    quiet: bool = option(False, "Print nothing but errors.", "--quiet", "-q")
    verbose: bool = option(False, "Print every table and sentence.", "--verbose", "-v")

    @property
    def out(self) -> Console:
        """Where answers go."""
        return self.console(stderr=False)

    def console(self, *, stderr: bool = True) -> Console:
        """Prints text as it is, but for hidden characters. Progress goes to stderr; errors are raised."""
        console = _Terminal(stderr=stderr, quiet=self.quiet, markup=False, emoji=False, highlight=False)
        if not console.is_terminal:
            console.width = 120
        return console

    def say(self, *lines: str | Text, style: str | None = None) -> None:
        """Lines of the answer."""
        for line in lines:
            self.out.print(line, style=style, soft_wrap=True)

    def table(
        self, head: Sequence[str], rows: Iterable[Sequence[str | Text]], left: Sequence[int] = (0,), title: str = ""
    ) -> None:
        """A table; the columns `left` are text, the others numbers."""
        from rich import box
        from rich.table import Table

        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
        for k, name in enumerate(head):
            table.add_column(name, justify="left" if k in left else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        if title:
            self.say(title, style="bold")
        self.out.print(table)

    def progress(self) -> Callable[[str], None]:
        """A callback for lines of progress, on a terminal."""
        errors = self.console()
        return errors.print if errors.is_terminal else lambda _: None


# ------------------------------------------------------------------------------------------------------------------
# How far the work is.

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


def leg_progress(line: Line) -> Callable[[int, Bracket], None]:
    """The `progress` callback of certify: the bracket of the leg at work."""

    def tell(leg: int, bracket: Bracket) -> None:
        if line.due() is not None:
            lo, hi = bracket_text(bracket.lo, bracket.hi)
            state = f"eps in [{lo}, {hi}] mm" if bracket.lo <= bracket.hi < math.inf else f"eps >= {lo} mm"
            work = _work(bracket.nodes, bracket.pending, bracket.rate)
            line.show(f"leg {leg}: {state}, {nearest(bracket.seconds, 0)} s, {work}")

    return tell


def count_progress(what: str, line: Line) -> Callable[[int, int], None]:
    """A callback for how many are done, and of how many."""
    before: int | None = None

    def tell(done: int, count: int) -> None:
        nonlocal before
        before = done if before is None else before
        if (seconds := line.due()) is not None:
            rate = (done - before) / seconds
            left = f", {nearest((count - done) / rate, 0)} s left" if rate > 0.0 else ""
            line.show(f"{what}: {done:,} of {count:,}, {nearest(rate, 2)} a second{left}")

    return tell


@contextmanager
def counted(what: str, console: Console) -> Iterator[Callable[[int, int], None]]:
    """The same, on a line while in the block."""
    with line(console) as shown:
        yield count_progress(what, shown)


class SearchProgress:
    """Callbacks for a search and for a minimisation."""

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
        known = math.isfinite(lo) and math.isfinite(hi)
        between = f"in [{', '.join(bracket_text(lo, hi))}]: " if known else ""
        self._line.show(f"{between}{_work(nodes, pending, rate)}")


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
    campaign: Campaign | None = None,
) -> T:
    """Find an answer, write it and its page into a folder, show it. The functions get a folder aside, for their files.

    A full disk costs the files, not the answer: why it cannot be written is raised once it is shown.
    """
    found: list[T] = []
    failure, name = None, ""
    try:
        with answers_into(folder, kind, campaign) as draft:
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
