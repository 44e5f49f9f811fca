"""What verbs share: exit statuses, options, consoles, the record of a run, and where results go."""

from __future__ import annotations

import inspect
import json
import logging
import os
import re
import shlex
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

from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.files import unwritable
from cpcal.common.version import __version__
from cpcal.files.run_folder import FolderKind, check_replaceable
from cpcal.solver.compiled import QUIET
from cpcal.solver.execution.executors import Place, executor_for
from cpcal.solver.execution.stopping import asked, heard, within_memory

__all__ = ["check_new", "check_target", "check_writable", "made", "output_path", "unwritable"]

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
# Where results go: refused before the work begins, not after it.

# What stands in the folder of a study beside calibration.json, as `cpcal calibrate` and `cpcal demo` leave it.
STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT = "study", "campaign", "validation", "fits", "run", "timeout"
PIXEL_SETS, PIXEL_CAMPAIGN, PIXEL_RUN = "pixel-sets", "pixel-campaign", "pixel-run"  # where poses came from images

_CHOOSE = "choose a folder that can be written to"


def check_new(folder: Path, *, force: bool) -> None:
    """InputError when `folder` holds something, unless `force`d, or cannot be written."""
    check_writable(folder)
    try:
        full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise unwritable(folder, error) from None
    if full and not force:
        remedy = "choose another one, or overwrite what it holds with --force"
        raise InputError([Problem(str(folder), "is a folder that is not empty", remedy)])


def is_earlier_demo(folder: Path) -> bool:
    """Whether a folder holds a study that `cpcal demo` wrote, or the poses found so far, and nothing besides."""
    files = {"calibration.json", "images", "images.json", "report.html"}
    known = files | {STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT, PIXEL_SETS, PIXEL_CAMPAIGN, PIXEL_RUN}
    begun = folder / "poses-calibration.csv.journal"
    if not ((folder / STUDY / "study.toml").is_file() or begun.is_file()):
        return False
    return all(path.name in known or path.name.startswith("poses-") for path in folder.iterdir())


def check_writable(folder: Path) -> None:
    """InputError when `folder` is no folder that can be written, or made."""
    ancestor = folder.absolute()
    while not os.path.lexists(ancestor):
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        raise InputError([Problem(str(folder), f"cannot be a folder: {ancestor} is not one", _CHOOSE)])
    if not os.access(ancestor, os.W_OK | os.X_OK):
        raise InputError([Problem(str(folder), f"cannot be written: no permission in {ancestor}", _CHOOSE)])


def output_path(text: str) -> Path:
    """The value of an option that names what to write. Raises BadParameter."""
    if not text.strip() or "\0" in text:
        raise typer.BadParameter("an empty name is no place to write to: name a file or folder")
    return Path(text)


def check_target(folder: Path, kind: FolderKind, campaign: Path | None = None) -> None:
    """InputError when answers about a campaign cannot be written to `folder`, or must not."""
    check_writable(folder)
    if campaign is not None and folder.exists() and campaign.exists() and folder.samefile(campaign):
        raise InputError([Problem(str(folder), "is the campaign itself", "choose another folder for the answers")])
    check_replaceable(folder, kind)


def made(folder: Path) -> None:
    """Make the folder if need be. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None


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


# ------------------------------------------------------------------------------------------------------------------
# How much a verb says, and where it keeps a record: the options of every verb that can take long.

_SAID = "What is said"
_LOGGER = logging.getLogger("cpcal")


@dataclass(frozen=True)
class Talk:
    """Options of the command line, and the consoles that follow them."""

    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.", rich_help_panel=_SAID)] = (
        False
    )
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print every table and sentence.", rich_help_panel=_SAID)
    ] = False
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            parser=output_path,
            help="Add a record of the run to FILE: JSON Lines.",
            rich_help_panel=_SAID,
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


# ------------------------------------------------------------------------------------------------------------------
# Where long work runs and when it stops: options that long-running verbs share.

_LOADS = ("cpcal.cli.certify", "cpcal.solver.numba_begun")  # of workers
_RUNS = "Where it runs"
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kKMGT]?)i?B?")
_UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


@dataclass(frozen=True)
class Where:
    """Options of the command line; a dataclass of a verb's options inherits them."""

    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Processes of this machine.", show_default="1", rich_help_panel=_RUNS),
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler of a cluster, instead.", rich_help_panel=_RUNS),
    ] = None
    memory_limit: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Stop, with what is proved, beyond SIZE (such as 2G) of memory in this process.",
            rich_help_panel=_RUNS,
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
        typer.Option("--resume", help="Go on from where a stopped run of the same work was.", rich_help_panel=_RUNS),
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
