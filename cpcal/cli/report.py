"""`cpcal report`: the page of a run, written again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from cpcal.atomic import write_file
from cpcal.cli.folders import CAMPAIGN, check_writable
from cpcal.cli.show import terminal
from cpcal.cli.study_page import holds_study, study_found
from cpcal.errors import InputError, Problem
from cpcal.files import load_campaign
from cpcal.report import REPORT_NAME
from cpcal.report.page import render
from cpcal.report.study import render_study
from cpcal.results import load_result


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that certify wrote, or demo.")],
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
    certified is refused: the run has its SHA-256. Of a folder that `cpcal demo` wrote it is the page of the whole
    study; its certificates are checked anew.
    """
    file = run / REPORT_NAME if output is None else output
    if file.is_dir():
        raise InputError([Problem(str(file), "is a folder", "name a file, such as report.html")])
    check_writable(file.parent)
    page = _study(run, campaign) if holds_study(run) else _run(run, campaign)
    write_file(file, page)
    terminal().print(f"Report: {file}", soft_wrap=True)


def _run(run: Path, campaign: Path | None) -> str:
    result = load_result(run)
    return render(load_campaign(beside(run) if campaign is None else campaign), result)


def _study(folder: Path, campaign: Path | None) -> str:
    if campaign is not None:
        raise InputError(
            [Problem("option --campaign", "has no meaning for a study, which holds its own", "leave it out")]
        )
    return render_study(study_found(folder)[1])


def beside(run: Path) -> Path:
    """The campaign next to a run, as `cpcal demo` leaves it."""
    folder = Path(os.path.abspath(run)).parent / CAMPAIGN
    if not (folder / "campaign.toml").is_file():
        what = f"there is no campaign beside it ({folder}), and the measurements are needed"
        raise InputError([Problem(str(run), what, "name the campaign that was certified with --campaign")])
    return folder
