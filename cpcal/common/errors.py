"""Errors that a user can act on: what happened, in which input, and what to do about it."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

T = TypeVar("T")


def printable(text: str | os.PathLike[str]) -> str:
    """The text, or a path, on one line: what is not printable becomes an escape.

    So a name can neither forge a line of output nor send commands to a terminal.
    """
    given = os.fspath(text)
    if given.isprintable():
        return given
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in given)


YOUR_DATA = "docs/your-data.md, which lists every key and column."


class CpcalError(Exception):
    """Root of every error that cpcal raises on purpose."""


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with an input, where it is, and the remedy."""

    where: str  # a file name, or what else was given
    what: str
    remedy: str
    line: int | None = None  # 1-based

    def __str__(self) -> str:
        place = self.where if self.line is None else f"{self.where}:{self.line}"
        return printable(f"{place}: {self.what} -> {self.remedy}")


class InputError(CpcalError):
    """Unusable input, with every problem found, in order.

    `see` names the page of the documentation that explains the input.
    """

    about = "in the input"

    def __init__(self, problems: Iterable[Problem], *, omitted: int = 0, see: str = "") -> None:
        self.problems = tuple(problems)
        self.omitted = omitted
        self.see = see
        super().__init__(self.problems, omitted)

    def __reduce__(self) -> tuple[Any, ...]:
        """An exception pickles its positional arguments only."""
        return partial(type(self), omitted=self.omitted, see=self.see), (self.problems,)

    def __str__(self) -> str:
        count = len(self.problems) + self.omitted
        lines = [f"{count} problem{'s' if count != 1 else ''} {self.about}:"]
        lines += [f"  {problem}" for problem in self.problems]
        if self.omitted:
            lines.append(f"  ... and {self.omitted} more of the same kinds")
        if self.see:
            lines.append(f"See {self.see}")
        return "\n".join(lines)


class OutputError(InputError):
    """Output that cannot be written: a full disk, say."""

    about = "with the output"


def unusable(where: str | os.PathLike[str], what: str, remedy: str, line: int | None = None) -> InputError:
    """What to raise for one problem."""
    return InputError([Problem(str(where), what, remedy, line)])


def refuse(*problems: tuple[object, str, str, str]) -> None:
    """InputError of those that are so: whether it is so, where, what is wrong, and the remedy."""
    found = [Problem(where, what, remedy) for wrong, where, what, remedy in problems if wrong]
    if found:
        raise InputError(found)


class ModelError(CpcalError):
    """A constraint network has no meaning (shapes, names, comparisons)."""


class RoundingError(CpcalError):
    """Another library has changed the rounding of the processor in this thread from the default of IEEE 754."""


class PluginError(CpcalError):
    """A contractor is not installed, or breaks its contract."""


class ClashError(PluginError):
    """Two packages register the same name."""


LISTED = 50  # problems that are kept; further ones are counted
_SHOWN = 40  # characters of an input's own text that a message repeats


class Problems:
    """A growing list of problems; only the first `LISTED` are kept."""

    def __init__(self, problems: Iterable[Problem] = ()) -> None:
        self.listed: list[Problem] = []
        self.omitted = 0
        for problem in problems:
            self.add(problem)

    def __len__(self) -> int:
        return len(self.listed) + self.omitted

    def add(self, problem: Problem, *, always: bool = False) -> None:
        """Add a problem; `always` lists it however many there are already."""
        if always or len(self.listed) < LISTED:
            self.listed.append(problem)
        else:
            self.omitted += 1

    def wrong(
        self, where: str | os.PathLike[str], what: str, remedy: str, line: int | None = None, *, always: bool = False
    ) -> None:
        """Add the problem that is made of these."""
        self.add(Problem(str(where), what, remedy, line), always=always)

    def add_unknown(
        self, where: str, what: str, name: str, known: Iterable[str], otherwise: str, line: int | None
    ) -> None:
        """Add an unknown name, with the nearest known one as remedy, or `otherwise`."""
        near = []
        if len(self.listed) < LISTED:  # the search is slow, and a file of rubbish holds many names
            near = difflib.get_close_matches(name[:100], list(known), n=1)
        self.wrong(where, what, f"did you mean {near[0]!r}?" if near else otherwise, line)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """An InputError in the block ends the block alone, and its problems are added."""
        try:
            yield
        except InputError as error:
            for problem in error.problems:
                if problem not in self.listed:
                    self.add(problem)
            self.omitted += error.omitted

    def of(self, load: Callable[[], T]) -> T | None:
        """What a function returns; None, with its problems added, where it raises InputError."""
        with self.kept():
            return load()
        return None

    def raise_any(self, see: str = "") -> None:
        """Raise one InputError with all problems, if there are any; `see`: the page that explains the input."""
        if self.listed:
            raise InputError(self.listed, omitted=self.omitted, see=see)


def together(*loads: Callable[[], Any]) -> list[Any]:
    """What these functions return. Raises one InputError with the problems of all of them."""
    problems = Problems()
    found = [problems.of(load) for load in loads]
    problems.raise_any()
    return found


def shown(text: object) -> str:
    """The repr of `text`, cut to a length that fits into a message."""
    short = text[: _SHOWN + 1] if isinstance(text, str) else text
    result = repr(short)
    return result if len(result) <= _SHOWN + 2 else result[:_SHOWN] + "..."
