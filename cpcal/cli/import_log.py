"""`cpcal import`: the log of a tracker, a motion capture system or a robot controller becomes a campaign."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cpcal.cli.folders import check_new, output_path
from cpcal.cli.grouped import grouped
from cpcal.cli.status import Status
from cpcal.cli.terminal import terminal
from cpcal.common.errors import InputError, Problem, Problems, printable
from cpcal.common.numbers import about, nearest
from cpcal.files import LogSettings, campaign_of_log, load_settings, read_log, save_campaign
from cpcal.questions.data_check import mistake_in
from cpcal.robot import ROBOTS, Campaign, Uncertainty, known_robot, rotation_vector
from cpcal.robot.campaign import Given, stated_uncertainty
from cpcal.robot.robot import EXACT_OR_NOT, KINDS
from cpcal.robot.units import ANGLES, LENGTHS, column_map

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
