"""`cpcal simulate`: a campaign as a sensor would deliver it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpcal import robot as stations
from cpcal.cli.folders import check_new
from cpcal.report import clean


def simulate(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help=f"One of: {', '.join(stations.ROBOTS)}.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the campaign.")],
    seed: Annotated[int, typer.Option(help="The same seed gives the same campaign, bit for bit.")] = 1,
    runs: Annotated[int, typer.Option(help="Measurements of each configuration.")] = 1,
    random_poses: Annotated[int, typer.Option(help="Random configurations on top of the extremal ones.")] = 0,
    extremal: Annotated[bool, typer.Option(help="Whether to take the 64 extremal configurations.")] = True,
    joint_error: Annotated[
        float,
        typer.Option(metavar="MM", help="Amplitude of an error that 7 parameters a leg cannot describe."),
    ] = 0.0,
    factor: Annotated[
        float, typer.Option(help="Half-width of the reading sets in standard deviations; 0: exact readings.")
    ] = 3.0,
    noise: Annotated[float, typer.Option(help="Scale of the paper's standard deviations.")] = 1.0,
    truncate: Annotated[
        float | None, typer.Option(help="Draw noise beyond this many standard deviations again.")
    ] = None,
    deviation: Annotated[
        float, typer.Option(metavar="MM", help="Standard deviation of true parameters from nominal ones.")
    ] = 1.0,
    stroke: Annotated[
        tuple[float, float], typer.Option(metavar="SHORT LONG", help="Shortest and longest reading, mm.")
    ] = (0.0, 140.0),
    force: Annotated[bool, typer.Option("--force", help="Replace the campaign in a folder that is not empty.")] = False,
) -> None:
    """Write a simulated campaign of ROBOT: extremal and random poses, with the paper's noise."""
    check_new(output, force=force)
    campaign = stations.simulate(
        stations.known_robot(robot),
        seed=seed,
        runs=runs,
        random_poses=random_poses,
        extremal=extremal,
        joint_error=joint_error,
        factor=factor,
        noise=noise,
        truncate=truncate,
        deviation=deviation,
        stroke=stroke,
    )
    stations.save_campaign(campaign, output)
    typer.echo(f"{clean(campaign.robot.name)}: {len(campaign):,} measurements (seed {seed}) in {output}")
