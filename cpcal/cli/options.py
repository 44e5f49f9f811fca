"""What verbs share: exit statuses, how options are declared, what is said and recorded, where work runs and results go.

A verb is a function with typer's annotations; a parameter that is a dataclass of options takes its fields as options of
the command line. It returns its exit status, or None for 0.
"""

from __future__ import annotations

import inspect
import json
import logging
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer
from rich.console import Console
from rich.text import Text

from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.files import unwritable
from cpcal.common.version import __version__
from cpcal.files.run_folder import FolderKind, answers_into, check_replaceable
from cpcal.solver.compiled import QUIET
from cpcal.solver.execution.executors import Place, executor_for
from cpcal.solver.execution.stopping import asked, heard, raising, within_memory

if TYPE_CHECKING:
    from cpcal.robot import Campaign

T = TypeVar("T")

EXPERT = "For experts"  # the panel of options that few need


class Status(IntEnum):
    ANSWERED = 0
    UNKNOWN = 1
    UNUSABLE = 2
    INTERNAL = 3
    INTERRUPTED = 130
    TERMINATED = 143


def command(name: str, verb: Callable[..., Any]) -> Callable[..., None]:
    """The function that typer makes a command of: options are listed one by one, and the record of `Talk` is kept."""
    hints = get_type_hints(verb, include_extras=True)
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(verb).parameters.values():
        kind = hints[parameter.name]
        if is_dataclass(kind):
            groups[parameter.name] = kind
            of = get_type_hints(kind, include_extras=True)
            listed = [
                (f.name, inspect.Parameter.empty if f.default is MISSING else f.default, of[f.name])
                for f in fields(kind)
            ]
        else:
            listed = [(parameter.name, parameter.default, kind)]
        parameters += [
            inspect.Parameter(one, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for one, default, annotation in listed
        ]

    def run(**given: Any) -> None:
        for group, kind in groups.items():
            given[group] = kind(**{field.name: given.pop(field.name) for field in fields(kind)})
        talk = given.get("talk", Talk())
        with raising(), _hushed(talk.quiet), recorded(talk.log, name):
            raise typer.Exit(verb(**given) or 0)

    run.__doc__ = verb.__doc__
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


# ------------------------------------------------------------------------------------------------------------------
# How much a verb says, and where it keeps a record.


class _Terminal(Console):
    """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


def terminal(*, stderr: bool = False, quiet: bool = False) -> Console:
    """A console that prints text as it is, but for hidden characters; a quiet one prints nothing."""
    console = _Terminal(stderr=stderr, quiet=quiet, markup=False, emoji=False, highlight=False)
    if not console.is_terminal:
        console.width = 120
    return console


def output_path(text: str | Path) -> Path:
    """The value of an option that names what to write, or its default. Raises BadParameter."""
    if not str(text).strip() or "\0" in str(text):
        raise typer.BadParameter("an empty name is no place to write to: name a file or folder")
    return Path(text)


def output(metavar: str, help: str, **more: Any) -> Any:
    """The option --output."""
    return typer.Option("--output", "-o", metavar=metavar, parser=output_path, help=help, **more)


def expert(*names: str, **more: Any) -> Any:
    """An option that few need."""
    return typer.Option(*names, rich_help_panel=EXPERT, **more)


Legs = Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")]
TimeLimit = Annotated[float | None, typer.Option(metavar="S", min=0.0, help="Seconds a leg, at most.")]


@dataclass(frozen=True)
class Talk:
    """How much is said, and the consoles that follow."""

    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print every table and sentence.")] = False
    log: Annotated[
        Path | None, expert(metavar="FILE", parser=output_path, help="Add a record of the run to FILE: JSON Lines.")
    ] = None

    @property
    def out(self) -> Console:
        """Where answers go."""
        return terminal(quiet=self.quiet)

    @property
    def errors(self) -> Console:
        """Where progress goes; errors are raised."""
        return terminal(stderr=True, quiet=self.quiet)

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
        """A callback for lines of progress: to the record, and to a terminal where there is one."""
        errors = self.errors

        def tell(text: str) -> None:
            record("progress", text=text)
            if errors.is_terminal:
                errors.print(text)

        return tell


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


_LOGGER = logging.getLogger("cpcal")


def record(event: str, **fields: Any) -> None:
    """Log an event with its fields; a line of the file of --log."""
    _LOGGER.info(event, extra={"fields": fields})


@contextmanager
def recorded(file: Path | None, verb: str) -> Iterator[None]:
    """Records of a verb go to the file while in the block: how it began, what it told, how it ended.

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
        record("began", command=verb, version=__version__)
        yield
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
# Where long work runs and when it stops.

_LOADS = ("cpcal.cli.certify", "cpcal.solver.numba_begun")  # of workers
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kKMGT]?)i?B?")
_UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


@dataclass(frozen=True)
class Where:
    """Where long work runs, and when it stops."""

    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes of this machine.", show_default="1")
    ] = None
    resume: Annotated[bool, typer.Option("--resume", help="Go on from where a stopped run of the same work was.")] = (
        False
    )
    scheduler: Annotated[
        str | None, expert(metavar="ADDRESS", help="Dask scheduler of a cluster, instead of --workers.")
    ] = None
    memory_limit: Annotated[
        str | None,
        expert(metavar="SIZE", help="Stop, with what is proved, beyond SIZE (such as 2G) of memory in this process."),
    ] = None

    @contextmanager
    def place(self, *, resumable: bool = True) -> Iterator[Place]:
        """Where the work is done, which can be stopped; it then ends with the command that goes on with it.

        Raises InputError, BadParameter.
        """
        with self.stoppable(), executor_for(self.workers, self.scheduler, loads=_LOADS) as place:
            try:
                yield place
            finally:
                if resumable and asked() is not None:
                    again = ["cpcal", *sys.argv[1:], *([] if self.resume else ["--resume"])]
                    typer.echo(printable(f"cpcal: go on with: {shlex.join(again)}"), err=True)

    @contextmanager
    def stoppable(self) -> Iterator[None]:
        """Until the end of the block a signal, or the limit of memory, asks the work to stop. Raises BadParameter."""
        limit = None if self.memory_limit is None else _bytes(self.memory_limit)
        with heard(terminate=True), within_memory(limit):
            yield


def _bytes(text: str) -> int:
    """Raises BadParameter."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        message = f"{text!r:.60} is no size of memory: give one such as 500M or 2G"
        raise typer.BadParameter(message, param_hint="--memory-limit")
    return int(float(found[1]) * _UNITS[found[2].upper()])


# ------------------------------------------------------------------------------------------------------------------
# Where results go: refused before the work begins, not after it.

_CHOOSE = "choose a folder that can be written to"


def check_writable(folder: Path) -> None:
    """InputError when `folder` is no folder that can be written, or made."""
    ancestor = folder.absolute()
    while not os.path.lexists(ancestor):
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        raise InputError([Problem(str(folder), f"cannot be a folder: {ancestor} is not one", _CHOOSE)])
    if not os.access(ancestor, os.W_OK | os.X_OK):
        raise InputError([Problem(str(folder), f"cannot be written: no permission in {ancestor}", _CHOOSE)])


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


def check_target(folder: Path, kind: FolderKind, campaign: Path | None = None) -> None:
    """InputError when answers (about a campaign) cannot be written to `folder`, or must not."""
    check_writable(folder)
    if campaign is not None and folder.exists() and campaign.exists() and folder.samefile(campaign):
        raise InputError([Problem(str(folder), "is the campaign itself", "choose another folder for the answers")])
    check_replaceable(folder, kind)


def answer(
    folder: Path,
    kind: FolderKind,
    find: Callable[[Path], T],
    write: Callable[[T, Path], object],
    show: Callable[[T, InputError | None], object],
    campaign: Campaign | None = None,
) -> T:
    """Find an answer, write it into a folder, show it. Both functions get a folder aside, for their files.

    A full disk costs the files, not the answer: why it cannot be written is raised once it is shown.
    """
    found: list[T] = []
    failure: InputError | None = None
    try:
        with answers_into(folder, kind, campaign) as draft:
            found.append(find(draft))
            write(found[0], draft)
    except InputError as error:
        if not found:
            raise
        failure = error
    show(found[0], failure)
    if failure is not None:
        raise failure
    return found[0]


def made(folder: Path) -> None:
    """Make the folder if need be. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None


def numbers_of(text: str | None) -> tuple[int, ...] | None:
    """The numbers of --legs. Raises BadParameter."""
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        message = f"{text!r:.60} is no list of legs: give numbers with commas between them, such as 1,3"
        raise typer.BadParameter(message, param_hint="--legs") from None


# The folder of a study beside calibration.json, as `cpcal calibrate` and `cpcal demo` leave it.
STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT = "study", "campaign", "validation", "fits", "run", "timeout"
PIXEL_SETS, PIXEL_CAMPAIGN, PIXEL_RUN = "pixel-sets", "pixel-campaign", "pixel-run"  # where poses came from images
