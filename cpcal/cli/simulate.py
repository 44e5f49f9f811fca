"""`cpcal simulate`: a campaign, or a whole study, as sensors would deliver it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_new
from cpcal.cli.shots import shot_study, write_shots
from cpcal.errors import InputError, Problem, printable
from cpcal.files import save_campaign, save_study
from cpcal.robot import ROBOTS, known_robot
from cpcal.simulate import simulate as simulate_campaign
from cpcal.simulate import simulate_study

_STUDY = "Study: the paper's experiment (--study)"
_LEGS = "Imperfect legs (--study): what seven parameters a leg leave out; 0: perfect"


def simulate(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help=f"One of: {', '.join(ROBOTS)}.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for what is simulated.")],
    seed: Annotated[int, typer.Option(help="The same seed gives the same files, byte for byte.")] = 1,
    runs: Annotated[
        int | None, typer.Option(help="Measurements of each configuration [default: 1; of a study: 11]")
    ] = None,
    random_poses: Annotated[
        int | None,
        typer.Option(
            help="Random configurations, on top of the extremal ones [default: 0], or to validate a study [64]"
        ),
    ] = None,
    extremal: Annotated[
        bool | None, typer.Option("--extremal/--no-extremal", help="Whether to take the 64 extremal configurations.")
    ] = None,
    joint_error: Annotated[
        float,
        typer.Option(metavar="MM", help="Amplitude of an error that 7 parameters a leg cannot describe."),
    ] = 0.0,
    factor: Annotated[
        float | None,
        typer.Option(help="Half-width of the reading sets in standard deviations; 0: exact readings [default: 3]"),
    ] = None,
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
    force: Annotated[bool, typer.Option("--force", help="Replace what is in a folder that is not empty.")] = False,
    study: Annotated[
        bool,
        typer.Option(
            "--study", help="A study: a target seen by a camera, both frames unknown.", rich_help_panel=_STUDY
        ),
    ] = False,
    validation_runs: Annotated[
        int | None, typer.Option(help="Runs of each random configuration [default: 10]", rich_help_panel=_STUDY)
    ] = None,
    images: Annotated[
        int | None,
        typer.Option(
            help="Rows of single images in each run [default: one row, the mean of 10]", rich_help_panel=_STUDY
        ),
    ] = None,
    render: Annotated[
        bool,
        typer.Option(
            "--render",
            help="Write images instead of poses, for `cpcal detect`, with target.toml, camera.toml and leg readings.",
            rich_help_panel=_STUDY,
        ),
    ] = False,
    axis_offset: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Distance of the two axes of each lower joint.", rich_help_panel=_LEGS),
    ] = None,
    joint_offset: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Offsets of the three axes of each upper joint.", rich_help_panel=_LEGS),
    ] = None,
    backlash: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Clearance along each leg; its side follows the load.", rich_help_panel=_LEGS),
    ] = None,
    friction: Annotated[
        float | None,
        typer.Option(
            metavar="WEIGHTS",
            help="By how many platform weights the direction of approach, random in each run, shifts the load that "
            "decides the side of the backlash [default: 0.2]",
            rich_help_panel=_LEGS,
        ),
    ] = None,
    sag: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Shortening of a leg lying flat, by its weight.", rich_help_panel=_LEGS),
    ] = None,
    gain: Annotated[
        float | None,
        typer.Option(
            metavar="REL", help="Relative error of each length sensor, about mid-stroke.", rich_help_panel=_LEGS
        ),
    ] = None,
) -> None:
    """Write a simulated campaign of ROBOT: extremal and random poses, with the paper's noise. Or a --study."""
    only_campaign: dict[str, object] = {"extremal": extremal, "factor": factor}
    only_study: dict[str, object] = {
        "validation_runs": validation_runs,
        "images": images,
        "render": render or None,
        "axis_offset": axis_offset,
        "joint_offset": joint_offset,
        "backlash": backlash,
        "friction": friction,
        "sag": sag,
        "gain": gain,
    }
    _refuse(only_campaign if study else only_study, study=study)
    check_new(output, force=force)
    nominal = known_robot(robot)
    given = {"runs": runs, "random_poses": random_poses, **(only_study if study else only_campaign)}
    common = {
        "seed": seed,
        "joint_error": joint_error,
        "noise": noise,
        "truncate": truncate,
        "deviation": deviation,
        "stroke": stroke,
    }
    options = common | {name: value for name, value in given.items() if value is not None}
    if render:
        del options["render"]
        whole, shots = shot_study(nominal, options)
        write_shots(whole, shots, output)
        rows = f"{len(whole.calibration):,} images for calibration, {len(whole.validation):,} for validation"
    elif study:
        whole = simulate_study(nominal, **options)  # type: ignore[arg-type]
        save_study(whole, output)
        rows = f"{len(whole.calibration):,} rows for calibration, {len(whole.validation):,} for validation"
    else:
        campaign = simulate_campaign(nominal, **options)  # type: ignore[arg-type]
        save_campaign(campaign, output)
        rows = f"{len(campaign):,} measurements"
    typer.echo(printable(f"{nominal.name}: {rows} (seed {seed}) in {output}"))


def _refuse(options: dict[str, object], *, study: bool) -> None:
    """InputError for each option that was given and belongs to the other kind of simulation."""
    where, remedy = ("with --study", "leave it out") if study else ("without --study", "add --study, or leave it out")
    problems = [
        Problem(f"option --{name.replace('_', '-')}", f"has no meaning {where}", remedy)
        for name, value in options.items()
        if value is not None
    ]
    if problems:
        raise InputError(problems)
