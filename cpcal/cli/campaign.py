"""Where campaigns come from, and whether they are good enough: `cpcal robot`, `import`, `check`, `simulate`."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cpcal.cli.options import Status, check_new, grouped, output_path, terminal, unwritable
from cpcal.cli.progress import bar
from cpcal.common.errors import InputError, Problem, Problems, printable
from cpcal.common.files import write_file
from cpcal.common.numbers import about, nearest
from cpcal.files import (
    LogSettings,
    campaign_of_log,
    load_campaign,
    load_settings,
    read_log,
    save_campaign,
    save_study,
    settings_template,
)
from cpcal.files.settings import STUDY_NAME, study_bytes
from cpcal.legs import PLAIN
from cpcal.questions.data_check import DataCheck, check_data, expected, mistake_in
from cpcal.robot import ROBOTS, Campaign, KnownRobot, Robot, Study, Uncertainty, known_robot, rotation_vector
from cpcal.robot.campaign import Given, stated_uncertainty
from cpcal.robot.robot import EXACT_OR_NOT, KINDS
from cpcal.robot.units import ANGLES, LENGTHS, column_map
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
# `cpcal robot`: the catalogue of robots, and a campaign.toml to fill in.


class Action(StrEnum):
    INIT = "init"
    LIST = "list"


def robot(
    action: Annotated[Action, typer.Argument(help="list: the robots that cpcal knows. init: a campaign.toml.")],
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A known robot, or what your own is to be called.")
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="The file for init, which must not be there yet.")
    ] = Path("campaign.toml"),
    legs: Annotated[int, typer.Option(help="Legs of your own robot.")] = 6,
) -> None:
    """List the robots with published dimensions, or write a commented campaign.toml to fill in for a robot.

    Example: `cpcal robot init deltalab -o table.toml`, or `cpcal robot init "our crane" --legs 8`
    """
    if action is Action.LIST:
        for key, known in ROBOTS.items():
            typer.echo(printable(f"{key}: {known.robot.name}, {known.robot.legs} legs. {known.source}"))
        return
    if name is None:
        raise InputError([Problem("robot init", "lacks a name", "name a known robot, or your own")])
    if os.path.lexists(output):
        raise InputError([Problem(str(output), "is there already", "choose another file with -o, or remove it")])
    text = settings_template(name, legs)
    write_file(output, text)
    typer.echo(printable(f"{output}: replace every nan, then use it as --robot of `cpcal import`, or as it stands."))


# ------------------------------------------------------------------------------------------------------------------
# `cpcal import`: the log of a tracker, a motion capture system or a robot controller becomes a campaign.

_PREVIEWED = 3  # rows


@dataclass(frozen=True)
class ImportFlags:
    """What a log does not say of itself."""

    robot: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE", help="A robot of `cpcal robot list`, or a campaign.toml (`cpcal robot init`)."
        ),
    ]
    columns: Annotated[
        str,
        typer.Option(
            "--map",
            metavar="MAP",
            help='Which columns are which, with units: "x=Tx[m], r1=Rx, L1=#8". Not needed for columns with the names '
            "of measurements.csv.",
        ),
    ] = ""
    rotation: Annotated[
        str,
        typer.Option(
            metavar="FORM",
            help="quaternion-wxyz, quaternion-xyzw, matrix, vector-rad, vector-deg, euler-xyz-deg (fixed axes), "
            "euler-ZYX-deg (turned axes), ... Columns: qw..qz, r11..r33, rx ry rz, or r1 r2 r3 in the order of the "
            "letters.",
        ),
    ] = "quaternion-wxyz"
    sigma: Annotated[
        str | None,
        typer.Option(
            metavar="SIGMAS",
            help='Standard deviations: "position=0.05[mm], rotation=0.01[deg], length=0.02[mm]".',
            show_default="those of the campaign.toml",
        ),
    ] = None
    factor: Annotated[float, typer.Option(help="Half-widths are this many standard deviations.")] = 3.0
    exact: Annotated[bool, typer.Option("--exact", help="Call all readings exact instead.")] = False
    separator: Annotated[
        str | None, typer.Option(metavar="NAME", help="comma, semicolon, tab or blank.", show_default="guessed")
    ] = None
    decimal: Annotated[str | None, typer.Option(metavar="NAME", help="point or comma.", show_default="guessed")] = None
    header: Annotated[
        int | None, typer.Option(metavar="LINE", help="The line that names the columns.", show_default="guessed")
    ] = None
    preview: Annotated[bool, typer.Option("--preview", help="Show what would be written, and write nothing.")] = False
    anyway: Annotated[bool, typer.Option("--anyway", help="Write also what looks mixed up.")] = False
    force: Annotated[bool, typer.Option("--force", help="Replace what is in a folder that is not empty.")] = False


@grouped(ImportFlags)
def import_log(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The log: a table as text, in any usual form.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", parser=output_path, help="Folder for the campaign.")
    ],
    options: ImportFlags,
) -> None:
    """Make a campaign of a log: poses and leg readings in any units, rotation form and separators.

    The first rows, and how far the legs are off at the nominal parameters, are shown before anything is written;
    nothing is written when they look mixed up.
    """
    check_new(output, force=options.force or options.preview)
    log = read_log(file, separator=options.separator, decimal=options.decimal, header=options.header)
    campaign = campaign_of_log(log, _settings(options))
    console = terminal()
    mistake = _preview(console, campaign)
    wrap = not console.is_terminal
    if mistake is not None and not options.anyway:
        console.print("Nothing was written. Correct the options, or say --anyway.", soft_wrap=wrap)
        raise typer.Exit(Status.UNKNOWN)
    if options.preview:
        console.print("Nothing was written, as --preview asks for.", soft_wrap=wrap)
        return
    save_campaign(campaign, output)
    console.print(f"{len(campaign):,} measurements in {output}. Next: cpcal check {output}", soft_wrap=wrap)


def _settings(options: ImportFlags) -> LogSettings:
    """The robot, and how far readings may be off: what the options say counts before what a campaign.toml says."""
    if options.exact and options.sigma is not None:
        raise InputError([Problem("option --sigma", "is given, and readings are called exact", "give one of the two")])
    if Path(options.robot).exists():
        read = load_settings(options.robot)
        assert read.robot is not None  # what keeps it from being read was raised
        base = LogSettings(read.robot, read.uncertainty, options.columns, options.rotation, read.provenance, read.model)
    else:
        if options.robot.casefold() not in ROBOTS and ("." in options.robot or "/" in options.robot):
            raise InputError([Problem(options.robot, "does not exist", "make it with `cpcal robot init`")])
        robot = known_robot(options.robot).robot
        base = LogSettings(robot, None, options.columns, options.rotation, {})
        if not options.exact and options.sigma is None:
            remedy = f"give --sigma or --exact; or a campaign.toml as --robot: {EXACT_OR_NOT}"
            raise InputError([Problem("uncertainty", "is not stated", remedy)])
    if options.exact:
        return replace(base, uncertainty=None)
    return base if options.sigma is None else replace(base, uncertainty=_uncertainty(base.robot.legs, options))


def _uncertainty(legs: int, options: ImportFlags) -> Uncertainty | None:
    """What --sigma says. Raises InputError."""
    problems = Problems()
    sigmas: dict[str, float | None] = dict.fromkeys(KINDS)
    for kind, source in column_map(options.sigma or "", KINDS).items():
        units: dict[str, float] = dict(ANGLES) if kind == "rotation" else {k: float(v) for k, v in LENGTHS.items()}
        if kind == "rotation" and source.unit is None:  # 57 times too wide a set hides any error
            problems.add(Problem("option --sigma", "rotation has no unit", f"write {kind}={source.name}[deg] or [rad]"))
            continue
        try:
            sigmas[kind] = float(source.name) * units[source.unit or next(iter(units))]
        except (KeyError, ValueError):
            what = f"{kind} is {source.name!r:.40} in {source.unit}"
            problems.add(Problem("option --sigma", what, f"give a number and one of {', '.join(units)}"))
    problems.raise_any()
    return stated_uncertainty(legs, sigmas, options.factor, None)


def _preview(console: Console, campaign: Campaign) -> str | None:
    """Show the first rows and the residuals at the nominal parameters; the sentence on what looks mixed up."""
    given = Given.of(campaign)
    wrap = not console.is_terminal
    console.print(printable(f"{campaign.robot.name}: {len(campaign):,} measurements, {campaign.legs} legs"))
    console.print("First rows, in mm and degrees (rotation vector); off: largest |residual| of a leg, nominal, mm")
    console.print(_rows(campaign, given))
    off = np.median(given.share * given.nominal, axis=0)
    listed = ", ".join(about(float(value), 2) for value in off)
    console.print(f"At the nominal parameters the legs are off by {listed} mm (median of each leg).", soft_wrap=wrap)
    mistake = mistake_in(given, given.typical)
    if mistake is not None:
        console.print(f"! {mistake}", soft_wrap=wrap)
    return mistake


def _rows(campaign: Campaign, given: Given) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    shown = min(campaign.legs, 6)
    legs = [f"L{i}" for i in range(1, shown + 1)]
    for name in ("pose/run", "x", "y", "z", "rx", "ry", "rz", *legs, "off"):
        table.add_column(name, justify="right")
    degrees = np.degrees(rotation_vector(campaign.quaternion[:_PREVIEWED]))
    off = (given.share[:_PREVIEWED] * given.nominal[:_PREVIEWED]).max(axis=1)
    for row, name in enumerate(campaign.measurement_ids[:_PREVIEWED]):
        numbers = [*campaign.position[row], *degrees[row], *campaign.length[row, :shown], off[row]]
        table.add_row(name, *(nearest(float(value), 2) for value in numbers))
    return table


# ------------------------------------------------------------------------------------------------------------------
# `cpcal check`: is the data good enough before a long run?


def check(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
) -> None:
    """Look for what is wrong with a CAMPAIGN before it is certified: units, orders, frames, odd rows, open parameters.

    Says what each leg's parameters can be expected to be known to. Estimates in floating point: nothing is proved.
    """
    loaded = load_campaign(campaign)
    found = check_data(loaded)
    show_check(terminal(), loaded, found)
    raise typer.Exit(Status.ANSWERED if found.good else Status.UNKNOWN)


def show_check(console: Console, campaign: Campaign, found: DataCheck) -> None:
    """The table of legs, and a line for each finding."""
    wrap = not console.is_terminal
    console.print(printable(f"{campaign.robot.name}: {len(campaign):,} measurements, {campaign.legs} legs"))
    off = ", ".join(about(value, 2) for value in found.nominal)
    console.print(f"At the nominal parameters the legs are off by {off} mm (median of each leg).", soft_wrap=wrap)
    if found.legs:
        console.print(_table(found))
        console.print(f"Expected: {_meaning(campaign)}", soft_wrap=wrap)
    for finding in found.findings:
        console.print(f"! {finding.sentence}", soft_wrap=wrap)
    if found.good:
        console.print("Nothing looks wrong. Next: cpcal certify CAMPAIGN -o RUN", soft_wrap=wrap)


def _meaning(campaign: Campaign) -> str:
    if campaign.exact:
        return "readings are called exact, so only the model error leaves parameters a range."
    return "mm, by how far the reading sets leave each parameter open if the model is right; runs come out narrower."


def _table(found: DataCheck) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("leg", "rank", "condition", "index O1", *PLAIN.parameters):
        table.add_column(name, justify="right")
    for leg in found.legs:
        rank = f"{leg.determination.rank} of {leg.determination.of}"
        table.add_row(str(leg.leg), rank, about(leg.condition, 2), about(leg.index, 2), *expected(leg))
    return table


# ------------------------------------------------------------------------------------------------------------------
# `cpcal simulate`: a campaign, or a whole study, as sensors would deliver it.

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
