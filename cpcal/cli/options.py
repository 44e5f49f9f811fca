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
from cpcal.files.run_folder import FolderKind, answers_into
from cpcal.solver.compiled import QUIET
from cpcal.solver.execution.executors import Place, executor_for
from cpcal.solver.execution.stopping import asked, heard, raising, within_memory

if TYPE_CHECKING:
    from cpcal.robot import Campaign

T = TypeVar("T")


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
    groups: dict[str, Any] = {key: kind for key, kind in hints.items() if is_dataclass(kind)}
    for parameter in inspect.signature(verb).parameters.values():
        listed = [(parameter.name, parameter.default, hints[parameter.name])]
        if (group := groups.get(parameter.name)) is not None:
            of, required = get_type_hints(group, include_extras=True), inspect.Parameter.empty
            listed = [(f.name, required if f.default is MISSING else f.default, of[f.name]) for f in fields(group)]
        parameters += [
            inspect.Parameter(one, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for one, default, annotation in listed
        ]

    def run(**given: Any) -> None:
        for key, kind in groups.items():
            given[key] = kind(**{field.name: given.pop(field.name) for field in fields(kind)})
        talk = given.get("talk", Talk())
        with raising(), _hushed(talk.quiet), recorded(talk.log, name):
            raise typer.Exit(verb(**given) or 0)

    run.__doc__ = verb.__doc__
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


# ------------------------------------------------------------------------------------------------------------------
# How options are declared, and those that several verbs have.


def option(metavar: str | None, help: str, *names: str, **more: Any) -> Any:
    """An option: what stands for its value in the help (None: as its type, or nothing for a flag), and what it does."""
    return typer.Option(*names, metavar=metavar, help=help, **more)


def expert(metavar: str | None, help: str, *names: str, **more: Any) -> Any:
    """An option that few need, in a panel of its own."""
    return option(metavar, help, *names, rich_help_panel="For experts", **more)


def output(metavar: str, help: str, **more: Any) -> Any:
    """The option --output."""
    return option(metavar, help, "--output", "-o", **more)


def argument(metavar: str, help: str) -> Any:
    return typer.Argument(metavar=metavar, help=help)


CampaignFolder = Annotated[Path, argument("CAMPAIGN", "Folder of campaign.toml, measurements.csv.")]
OriginalCampaign = Annotated[
    Path | None, option("CAMPAIGN", "Folder of the original campaign, to compare the run's with.")
]
TargetFile = Annotated[Path, option("FILE", "The target's dots: target.toml.")]
Force = Annotated[bool, option(None, "Write into a folder that is not empty.", "--force")]
NoChecker = Annotated[bool, expert(None, "A page that does not check itself.", "--no-checker")]


def refuse_options(given: Iterable[str], because: str, remedy: str = "leave it out") -> None:
    """InputError that names each of these options, if there are any; they are called as their parameters."""
    names = [f"option --{name.replace('_', '-').removeprefix('as-')}" for name in given]
    if names:
        raise InputError([Problem(name, f"has no meaning {because}", remedy) for name in names])


def numbers_of(text: str | None, kind: Callable[[str], T], what: str, option: str) -> tuple[T, ...] | None:
    """Numbers with commas between them. Raises BadParameter."""
    if text is None:
        return None
    try:
        return tuple(kind(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r:.60} is no list of {what}", param_hint=option) from None


# ------------------------------------------------------------------------------------------------------------------
# How much a verb says, and where it keeps a record.


class _Terminal(Console):
    """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


@dataclass(frozen=True)
class Talk:
    """How much is said, and the consoles that follow."""

    quiet: Annotated[bool, option(None, "Print nothing but errors.", "--quiet", "-q")] = False
    verbose: Annotated[bool, option(None, "Print every table and sentence.", "--verbose", "-v")] = False
    log: Annotated[Path | None, expert("FILE", "Add a record of the run to FILE: JSON Lines.")] = None

    @property
    def out(self) -> Console:
        """Where answers go."""
        return self.console(stderr=False)

    def console(self, *, stderr: bool = True) -> Console:
        """Prints text as it is, but for hidden characters. Progress goes to stderr; errors are raised."""
        console = _Terminal(stderr=stderr, quiet=self.quiet, markup=False, emoji=False, highlight=False)
        if not console.is_terminal:
            console.width = 120
        return console

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
        errors = self.console()

        def tell(text: str) -> None:
            record("progress", text=text)
            if errors.is_terminal:
                errors.print(text)

        return tell


def warn(text: str) -> None:
    """A line on stderr, whatever --quiet says."""
    typer.echo(printable(f"cpcal: {text}"), err=True)


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
    """One JSON object a line: time (UTC), level, event, and the event's fields; infinities are texts.

    A record that cannot be written costs one message.
    """

    def format(self, record: logging.LogRecord) -> str:
        from cpcal.files.codec import encoded  # here: arrays take a tenth of a second to load

        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {"time": time, "level": record.levelname.lower(), "event": record.getMessage()}
        return json.dumps(line | encoded(getattr(record, "fields", {})), allow_nan=False, ensure_ascii=False)

    def handleError(self, record: logging.LogRecord) -> None:
        _LOGGER.removeHandler(self)
        warn(f"warning: the record ends here: {self.baseFilename}: {sys.exc_info()[1]}")


# ------------------------------------------------------------------------------------------------------------------
# Where long work runs and when it stops.

_LOADS = ("cpcal.cli.certify", "cpcal.solver.numba_begun")  # of workers
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kKMGT]?)i?B?")


@dataclass(frozen=True)
class Where:
    """Where long work runs, and when it stops."""

    workers: Annotated[int | None, option("N", "Processes of this machine.", min=1, show_default="1")] = None
    resume: Annotated[bool, option(None, "Go on from where a stopped run of the same work was.", "--resume")] = False
    scheduler: Annotated[str | None, expert("ADDRESS", "Dask scheduler of a cluster, instead of --workers.")] = None
    memory_limit: Annotated[
        str | None, expert("SIZE", "Stop, with what is proved, beyond SIZE (such as 2G) of memory in this process.")
    ] = None

    @contextmanager
    def place(self) -> Iterator[Place]:
        """Where the work is done, which can be stopped; it then ends with the command that goes on with it.

        Raises InputError, BadParameter.
        """
        with self.stoppable(), executor_for(self.workers, self.scheduler, loads=_LOADS) as place:
            try:
                yield place
            finally:
                if asked() is not None:
                    again = ["cpcal", *sys.argv[1:], *([] if self.resume else ["--resume"])]
                    warn(f"go on with: {shlex.join(again)}")

    @contextmanager
    def stoppable(self) -> Iterator[None]:
        """Until the end of the block a signal, or the limit of memory, asks the work to stop. Raises BadParameter."""
        limit = None
        if self.memory_limit is not None:
            found = _SIZE.fullmatch(self.memory_limit.strip())
            if found is None:
                message = f"{self.memory_limit!r:.60} is no size of memory: give one such as 500M or 2G"
                raise typer.BadParameter(message, param_hint="--memory-limit")
            limit = int(float(found[1]) * 1024 ** ["", "K", "M", "G", "T"].index(found[2].upper()))
        with heard(terminate=True), within_memory(limit):
            yield


# ------------------------------------------------------------------------------------------------------------------
# Where results go: refused before the work begins, not after it.


def check_writable(folder: Path) -> None:
    """InputError when `folder` is no folder that can be written, or made."""
    ancestor, remedy = folder.absolute(), "choose a folder that can be written to"
    while not os.path.lexists(ancestor):
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        raise InputError([Problem(str(folder), f"cannot be a folder: {ancestor} is not one", remedy)])
    if not os.access(ancestor, os.W_OK | os.X_OK):
        raise InputError([Problem(str(folder), f"cannot be written: no permission in {ancestor}", remedy)])


def check_new(folder: Path, *, force: bool) -> None:
    """InputError when `folder` holds something, unless `force`d."""
    try:
        full = folder.is_dir() and any(folder.iterdir())
    except OSError as error:
        raise unwritable(folder, error) from None
    if full and not force:
        remedy = "choose another one, or overwrite what it holds with --force"
        raise InputError([Problem(str(folder), "is a folder that is not empty", remedy)])


def answer(
    folder: Path,
    kind: FolderKind,
    find: Callable[[Path], T],
    save: Callable[[T, Path], object],
    page: Callable[[T, Path], Path],
    show: Callable[[T], object],
    talk: Talk,
    campaign: Campaign | None = None,
) -> T:
    """Find an answer, write it and its page into a folder, show it. The functions get a folder aside, for their files.

    A full disk costs the files, not the answer: why it cannot be written is raised once it is shown.
    """
    found: list[T] = []
    failure, name = None, ""
    try:
        with answers_into(folder, kind, campaign) as draft:
            found.append(find(draft))
            save(found[0], draft)
            name = page(found[0], draft).name
    except InputError as error:
        if not found:
            raise
        failure = error
    show(found[0])
    if failure is not None:
        raise failure
    talk.say(f"Report: {folder / name}")
    return found[0]


# The folder of a study beside calibration.json, as `cpcal calibrate` and `cpcal demo` leave it.
STUDY, CAMPAIGN, VALIDATION, FITS, RUN, TIMEOUT = "study", "campaign", "validation", "fits", "run", "timeout"
PIXEL_SETS, PIXEL_CAMPAIGN, PIXEL_RUN = "pixel-sets", "pixel-campaign", "pixel-run"  # where poses came from images
