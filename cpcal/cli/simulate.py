"""`cpcal simulate`: a campaign, or a whole study, as sensors would deliver it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import typer

from cpcal.cli.folders import check_new, unwritable
from cpcal.cli.grouped import grouped
from cpcal.cli.progress import bar
from cpcal.common.errors import InputError, Problem, printable
from cpcal.files import save_campaign, save_study
from cpcal.files.settings import STUDY_NAME, study_bytes
from cpcal.robot import ROBOTS, KnownRobot, Robot, Study, known_robot
from cpcal.simulate import simulate as simulate_campaign
from cpcal.simulate import simulate_study
from cpcal.vision.batch.study_images import RenderedImages, camera_above
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.detection import readings_bytes, readings_of
from cpcal.vision.files.plate_and_camera import save_camera, save_target
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene
from cpcal.vision.target import DELTALAB_TARGET

# ------------------------------------------------------------------------------------------------------------------
# `cpcal simulate --study --render`: what an engineer would bring home: images, leg readings, target and camera.

SCENE = Scene(gradient=(0.25, 0.15))
IMAGES = "images"
TARGET_NAME, CAMERA_NAME = "target.toml", "camera.toml"
TABLES = ("calibration", "validation")


def shot_study(nominal: Robot, options: dict[str, Any]) -> tuple[Study, dict[str, RenderedImages]]:
    """A study with exact poses, and for both of its tables the images of them. Raises MissingExtraError."""
    opencv()  # or nothing is begun
    seed = options["seed"]
    exact = {"images": 1, **options, "pose_noise": 0.0, "camera": camera_above(seed=seed)}
    study = simulate_study(nominal, **exact)
    tables = zip(TABLES, (study.calibration, study.validation), strict=True)
    return study, {
        name: RenderedImages.of(table, DELTALAB_TARGET, DELTALAB_CAMERA, SCENE, seed=seed) for name, table in tables
    }


def write_shots(study: Study, images: dict[str, RenderedImages], folder: Path) -> None:
    """The study without its tables of poses: `cpcal detect` makes them. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in zip(TABLES, (study.calibration, study.validation), strict=True):
            with bar(f"{name}: rendering") as progress:
                images[name].write(folder / IMAGES / name, progress=progress)
            (folder / f"{name}-readings.csv").write_bytes(readings_bytes(readings_of(table)))
        save_target(DELTALAB_TARGET, folder / TARGET_NAME)
        save_camera(DELTALAB_CAMERA, folder / CAMERA_NAME)
        (folder / STUDY_NAME).write_bytes(study_bytes(study))
    except OSError as error:
        raise unwritable(folder, error) from None


# ------------------------------------------------------------------------------------------------------------------
# The options of `cpcal simulate`, by what they belong to. None: not given; what is simulated has its own default.

_STUDY = "Study: the paper's experiment (--study)"
_LEGS = "Imperfect legs (--study): what seven parameters a leg leave out; 0: perfect"


def _study_flag(metavar: str | None = None, *names: str, help: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=_STUDY)


def _leg(metavar: str, help: str) -> Any:
    return typer.Option(metavar=metavar, help=help, rich_help_panel=_LEGS)


@dataclass(frozen=True)
class CommonFlags:
    """Of campaigns and studies."""

    seed: Annotated[
        int,
        typer.Option(help="The same seed gives the same files, with the same cpcal, numpy and kind of processor."),
    ] = 1
    runs: Annotated[
        int | None, typer.Option(help="Measurements of each configuration [default: 1; of a study: 11]")
    ] = None
    random_poses: Annotated[
        int | None,
        typer.Option(
            help="Random configurations, on top of the extremal ones [default: 0], or to validate a study [64]"
        ),
    ] = None
    joint_error: Annotated[
        float, typer.Option(metavar="MM", help="Amplitude of an error that 7 parameters a leg cannot describe.")
    ] = 0.0
    noise: Annotated[float, typer.Option(help="Scale of the paper's standard deviations.")] = 1.0
    truncate: Annotated[float | None, typer.Option(help="Draw noise beyond this many standard deviations again.")] = (
        None
    )
    deviation: Annotated[
        float, typer.Option(metavar="MM", help="Standard deviation of true parameters from nominal ones.")
    ] = 1.0
    stroke: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="SHORT LONG", help="Shortest and longest reading, mm.", show_default="the robot's"),
    ] = None


@dataclass(frozen=True)
class CampaignFlags:
    """Without --study."""

    extremal: Annotated[
        bool | None, typer.Option("--extremal/--no-extremal", help="Whether to take the 64 extremal configurations.")
    ] = None
    factor: Annotated[
        float | None,
        typer.Option(help="Half-width of the reading sets in standard deviations; 0: exact readings [default: 3]"),
    ] = None


@dataclass(frozen=True)
class StudyFlags:
    """With --study."""

    validation_runs: Annotated[int | None, _study_flag(help="Runs of each random configuration [default: 10]")] = None
    images: Annotated[
        int | None, _study_flag(help="Rows of single images in each run [default: one row, the mean of 10]")
    ] = None
    render: Annotated[
        bool | None,
        _study_flag(
            None,
            "--render",
            help="Write images instead of poses, for `cpcal detect`, with target.toml, camera.toml and leg readings.",
        ),
    ] = None


@dataclass(frozen=True)
class LegFlags:
    """With --study: what is imperfect about the legs."""

    axis_offset: Annotated[float | None, _leg("MM", "Distance of the two axes of each lower joint.")] = None
    joint_offset: Annotated[float | None, _leg("MM", "Offsets of the three axes of each upper joint.")] = None
    backlash: Annotated[float | None, _leg("MM", "Clearance along each leg; its side follows the load.")] = None
    friction: Annotated[
        float | None,
        _leg(
            "WEIGHTS",
            "By how many platform weights the direction of approach, random in each run, shifts the load that "
            "decides the side of the backlash [default: 0.2]",
        ),
    ] = None
    sag: Annotated[float | None, _leg("MM", "Shortening of a leg lying flat, by its weight.")] = None
    gain: Annotated[float | None, _leg("REL", "Relative error of each length sensor, about mid-stroke.")] = None


@dataclass(frozen=True)
class SimulateFlags(LegFlags, StudyFlags, CampaignFlags, CommonFlags):
    """All of them."""

    study: Annotated[
        bool, _study_flag(None, "--study", help="A study: a target seen by a camera, both frames unknown.")
    ] = False
    force: Annotated[bool, typer.Option("--force", help="Replace what is in a folder that is not empty.")] = False

    def given(self, *kinds: type[Any]) -> dict[str, Any]:
        """The options of these kinds that have a value."""
        names = (field.name for kind in kinds for field in fields(kind))
        return {name: value for name in names if (value := getattr(self, name)) is not None}


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
