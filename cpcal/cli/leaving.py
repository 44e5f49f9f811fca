"""How errors leave the program: one message on stderr and an exit status; never a traceback.

CPCAL_TRACEBACK=1 in the environment shows the traceback of an internal error, for a report.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence

import typer

from cpcal.cli.status import Status
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.solver.execution.stopping import Reason, Stopped

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
