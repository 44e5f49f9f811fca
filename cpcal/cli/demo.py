"""`cpcal demo`: the whole way, from a simulated robot to the page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_new
from cpcal.cli.run import Question, answer, publish
from cpcal.cli.status import status_of
from cpcal.robot import DELTALAB, load_campaign, save_campaign
from cpcal.robot import simulate as simulated

JOINT_ERROR = 1.0  # mm
FACTOR = 3.0  # half-width of the reading sets, in standard deviations


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the campaign and its run.")
    ] = Path("cpcal-demo"),
    seed: Annotated[int, typer.Option(help="Of the simulated robot and its readings.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Simulate a robot, certify every leg, write the report.

    The robot is the DeltaLab Table of Stewart with joints up to 1 mm off the model, the reading sets are 3
    standard deviations wide to each side. Writes DIR/campaign and, in DIR/run, the result, the page and certificates.
    """
    check_new(output, force=force)
    folder, run = output / "campaign", output / "run"
    save_campaign(simulated(DELTALAB, seed=seed, joint_error=JOINT_ERROR, factor=FACTOR), folder)
    campaign = load_campaign(folder)
    typer.echo(f"Campaign: {folder} (simulated, seed {seed}, joint error {JOINT_ERROR:g} mm, {FACTOR:g} sigma)")
    result = answer(campaign, Question(), run, quiet=False)
    publish(campaign, result, run, as_json=False)
    raise typer.Exit(status_of(result))
