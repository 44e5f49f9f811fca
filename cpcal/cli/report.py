"""`cpcal report`: the page of a run, written again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_writable, unwritable
from cpcal.cli.show import terminal
from cpcal.errors import InputError, Problem
from cpcal.report import REPORT_NAME, write_page
from cpcal.result import load_result
from cpcal.robot import load_campaign

_BESIDE = "campaign"  # as `cpcal demo` leaves it


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that certify wrote.")],
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="CAMPAIGN", help="Folder of the campaign.", show_default="RUN/../campaign"),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="The page; replaced.", show_default="RUN/report.html"),
    ] = None,
) -> None:
    """Write the HTML page of a RUN again, from its result.json and the CAMPAIGN that was certified.

    One self-contained file: it loads nothing, runs nothing, and prints. A campaign other than the one that was
    certified is refused: the run has its SHA-256.
    """
    result = load_result(run)
    measured = load_campaign(beside(run) if campaign is None else campaign)
    file = run / REPORT_NAME if output is None else output
    if file.is_dir():
        raise InputError([Problem(str(file), "is a folder", "name a file, such as report.html")])
    check_writable(file.parent)
    try:
        write_page(measured, result, file)
    except OSError as error:
        raise unwritable(file.parent, error) from None
    terminal().print(f"Report: {file}", soft_wrap=True)


def beside(run: Path) -> Path:
    """The campaign next to a run, as `cpcal demo` leaves it."""
    folder = Path(os.path.abspath(run)).parent / _BESIDE
    if not (folder / "campaign.toml").is_file():
        what = f"there is no campaign beside it ({folder}), and the measurements are needed"
        raise InputError([Problem(str(run), what, "name the campaign that was certified with --campaign")])
    return folder
