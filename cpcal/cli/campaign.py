"""Where campaigns come from, and whether they are good enough: `cpcal robot`, `import`, `check`, `simulate`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from cpcal.cli.verbs import FORCE, Status, Talk, argument, check_new, option, options, output, refuse_options
from cpcal.common.errors import Problem, Problems, refuse, unusable
from cpcal.common.files import write_file
from cpcal.common.numbers import about, nearest
from cpcal.common.values import Json
from cpcal.files import load_campaign, save_campaign, save_study, settings_template
from cpcal.questions import check_data
from cpcal.questions.log import FRAME_NOTES, load_log
from cpcal.robot import ROBOTS, Campaign, known_robot, rotation_vector
from cpcal.robot.campaign import Given
from cpcal.robot.mistakes import mixed_up, spread_of
from cpcal.robot.robot import KINDS
from cpcal.robot.units import ANGLES, AXES, LENGTHS, column_map, leg_columns
from cpcal.simulate import simulate as simulate_campaign
from cpcal.simulate import simulate_study

# ------------------------------------------------------------------------------------------------------------------
# `cpcal robot`: the catalogue of robots, and a campaign.toml to fill in.


def robot(
    action: Literal["init", "list"] = argument("ACTION", "list: the robots that cpcal knows. init: a campaign.toml."),
    name: str | None = argument("[NAME]", "A known robot, or what your own is to be called.", None),
    file: Path = output("FILE", "The file for init, which must not be there yet.", Path("campaign.toml")),
    legs: int = option(6, "Legs of your own robot."),
) -> None:
    """List the robots with published dimensions, or write a commented campaign.toml to fill in for a robot.

    Example: `cpcal robot init deltalab -o table.toml`, or `cpcal robot init "our crane" --legs 8`
    """
    talk = Talk()
    if action == "list":
        talk.say(*(f"{key}: {one.robot.name}, {one.robot.legs} legs. {one.source}" for key, one in ROBOTS.items()))
        return
    if name is None:
        raise unusable("robot init", "lacks a name", "name a known robot, or your own")
    refuse((os.path.lexists(file), str(file), "is there already", "choose another file with -o, or remove it"))
    write_file(file, settings_template(name, legs))
    talk.say(f"{file}: replace every nan, then use it as --robot of `cpcal import`, or as it stands.")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal import`: the log of a tracker, a motion capture system or a robot controller becomes a campaign.

_PREVIEWED = 3  # rows


@options
class ImportFlags:
    """What a log does not say of itself."""

    robot: str = option(..., "A robot of `cpcal robot list`, or a campaign.toml (`cpcal robot init`).", "NAME|FILE")
    columns: str = option(
        "",
        'Which columns are which, with units: "x=Tx[m], r1=Rx, L1=#8". Not needed for columns with the names of '
        "measurements.csv.",
        "MAP",
        "--map",
    )
    rotation: str | None = option(
        None,
        "quaternion-wxyz, quaternion-xyzw, matrix, vector-rad, vector-deg, euler-xyz-deg (fixed axes), "
        "euler-ZYX-deg (turned axes), ... Columns: qw..qz, r11..r33, rx ry rz, or r1 r2 r3 in the order of the "
        "letters.",
        "FORM",
        show_default="told by the columns of quaternions and matrices",
    )
    frames: Literal["base", "tracker"] | None = option(
        None,
        "base: poses are of the mobile frame in the base frame. tracker: of a target in a tracker's frame, and both "
        "frames are fitted.",
        show_default="told by the drawing",
    )
    sigma: str | None = option(
        None,
        'Standard deviations: "position=0.05[mm], rotation=0.01[deg], length=0.02[mm]".',
        "SIGMAS",
        show_default="those of the campaign.toml",
    )
    factor: float = option(3.0, "Half-widths are this many standard deviations.")
    exact: bool = option(False, "Call all readings exact instead.")
    preview: bool = option(False, "Show what would be written, and write nothing.")
    anyway: bool = option(False, "Write also what looks mixed up.")
    force: bool = FORCE


def import_log(
    file: Path = argument("FILE", "The log: a table as text, in any usual form."),
    folder: Path = output("DIR", "Folder for the campaign."),
    *,
    options: ImportFlags,
) -> Status:
    """Make a campaign of a log: poses and leg readings in any units, rotation form and separators.

    The first rows, and how far the legs are off at the nominal parameters, are shown before anything is written;
    nothing is written when they look mixed up.
    """
    check_new(folder, force=options.force or options.preview)
    campaign = load_log(
        file,
        robot=options.robot,
        columns=options.columns,
        rotation=options.rotation,
        frames=options.frames,
        factor=options.factor,
        exact=options.exact,
        **_sigmas(options.sigma),
    )
    talk = Talk()
    mistake = _preview(talk, campaign)
    if mistake is not None and not options.anyway:
        talk.say("Nothing was written. Correct the options, or say --anyway.")
        return Status.UNKNOWN
    if options.preview:
        talk.say("Nothing was written, as --preview asks for.")
    else:
        save_campaign(campaign, folder)
        talk.say(f"{len(campaign):,} measurements in {folder}. Next: cpcal check {folder}")
    return Status.ANSWERED


def _sigmas(text: str | None) -> Json:
    """What --sigma says, by the argument of `load_log`, in mm and rad. Raises InputError."""
    problems, sigmas = Problems(), {}
    for kind, source in column_map(text or "", KINDS).items():
        units = {unit: float(size) for unit, size in (ANGLES if kind == "rotation" else LENGTHS).items()}
        if kind == "rotation" and source.unit is None:  # 57 times too wide a set hides any error
            problems.add(Problem("option --sigma", "rotation has no unit", f"write {kind}={source.name}[deg] or [rad]"))
            continue
        try:
            sigmas[f"{kind}_sigma"] = float(source.name) * units[source.unit or next(iter(units))]
        except (KeyError, ValueError):
            what = f"{kind} is {source.name!r:.40} in {source.unit}"
            problems.add(Problem("option --sigma", what, f"give a number and one of {', '.join(units)}"))
    problems.raise_any()
    return sigmas


def _preview(talk: Talk, campaign: Campaign) -> str | None:
    """Show what was estimated, the first rows, the residuals at the nominal parameters; what looks mixed up."""
    given = Given.of(campaign)
    talk.say(f"{campaign.title}: {len(campaign):,} measurements, {campaign.legs} legs")
    talk.say(f"Columns: {campaign.provenance['columns']} ({campaign.provenance['rotation_form']})")
    talk.say(*(campaign.provenance[name] for name in FRAME_NOTES if name in campaign.provenance))
    talk.say("First rows, in mm and degrees (rotation vector); off: largest |residual| of a leg, nominal, mm")
    shown, turn = min(campaign.legs, 6), np.degrees(rotation_vector(campaign.quaternion))
    table = np.column_stack([campaign.position, turn, campaign.length[:, :shown], given.off.max(axis=1)])
    numbered = zip(campaign.measurement_ids, table[:_PREVIEWED].tolist(), strict=False)
    rows = [(name, *(nearest(value, 2) for value in row)) for name, row in numbered]
    talk.table(("pose/run", *AXES, *leg_columns(shown), "off"), rows, left=())
    talk.say(_off(np.median(given.off, axis=0).tolist()))
    mistake = mixed_up(campaign, spread_of(campaign))
    if mistake is not None:
        talk.say(f"! {mistake}")
    return mistake


def _off(each: Sequence[float]) -> str:
    listed = ", ".join(about(value, 2) for value in each)
    return f"At the nominal parameters the legs are off by {listed} mm (median of each leg)."


# ------------------------------------------------------------------------------------------------------------------
# `cpcal check`: is the data good enough before a long run?


def check(campaign: Path = argument("CAMPAIGN", "Folder of campaign.toml, measurements.csv.")) -> Status:
    """Look for what is wrong with a CAMPAIGN before it is certified: units, orders, frames, odd rows, open parameters.

    Estimates in floating point: nothing is proved.
    """
    loaded, talk = load_campaign(campaign), Talk()
    found = check_data(loaded)
    talk.say(f"{loaded.title}: {len(loaded):,} measurements, {loaded.legs} legs")
    talk.say("Nothing looks wrong." if found.good else f"Look at this first ({len(found.findings)}):")
    talk.say(*(f"! {finding}" for finding in found.findings))
    left = f"Residuals of a fit: {', '.join(about(float(value), 2) for value in found.spread.left)} mm"
    if (ratio := found.spread.ratio) is not None:
        left += f", which is {', '.join(about(float(value), 2) for value in ratio)} times what you state"
    talk.say(_off(found.nominal), f"{left}.")
    if not found.good:
        return Status.UNKNOWN
    talk.say("Next: cpcal certify CAMPAIGN -o RUN")
    return Status.ANSWERED


# ------------------------------------------------------------------------------------------------------------------
# `cpcal simulate`. None: not given; what is simulated has its own default.

_OF_CAMPAIGNS = ("extremal", "factor")
_OF_STUDIES = ("validation_runs", "images", "render", "axis_offset", "backlash", "sag", "gain")


_study = partial(option, panel="Study: the paper's experiment (--study)")
_leg = partial(option, panel="Imperfect legs (--study): what seven parameters a leg leave out; 0: perfect")


@options
class SimulateFlags:
    """The arguments of `cpcal.simulate` and `cpcal.simulate_study`."""

    seed: int = option(1, "The same seed gives the same files, with the same cpcal, numpy and kind of processor.")
    runs: int | None = option(None, "Measurements of each configuration [default: 1; of a study: 11]")
    random_poses: int | None = option(
        None, "Random configurations, on top of the extremal ones [default: 0], or to validate a study [64]"
    )
    joint_error: float = option(0.0, "Amplitude of an error that 7 parameters a leg cannot describe.", "MM")
    noise: float = option(1.0, "Scale of the paper's standard deviations.")
    deviation: float = option(1.0, "Standard deviation of true parameters from nominal ones.", "MM")
    extremal: bool | None = option(None, "Whether to take the 64 extremal configurations.", "--extremal/--no-extremal")
    factor: float | None = option(
        None, "Half-width of the reading sets in standard deviations; 0: exact readings [default: 3]"
    )
    study: bool = _study(False, "A study: a target seen by a camera, both frames unknown.")
    validation_runs: int | None = _study(None, "Runs of each random configuration [default: 10]")
    images: int | None = _study(None, "Rows of single images in each run [default: one row, the mean of 10]")
    render: bool | None = _study(
        None,
        "Write images instead of poses, for `cpcal image detect`, with target, camera and leg readings.",
        "--render",
    )
    axis_offset: float | None = _leg(None, "Distance of the two axes of each lower joint.", "MM")
    backlash: float | None = _leg(None, "Clearance along each leg; its side follows the load.", "MM")
    sag: float | None = _leg(None, "Shortening of a leg lying flat, by its weight.", "MM")
    gain: float | None = _leg(None, "Relative error of each length sensor, about mid-stroke.", "REL")


def simulate(
    robot: str = argument("ROBOT", f"One of: {', '.join(ROBOTS)}."),
    folder: Path = output("DIR", "Folder for what is simulated."),
    force: bool = FORCE,
    *,
    options: SimulateFlags,
) -> None:
    """Write a simulated campaign of ROBOT: extremal and random poses, with the paper's noise. Or a --study.

    `cpcal robot list` says where the dimensions of each ROBOT are published.
    """
    given = {name: value for name, value in asdict(options).items() if value is not None}
    if given.pop("study"):
        refuse_options(_OF_CAMPAIGNS, given, "with --study")
    else:
        refuse_options(_OF_STUDIES, given, "without --study", "add --study, or leave it out")
    check_new(folder, force=force)
    nominal = known_robot(robot)
    if not options.study:
        space = nominal.workspace
        given |= {"stroke": nominal.stroke} if space is None else {"workspace": space}
        campaign = simulate_campaign(nominal.robot, **given)
        save_campaign(campaign, folder)
        rows = f"{len(campaign):,} measurements"
    else:
        given["stroke"], kind = nominal.stroke, "rows"
        if given.pop("render", False):
            from cpcal.cli.image import write_shots  # the other verbs here start sooner without

            study, kind = write_shots(nominal.robot, given, folder), "images"
        else:
            study = simulate_study(nominal.robot, **given)
            save_study(study, folder)
        rows = f"{len(study.calibration):,} {kind} for calibration, {len(study.validation):,} for validation"
    Talk().say(f"{nominal.robot.name}: {rows} (seed {options.seed}) in {folder}")
