"""The table of verbs, --version, and how errors leave the program: one message on stderr and an exit status."""

import ast
import contextlib
import errno
import inspect
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from cpcal.cli.verbs import Status, Talk, option, warn
from cpcal.common.errors import CpcalError, InputError, Problem, printable
from cpcal.common.version import __version__
from cpcal.solver.compiled import QUIET
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
    shown, warnings.showwarning = warnings.showwarning, lambda message, *_, **__: warn(f"warning: {message}")
    try:
        yield
        sys.stdout.flush()
    except _TYPER:
        raise
    except CpcalError as error:
        _leave(Status.UNUSABLE, *str(error).split("\n"))
    except KeyboardInterrupt as stop:
        reason = stop.reason if isinstance(stop, Stopped) else Reason.INTERRUPTED
        _leave(Status(reason), reason.sentence)
    except MemoryError as error:
        _leave(Status.UNUSABLE, f"too little memory: {error or 'nothing is left'}")
    except OSError as error:
        if error.errno == errno.EPIPE:
            raise  # nobody reads on: click leaves without a word
        with contextlib.suppress(OSError, ValueError):  # what is left in a buffer must not fail again at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        name = "" if error.filename is None else f"{error.filename}: "
        _leave(Status.UNUSABLE, f"{name}{error.strerror or error}")
    except Exception as error:
        if os.environ.get("CPCAL_TRACEBACK"):
            traceback.print_exc()
        frames = reversed(traceback.extract_tb(error.__traceback__))
        place = next((f for f in frames if "cpcal" in f.filename or "contractors" in f.filename), None)
        at = "" if place is None else f" at {os.path.basename(place.filename)}:{place.lineno}"
        what = f"{type(error).__name__}{at}: {error}"[:300]
        _leave(Status.INTERNAL, f"internal error, please report it with the command and its files ({what})")
    finally:
        warnings.showwarning = shown


def _leave(status: Status, *message: str) -> None:
    with contextlib.suppress(OSError):
        typer.echo("cpcal: " + "\n".join(map(printable, message)), err=True)
    raise typer.Exit(status) from None


def refuse_empty(arguments: Sequence[str]) -> None:
    """InputError for an empty argument: `-o ""` would mean the folder one stands in."""
    problems = []
    for k, text in enumerate(arguments):
        if not text.strip() or (text.startswith("--") and text.endswith("=")):
            name = text.rstrip("=") or (f"after {arguments[k - 1]}" if k else "first")
            problems.append(Problem(f"argument {name}", "is empty", "name a file, a folder or a value"))
    if problems:
        raise InputError(problems)


# ------------------------------------------------------------------------------------------------------------------
# The table of verbs. A verb is imported when it is asked for.

_ENDS = (
    "**2** unusable input (one message lists every problem), **3** an internal error (please report it), **130** "
    "interrupted by Ctrl-C or **143** terminated by SIGTERM, with what was proved until then written and printed."
)
_CERTIFIED = (
    "every leg answered, or with --tolerance every leg passes",
    "some leg undecided (a limit came first, or the search ended at the second-order effect of the readings, or where "
    "contractors end), or with --tolerance some leg that does not pass",
)


class Verb(NamedTuple):
    """Where the function of a verb is, a command that it can be tried with, and what exit statuses 0 and 1 mean.

    `function`: where it is not called as the verb.
    """

    module: str
    example: str
    statuses: tuple[str, str] | None = None
    hidden: bool = False
    function: str = ""

    @property
    def epilog(self) -> str:
        said = [f"Example: `cpcal {self.example}`"]
        if self.statuses is not None:
            said.append(f"Exit status: **0** {self.statuses[0]}, **1** {self.statuses[1]}, {_ENDS}")
        return "\n\n".join(said)

    def summary(self, function: str) -> str:
        """The docstring of its function, read and not imported: to load all verbs for a list of them would take a
        second or two."""
        spec: Any = find_spec(f"cpcal.cli.{self.module}")
        functions = (node for node in ast.parse(spec.loader.get_data(spec.origin)).body)
        own = next(node for node in functions if isinstance(node, ast.FunctionDef) and node.name == function)
        return ast.get_docstring(own) or ""


VERBS = {
    "demo": Verb("study", "demo -o demo", _CERTIFIED),
    "robot": Verb("campaign", "robot list"),
    "import": Verb(
        "campaign",
        "import log.csv --robot deltalab -o campaign",
        ("the campaign was written (or looks right, with --preview)", "nothing was written: the data look mixed up"),
        function="import_log",
    ),
    "simulate": Verb("campaign", "simulate deltalab -o campaign --joint-error 1"),
    "check": Verb(
        "campaign", "check campaign", ("nothing looks wrong", "something is to be looked at (each with a sentence)")
    ),
    "calibrate": Verb("study", "calibrate study -o calibrated"),
    "certify": Verb("certify", "certify campaign -o run --tolerance 0.5", _CERTIFIED),
    "accuracy": Verb("report", "accuracy run -o accuracy --workspace x=-50:50,y=-50:50,z=300:400"),
    "verify": Verb("verify", "verify run", ("every certificate proved", "one refused")),
    "report": Verb("report", "report run"),
    "export": Verb("report", "export run --format toml -o parameters.toml"),
    "handeye study": Verb("handeye", "handeye study --simulate 20 -o study"),
    "handeye certify": Verb(
        "handeye",
        "handeye certify study -o run --tolerance 1",
        (
            "the bracket is closed, or with --tolerance the tolerance is met",
            "the bracket is open, or with --tolerance it is not met or undecided",
        ),
    ),
    "handeye legs": Verb("handeye", "handeye legs run --frames frames"),
    "image target": Verb("image", "image target -o target.toml"),
    "image camera": Verb("image", "image camera head_camera.yaml -o camera.toml"),
    "image detect": Verb("image", "image detect images --target target.toml --camera camera.toml -o poses.csv"),
    "image sets": Verb("image", "image sets images --target target.toml --camera camera.toml -o sets"),
    "solve": Verb(
        "solve",
        "solve kin1.bch -o kin1.json",
        (
            "complete (that there is no solution is an answer too)",
            "a limit came first, or the certificate does not hold all of the answer",
        ),
    ),
    "plugins": Verb("solve", "plugins", hidden=True),
}
GROUPS = {
    "handeye": "Robot-world hand-eye calibration: a study, how accurate its frames can be, legs in these frames.",
    "image": "From images to poses: a target, a camera, poses in images, boxes of poses that are proved.",
}


def command(verb: Callable[..., Any]) -> Callable[..., None]:
    """The function that typer makes a command of: options are listed one by one."""
    hints, groups, listed = get_type_hints(verb), {}, []
    for key, parameter in inspect.signature(verb).parameters.items():
        declared, types = {key: parameter.default}, hints
        if hasattr(hints[key], "declared"):
            groups[key], declared, types = hints[key], hints[key].declared, get_type_hints(hints[key])
        for one, info in declared.items():
            if info.default is False and not info.param_decls:  # else it could be switched off, too
                info.param_decls = (f"--{one.replace('_', '-')}",)
            listed.append(inspect.Parameter(one, inspect.Parameter.KEYWORD_ONLY, default=info, annotation=types[one]))

    def run(**given: Any) -> None:
        for key, kind in groups.items():
            given[key] = kind(**{one: given.pop(one) for one in kind.declared})
        talk = given.get("talk", Talk())
        hushed = talk.quiet and QUIET not in os.environ  # no word of compilation, from workers either
        if hushed:
            os.environ[QUIET] = "1"
        try:
            with raising():
                raise typer.Exit(verb(**given) or 0)
        finally:
            if hushed:
                del os.environ[QUIET]

    run.__doc__ = verb.__doc__
    run.__signature__ = inspect.Signature(listed)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in listed}
    return run


class _Verbs(TyperGroup):
    """Imports a verb when it is asked for. Whatever is raised leaves as one message and a status: see `leaving`."""

    def __init__(self, group: str = "", **attributes: Any) -> None:
        super().__init__(**attributes)
        begins = f"{group} " if group else ""
        names = [name.removeprefix(begins).split()[0] for name in VERBS if name.startswith(begins)]
        self.begins = begins
        self.commands, self.listing = {name: TyperCommand(name) for name in names}, False  # only their names are used

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        name = self.begins + cmd_name
        if name in GROUPS:
            attributes = {"no_args_is_help": True, "rich_markup_mode": "markdown"}
            return _Verbs(name, name=name, help=GROUPS[name], **attributes)
        if name not in VERBS:
            return None
        verb = VERBS[name]
        called = verb.function or cmd_name
        if self.listing:  # all verbs: none is imported
            return TyperCommand(cmd_name, help=verb.summary(called), hidden=verb.hidden)
        alone = typer.Typer(add_completion=False, rich_markup_mode="markdown")
        function = getattr(import_module(f"cpcal.cli.{verb.module}"), called)
        alone.command(cmd_name, epilog=verb.epilog)(command(function))
        made = typer.main.get_command(alone)
        _untyped(made.get_params(ctx))
        return made

    def get_params(self, ctx: Any) -> list[Any]:
        return _untyped(super().get_params(ctx))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        self.listing = True
        super().format_help(ctx, formatter)

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        with leaving():
            refuse_empty(args)
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: Any) -> Any:
        with leaving():
            return super().invoke(ctx)


class _Value:
    """Makes a value of what is given, as typer does by pydantic: that takes 60 ms to load, and most need none of it."""

    @staticmethod
    def coerce(value: Any, param: Any, ctx: Any) -> Any:
        kind = param.type_descriptor.annotation
        if value is None or value is param.default:
            return value
        if isinstance(value, str) and kind in (str, Path):
            return kind(value)
        return type(param).get_runtime_param(param).coerce(value, param=param, ctx=ctx)


def _untyped(parameters: list[Any]) -> list[Any]:
    """A flag takes no value, and so has no type to show."""
    for parameter in parameters:
        parameter.get_runtime_param = _Value
        if getattr(parameter, "is_flag", False):
            parameter.metavar = " "
    return parameters


app = typer.Typer(
    name="cpcal",
    cls=_Verbs,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    epilog=f"Exit status: **0** done, **1** something is not answered, or refused, {_ENDS}",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cpcal {__version__}")
        raise typer.Exit


@app.callback()
def _cpcal(
    version: bool = option(False, "Print the version and leave.", "--version", callback=_version, is_eager=True),
) -> None:
    """Certified calibration of parallel robots: how small the model error can be, proved from both sides."""
