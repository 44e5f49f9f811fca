"""How much a verb says, and where it keeps a record: the options of every verb that can take long."""

from __future__ import annotations

import inspect
import json
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import MISSING, dataclass, fields
from datetime import UTC, datetime
from enum import IntEnum
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from rich.console import Console
from rich.text import Text

from cpcal.cli.folders import output_path, unwritable
from cpcal.common.errors import printable
from cpcal.common.version import __version__
from cpcal.solver.compiled import QUIET

# ------------------------------------------------------------------------------------------------------------------
# Consoles: what verbs print goes through one.

_WIDE = 120  # where there is no terminal to fit


class _Terminal(Console):
    """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


def terminal(*, stderr: bool = False, quiet: bool = False) -> Console:
    """A console that prints text as it is, but for hidden characters; a quiet one prints nothing."""
    console = _Terminal(stderr=stderr, quiet=quiet, markup=False, emoji=False, highlight=False)
    if not console.is_terminal:
        console.width = _WIDE
    return console


# ------------------------------------------------------------------------------------------------------------------
# Exit statuses: what they mean.


class Status(IntEnum):
    ANSWERED = 0
    UNKNOWN = 1
    UNUSABLE = 2
    INTERNAL = 3
    INTERRUPTED = 130
    TERMINATED = 143


STATUS_HELP = (
    "Exit status: **0** every leg answered, or with --tolerance every leg passes, **1** some leg undecided (a limit "
    "came first, or the search ended at the second-order effect of the readings, or where contractors end), or "
    "with --tolerance some leg that does not pass, **2** unusable input (one message lists every problem), **3** an "
    "internal error (please report it), **130** interrupted by Ctrl-C or **143** terminated by SIGTERM, with what was "
    "proved until then written and printed."
)

HAND_EYE_STATUS_HELP = (
    "Exit status: **0** the bracket is closed, or with --tolerance the tolerance is met, **1** the bracket is open, or "
    "with --tolerance it is not met or undecided, **2** unusable input (one message lists every problem), **3** an "
    "internal error (please report it), **130** interrupted, **143** terminated."
)

SOLVE_STATUS_HELP = (
    "Exit status: **0** complete (that there is no solution is an answer too), **1** a limit came first, or the "
    "certificate does not hold all of the answer, **2** unusable input, **3** an internal error, **130** interrupted, "
    "**143** terminated."
)

VERIFY_STATUS_HELP = "Exit status: **0** every certificate proved, **1** one refused, **2** unusable input."

CHECK_STATUS_HELP = (
    "Exit status: **0** nothing looks wrong, **1** something is to be looked at (each with a sentence), "
    "**2** unusable input."
)

IMPORT_STATUS_HELP = (
    "Exit status: **0** the campaign was written (or looks right, with --preview), **1** nothing was written, since "
    "the data look mixed up, **2** unusable input."
)


# ------------------------------------------------------------------------------------------------------------------
# Options of a command as the fields of a dataclass: `Annotated[type, typer.Option(...)] = default`.

T = TypeVar("T")


def grouped(options: type[Any], parameter: str = "options") -> Callable[[Callable[..., T]], Callable[..., T]]:
    """A command with a parameter that is such a dataclass takes its fields as options of the command line."""

    def decorate(command: Callable[..., T]) -> Callable[..., T]:
        hints = get_type_hints(options, include_extras=True)
        known = inspect.signature(command, eval_str=True).parameters.values()
        own = [one for one in known if one.name != parameter]
        names = [field.name for field in fields(options)]
        added = [
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if field.default is MISSING else field.default,
                annotation=hints[field.name],
            )
            for field in fields(options)
        ]

        @wraps(command)
        def run(**given: Any) -> T:
            chosen = options(**{name: given.pop(name) for name in names})
            return command(**given, **{parameter: chosen})

        del run.__wrapped__  # or its signature would count
        run.__signature__ = inspect.Signature([*own, *added])  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, *added)}
        return run

    return decorate


_PANEL = "What is said"
_LOGGER = logging.getLogger("cpcal")


@dataclass(frozen=True)
class Talk:
    """Options of the command line, and the consoles that follow them."""

    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.", rich_help_panel=_PANEL)] = (
        False
    )
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print every table and sentence.", rich_help_panel=_PANEL)
    ] = False
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            parser=output_path,
            help="Add a record of the run to FILE: JSON Lines.",
            rich_help_panel=_PANEL,
        ),
    ] = None

    @property
    def out(self) -> Console:
        """Where answers go."""
        return terminal(quiet=self.quiet)

    @property
    def errors(self) -> Console:
        """Where progress goes; errors are raised."""
        return terminal(stderr=True, quiet=self.quiet)

    def say(self, text: str) -> None:
        """A line of the answer."""
        self.out.print(text, soft_wrap=True)

    def progress(self) -> Callable[[str], None]:
        """A callback for lines of progress: to the record, and to a terminal where there is one."""
        errors = self.errors

        def tell(text: str) -> None:
            record("progress", text=text)
            if errors.is_terminal:
                errors.print(text)

        return tell


def talking(command: Callable[..., T]) -> Callable[..., T]:
    """A verb with a parameter `talk: Talk` takes --quiet, --verbose and --log, and keeps the record while it runs."""

    @wraps(command)
    def run(**given: Any) -> T:
        with _hushed(given["talk"].quiet), logging_to(given["talk"].log, command.__name__):
            return command(**given)

    return grouped(Talk, "talk")(run)


@contextmanager
def _hushed(quiet: bool) -> Iterator[None]:
    """No word of compilation from this process and those that it starts while in the block, if `quiet`."""
    if not quiet or QUIET in os.environ:
        yield
        return
    os.environ[QUIET] = "1"
    try:
        yield
    finally:
        del os.environ[QUIET]


def record(event: str, **fields: Any) -> None:
    """Log an event with its fields; a line of the file of --log."""
    _LOGGER.info(event, extra={"fields": fields})


@contextmanager
def logging_to(file: Path | None, command: str) -> Iterator[None]:
    """Records of a command go to the file while in the block: how it began, what it told, how it ended.

    Raises InputError when the file cannot be written.
    """
    if file is None:
        yield
        return
    try:
        handler = _RecordFile(file, encoding="utf-8")
    except OSError as error:
        raise unwritable(file, error) from None
    handler.setFormatter(_JsonLines())
    before = _LOGGER.level
    _LOGGER.addHandler(handler)
    _LOGGER.setLevel(logging.INFO)
    try:
        record("began", command=command, version=__version__)
        yield
        record("ended", status=0)
    except typer.Exit as left:
        record("ended", status=int(left.exit_code))
        raise
    except BaseException as error:
        _LOGGER.error("failed", extra={"fields": {"kind": type(error).__name__, "message": str(error)}})
        raise
    finally:
        _LOGGER.removeHandler(handler)
        _LOGGER.setLevel(before)
        with suppress(OSError):  # told before
            handler.close()


class _RecordFile(logging.FileHandler):
    """A record that cannot be written costs one message."""

    def handleError(self, record: logging.LogRecord) -> None:
        _LOGGER.removeHandler(self)
        typer.echo(
            printable(f"cpcal: warning: the record ends here: {self.baseFilename}: {sys.exc_info()[1]}"), err=True
        )


class _JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC), level, event, and the event's fields; infinities are texts."""

    def format(self, record: logging.LogRecord) -> str:
        from cpcal.files.codec import encoded  # here: arrays take a tenth of a second to load

        fields = getattr(record, "fields", {})
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {"time": time, "level": record.levelname.lower(), "event": record.getMessage(), **encoded(fields)}
        return json.dumps(line, allow_nan=False, ensure_ascii=False)
