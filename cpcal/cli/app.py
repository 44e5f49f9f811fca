"""The table of verbs, --version, and how errors leave the program: one message on stderr and an exit status."""

from __future__ import annotations

import ast
import contextlib
import errno
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from functools import wraps
from importlib import import_module
from importlib.util import find_spec
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from cpcal.cli.options import (
    CHECK_STATUS_HELP,
    HAND_EYE_STATUS_HELP,
    IMPORT_STATUS_HELP,
    SOLVE_STATUS_HELP,
    STATUS_HELP,
    VERIFY_STATUS_HELP,
    Status,
)
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.version import __version__
from cpcal.solver.execution.stopping import Reason, Stopped, raising

# ------------------------------------------------------------------------------------------------------------------
# How errors leave the program: one message on stderr and an exit status; never a traceback.
#
# CPCAL_TRACEBACK=1 in the environment shows the traceback of an internal error, for a report.

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


# ------------------------------------------------------------------------------------------------------------------
# The typer application: its verbs, --version, and how errors leave it.


class Verb(NamedTuple):
    """Where the function of a verb is, and a command that it can be tried with."""

    module: str
    function: str
    example: str
    statuses: str | None = None

    @property
    def epilog(self) -> str:
        return "\n\n".join(filter(None, (f"Example: `cpcal {self.example}`", self.statuses)))

    @property
    def summary(self) -> str:
        """Its docstring, read and not imported: to load all verbs for a list of them would take a second or two."""
        spec: Any = find_spec(self.module)
        functions = (node for node in ast.parse(spec.loader.get_data(spec.origin)).body)
        own = next(node for node in functions if isinstance(node, ast.FunctionDef) and node.name == self.function)
        return ast.get_docstring(own) or ""


VERBS = {
    "robot": Verb("cpcal.cli.campaign", "robot", "robot list"),
    "import": Verb(
        "cpcal.cli.campaign", "import_log", "import log.csv --robot deltalab -o campaign", IMPORT_STATUS_HELP
    ),
    "check": Verb("cpcal.cli.campaign", "check", "check campaign", CHECK_STATUS_HELP),
    "certify": Verb("cpcal.cli.certify", "certify", "certify campaign -o run --tolerance 0.5", STATUS_HELP),
    "accuracy": Verb(
        "cpcal.cli.accuracy", "accuracy_of", "accuracy run -o accuracy --workspace x=-50:50,y=-50:50,z=300:400"
    ),
    "compare": Verb(
        "cpcal.cli.certify", "compare_models", "compare campaign -o models --tolerance 0.5 --legs 1", STATUS_HELP
    ),
    "solve": Verb("cpcal.cli.solve", "solve", "solve kin1.bch -o kin1.json", SOLVE_STATUS_HELP),
    "simulate": Verb("cpcal.cli.campaign", "simulate", "simulate deltalab -o campaign --joint-error 1"),
    "camera": Verb("cpcal.cli.image", "camera", "camera head_camera.yaml -o camera.toml"),
    "target": Verb("cpcal.cli.image", "target", "target -o target.toml"),
    "detect": Verb(
        "cpcal.cli.image", "detect_poses", "detect images --target target.toml --camera camera.toml -o poses.csv"
    ),
    "pose-sets": Verb(
        "cpcal.cli.image", "pose_sets", "pose-sets images --target target.toml --camera camera.toml -o sets"
    ),
    "calibrate": Verb("cpcal.cli.calibrate", "calibrate", "calibrate study -o calibrated"),
    "demo": Verb("cpcal.cli.demo", "demo", "demo -o demo", STATUS_HELP),
    "robust": Verb("cpcal.cli.certify", "robust_brackets", "robust campaign --outliers 1 -o robust", STATUS_HELP),
    "handeye": Verb("cpcal.cli.handeye", "hand_eye", "handeye study -o run --tolerance 1", HAND_EYE_STATUS_HELP),
    "handeye-wrong": Verb("cpcal.cli.handeye", "wrong_images", "handeye-wrong study -o wrong --outliers 1"),
    "handeye-next": Verb("cpcal.cli.handeye", "hand_eye_next", "handeye-next study --poses reachable.csv"),
    "handeye-legs": Verb("cpcal.cli.handeye", "hand_eye_legs", "handeye-legs run --frames frames"),
    "handeye-study": Verb("cpcal.cli.handeye", "hand_eye_study", "handeye-study --simulate 20 -o study"),
    "export": Verb("cpcal.cli.report", "export", "export run --format toml -o parameters.toml"),
    "report": Verb("cpcal.cli.report", "report", "report run"),
    "plugins": Verb("cpcal.cli.solve", "plugins", "plugins"),
    "verify": Verb("cpcal.cli.verify", "verify", "verify run", VERIFY_STATUS_HELP),
}


class _Verbs(TyperGroup):
    """Imports a verb when it is asked for. Whatever is raised leaves as one message and a status: see `leaving`."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {name: TyperCommand(name) for name in VERBS}  # stand-ins: their names are all that is asked for

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in VERBS:
            return None
        verb = VERBS[cmd_name]
        alone = typer.Typer(add_completion=False, rich_markup_mode="markdown")
        alone.command(cmd_name, epilog=verb.epilog)(getattr(import_module(verb.module), verb.function))
        command = typer.main.get_command(alone)
        command.callback = _interruptible(command.callback)
        _untyped(command.get_params(ctx))
        return command

    def get_params(self, ctx: Any) -> list[Any]:
        return _untyped(super().get_params(ctx))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        listed = TyperGroup(
            name=self.name,
            commands={name: TyperCommand(name, help=verb.summary) for name, verb in VERBS.items()},
            params=self.get_params(ctx),
            add_help_option=False,  # which is one of them
            help=self.help,
            epilog=self.epilog,
            rich_markup_mode=self.rich_markup_mode,
        )
        listed.format_help(ctx, formatter)

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        with leaving():
            refuse_empty(args)
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: Any) -> Any:
        with leaving():
            return super().invoke(ctx)


def _untyped(parameters: list[Any]) -> list[Any]:
    """A flag takes no value, and so has no type to show."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = " "
    return parameters


def _interruptible(callback: Any) -> Any:
    """A verb that tidies up when it is stopped."""

    @wraps(callback)
    def run(*given: Any, **named: Any) -> Any:
        with raising():
            return callback(*given, **named)

    return run


app = typer.Typer(
    name="cpcal",
    cls=_Verbs,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    epilog=STATUS_HELP,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cpcal {__version__}")
        raise typer.Exit


@app.callback()
def _cpcal(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Certified calibration of parallel robots: how small the model error can be, proved from both sides."""
