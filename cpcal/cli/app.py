"""The typer application: its verbs, --version, and how errors leave it."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from cpcal.cli.calibrate import calibrate
from cpcal.cli.certify import certify
from cpcal.cli.compare import compare_models
from cpcal.cli.demo.command import demo
from cpcal.cli.detect import detect_poses
from cpcal.cli.plugins import plugins
from cpcal.cli.report import report
from cpcal.cli.simulate import simulate
from cpcal.cli.status import STATUS_HELP, Status
from cpcal.cli.target import target
from cpcal.cli.verify import VERIFY_STATUS_HELP, verify
from cpcal.errors import CpcalError, printable
from cpcal.version import __version__


class _Verbs(TyperGroup):
    """Turns errors that a user can mend into one message and status 2, and Ctrl-C into status 130."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except CpcalError as error:
            lines = [printable(line) for line in str(error).split("\n")]
            typer.echo("cpcal: " + "\n".join(lines), err=True)
            raise typer.Exit(Status.UNUSABLE) from None
        except KeyboardInterrupt:
            typer.echo("cpcal: interrupted", err=True)
            raise typer.Exit(Status.INTERRUPTED) from None


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


app.command(epilog=STATUS_HELP)(certify)
app.command("compare", epilog=STATUS_HELP)(compare_models)
app.command()(simulate)
app.command()(target)
app.command("detect")(detect_poses)
app.command()(calibrate)
app.command(epilog=STATUS_HELP)(demo)
app.command()(report)
app.command()(plugins)
app.command(epilog=VERIFY_STATUS_HELP)(verify)


def main() -> None:
    """Entry point of the command `cpcal`."""
    app(prog_name="cpcal")
