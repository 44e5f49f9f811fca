"""Where long work runs and when it stops: options that long-running verbs share."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

import typer

from cpcal.common.errors import printable
from cpcal.solver.execution.executors import Place, executor_for
from cpcal.solver.execution.stopping import asked, heard, within_memory

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
