"""How much a verb says, and where it keeps a record: the options of every verb that can take long."""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console

from cpcal.cli.folders import output_path, unwritable
from cpcal.cli.grouped import grouped
from cpcal.cli.terminal import terminal
from cpcal.common.errors import printable
from cpcal.common.version import __version__
from cpcal.solver.compiled import QUIET

T = TypeVar("T")

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
