"""`cpcal simulate`: a campaign, or a whole study, as sensors would deliver it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cpcal.cli.folders import check_new
from cpcal.cli.grouped import grouped
from cpcal.cli.shots import shot_study, write_shots
from cpcal.cli.simulate_flags import CampaignFlags, CommonFlags, LegFlags, SimulateFlags, StudyFlags
from cpcal.common.errors import InputError, Problem, printable
from cpcal.files import save_campaign, save_study
from cpcal.robot import ROBOTS, KnownRobot, known_robot
from cpcal.simulate import simulate as simulate_campaign
from cpcal.simulate import simulate_study


@grouped(SimulateFlags)
def simulate(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help=f"One of: {', '.join(ROBOTS)}.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for what is simulated.")],
    options: SimulateFlags,
) -> None:
    """Write a simulated campaign of ROBOT: extremal and random poses, with the paper's noise. Or a --study.

    `cpcal robot list` says where the dimensions of each ROBOT are published.
    """
    _check(options)
    check_new(output, force=options.force)
    nominal = known_robot(robot)
    rows = _study(nominal, output, options) if options.study else _campaign(nominal, output, options)
    typer.echo(printable(f"{nominal.robot.name}: {rows} (seed {options.seed}) in {output}"))


def _campaign(nominal: KnownRobot, output: Path, options: SimulateFlags) -> str:
    """Write a campaign; how many rows it has, in words."""
    given = _range(nominal, options) | options.given(CommonFlags, CampaignFlags)
    campaign = simulate_campaign(nominal.robot, **given)
    save_campaign(campaign, output)
    return f"{len(campaign):,} measurements"


def _range(nominal: KnownRobot, options: SimulateFlags) -> dict[str, Any]:
    """Where the robot is measured. Raises InputError for a stroke where poses are what is chosen."""
    if nominal.workspace is None:
        return {"stroke": nominal.stroke}
    if options.stroke is not None:
        what = f"has no meaning for {nominal.robot.name}, which is measured all over a box of poses"
        raise InputError([Problem("option --stroke", what, "leave it out")])
    return {"workspace": nominal.workspace}


def _study(nominal: KnownRobot, output: Path, options: SimulateFlags) -> str:
    """Write a study, or images of one."""
    given = {"stroke": nominal.stroke} | options.given(CommonFlags, StudyFlags, LegFlags)
    if given.pop("render", False):
        study, shots = shot_study(nominal.robot, given)
        write_shots(study, shots, output)
        kind = "images"
    else:
        study = simulate_study(nominal.robot, **given)
        save_study(study, output)
        kind = "rows"
    return f"{len(study.calibration):,} {kind} for calibration, {len(study.validation):,} for validation"


def _check(options: SimulateFlags) -> None:
    """InputError for each option that was given and belongs to the other kind of simulation."""
    kinds: tuple[type[object], ...] = (CampaignFlags,) if options.study else (StudyFlags, LegFlags)
    where, remedy = (
        ("with --study", "leave it out") if options.study else ("without --study", "add --study, or leave it out")
    )
    problems = [
        Problem(f"option --{name.replace('_', '-')}", f"has no meaning {where}", remedy)
        for name in options.given(*kinds)
    ]
    if problems:
        raise InputError(problems)
