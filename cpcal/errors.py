"""Errors that a user can act on: what happened, in which input, and what to do about it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass


def printable(text: str | os.PathLike[str]) -> str:
    """The text, or a path, on one line: what is not printable becomes an escape, so that a name can forge no line and
    command no terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in os.fspath(text))


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
    """Unusable input. Carries every problem found, in order, so that a user mends them in one go."""

    def __init__(self, problems: Iterable[Problem], *, omitted: int = 0) -> None:
        self.problems = tuple(problems)
        self.omitted = omitted
        super().__init__(self.problems, omitted)

    def __str__(self) -> str:
        count = len(self.problems) + self.omitted
        lines = [f"{count} problem{'s' if count != 1 else ''} in the input:"]
        lines += [f"  {problem}" for problem in self.problems]
        if self.omitted:
            lines.append(f"  ... and {self.omitted} more of the same kinds")
        return "\n".join(lines)


class ModelError(CpcalError):
    """A constraint network was put together in a way that has no meaning (shapes, names, comparisons)."""


class PluginError(CpcalError):
    """A contractor was asked for that is not installed, or that breaks its contract."""
