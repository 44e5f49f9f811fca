"""How much a verb says, and where it keeps a record: options that long-running verbs share."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from cpcal.cli.folders import output_path, unwritable
from cpcal.files.codec import encoded

_PANEL = "What is said"
_LOGGER = logging.getLogger("cpcal")


@dataclass(frozen=True)
class Talk:
    """Options of the command line; a dataclass of a verb's options inherits them."""

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


def record(event: str, **fields: Any) -> None:
    """Log an event with its fields; a line of the file of --log."""
    _LOGGER.info(event, extra={"fields": fields})


@contextmanager
def logging_to(file: Path | None) -> Iterator[None]:
    """Records go to the file while in the block. Raises InputError when it cannot be written."""
    if file is None:
        yield
        return
    try:
        handler = logging.FileHandler(file, encoding="utf-8")
    except OSError as error:
        raise unwritable(file, error) from None
    handler.setFormatter(_JsonLines())
    before = _LOGGER.level
    _LOGGER.addHandler(handler)
    _LOGGER.setLevel(logging.INFO)
    try:
        yield
    except BaseException as error:
        _LOGGER.error("failed", extra={"fields": {"kind": type(error).__name__, "message": str(error)}})
        raise
    finally:
        _LOGGER.removeHandler(handler)
        _LOGGER.setLevel(before)
        handler.close()


class _JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC), level, event, and the event's fields; infinities are texts."""

    def format(self, record: logging.LogRecord) -> str:
        fields = getattr(record, "fields", {})
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {"time": time, "level": record.levelname.lower(), "event": record.getMessage(), **encoded(fields)}
        return json.dumps(line, allow_nan=False, ensure_ascii=False)
