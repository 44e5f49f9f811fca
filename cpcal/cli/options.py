"""What verbs share: exit statuses, how options are declared and refused, where work runs, where results may go.

A verb is a function whose parameters have `argument`s and `option`s as defaults; one whose type is a class of `options`
takes its fields. It returns its exit status, or None for 0.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, dataclass_transform

import typer
from typer.models import OptionInfo

from cpcal.common.errors import InputError, Problem, printable, unusable
from cpcal.common.files import unwritable
from cpcal.solver.execution.executors import Place, executor_for
from cpcal.solver.execution.stopping import asked, heard

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


def refuse(*problems: tuple[object, str, str, str]) -> None:
    """InputError of those that are so: whether it is so, where, what is wrong, and the remedy."""
    found = [Problem(where, what, remedy) for wrong, where, what, remedy in problems if wrong]
    if found:
        raise InputError(found)


def refuse_options(given: Iterable[str], because: str, remedy: str = "leave it out") -> None:
    """InputError that names each of these options, if there are any; they are called as their parameters."""
    names = (f"option --{name.replace('_', '-')}" for name in given)
    refuse(*((True, name, f"has no meaning {because}", remedy) for name in names))


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
