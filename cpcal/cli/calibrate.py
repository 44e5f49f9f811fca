"""`cpcal calibrate`: the classical calibration of a study, in tables and files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from cpcal.calibration import (
    RECORD_NAME,
    CalibrationRecord,
    Inputs,
    StudyCalibration,
    budget,
    calibrate_study,
    save_record,
)
from cpcal.cli.certify import warn
from cpcal.cli.options import CAMPAIGN, VALIDATION, Talk, check_writable, output
from cpcal.cli.sections import show_table
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import unwritable
from cpcal.files import load_study, save_campaign
from cpcal.report import study_page
from cpcal.report.study_page import summary

# ------------------------------------------------------------------------------------------------------------------
# The options of an uncertainty budget: what all readings share and no repeat shows.

_PANEL = "Uncertainty budget (GUM): standard uncertainties of what all readings share"


def _input(metavar: str, help: str) -> Any:
    return typer.Option(metavar=metavar, help=help, rich_help_panel=_PANEL)


@dataclass(frozen=True)
class BudgetFlags:
    """Left out: not stated. The budget is made where any is given."""

    camera_scale: Annotated[
        float | None, _input("REL", "Of the distances that the camera gives (focal length), relative.")
    ] = None
    target_scale: Annotated[float | None, _input("REL", "Of the target's dots, relative.")] = None
    lens: Annotated[float | None, _input("MM", "Of a position, by the rest of the distortion, from pose to pose.")] = (
        None
    )
    sensor_scale: Annotated[float | None, _input("REL", "Of each leg's sensor, relative.")] = None
    temperature: Annotated[float | None, _input("K", "Between target and robot; with the expansion of steel.")] = None
    trials: Annotated[
        int | None, _input("N", "Check U by Monte Carlo with so many simulated studies (GUM Supplement 1).")
    ] = None

    def checked(self) -> Inputs | None:
        """What was stated; None where nothing was. Raises InputError."""
        names = ("camera_scale", "target_scale", "lens", "sensor_scale", "temperature")
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if given:
            return Inputs.of(given)
        if self.trials is not None:
            what = "has no meaning without a standard uncertainty"
            raise InputError([Problem("option --trials", what, "state one, such as --camera-scale 1e-4")])
        return None


class SetOf(StrEnum):
    MEAN = "mean"
    SINGLE = "single"


class FrameName(StrEnum):
    MEASURED = study_page.MEASURED
    DRAWING = study_page.DRAWING


def calibrate(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="Folder of study.toml and two tables of poses.")],
    folder: Annotated[Path, output("DIR", "Folder for campaign/, validation/ and calibration.json; replaced there.")],
    factor: Annotated[float, typer.Option(help="Half-width of the reading sets, in standard deviations.")] = 3.0,
    of: Annotated[
        SetOf,
        typer.Option(
            help="Whose deviations: of the mean of a configuration's repeats, about which its set is, or of a single "
            "reading (the paper's choice; wider by the root of the number of repeats)."
        ),
    ] = SetOf.MEAN,
    frame: Annotated[
        FrameName,
        typer.Option(
            help="In which the parameters are printed: measured (of camera and target), or laid on the drawing."
        ),
    ] = FrameName.DRAWING,
    *,
    options: BudgetFlags,
    talk: Talk,
) -> None:
    """Calibrate a STUDY as is usual: statistics, frames, least squares x_c and x_c_sigma, validation. Proves nothing.

    DIR/campaign, one measurement a configuration with reading sets from the repeats, is what `cpcal certify` goes
    on from.
    """
    if not 0.0 < factor < float("inf"):
        raise InputError([Problem("option --factor", f"has no meaning: {factor}", "give a number > 0, such as 3")])
    inputs = options.checked()
    check_writable(folder)
    found = calibrate_study(load_study(study), factor=factor, of=of.value)
    record = found.record
    if inputs is not None:
        made = budget(found.x_c_sigma, found.campaign, found.drawing, inputs, trials=options.trials)
        record = replace(record, budget=made)
    warn(found.campaign)
    write_calibration(found, record, folder)
    show_record(talk, record, frame.value)
    talk.say(f"Campaign to certify: {folder / CAMPAIGN}. All parameters and figures: {folder / RECORD_NAME}")


def write_calibration(found: StudyCalibration, record: CalibrationRecord, folder: Path) -> None:
    """The two campaigns and, last, the record: an older one never stands beside campaigns that are not its own."""
    try:
        (folder / RECORD_NAME).unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    save_campaign(found.campaign, folder / CAMPAIGN)
    save_campaign(found.check, folder / VALIDATION)
    save_record(record, folder)


def show_record(talk: Talk, record: CalibrationRecord, frame: str = FrameName.DRAWING.value) -> None:
    """A few sentences; with --verbose every table and sentence, parameters in one of `study_page.FRAMES`."""
    if not talk.verbose:
        talk.say(*summary(record), "Tables of deviations, parameters and validation: --verbose.")
        return
    fits = {
        "x_c, plain least squares": record.x_c,
        "x_c_sigma, weighted by the noise of all legs together": record.x_c_sigma,
    }
    title = f"{record.robot}: {record.repeats.readings:,} readings of {record.repeats.configurations} configurations"
    talk.say(title, style="bold")
    tables = (
        ("Standard deviations of a leg reading [mm]", study_page.leg_lengths(record, paper_too=False)),
        ("Standard deviations of a pose", study_page.poses(record, paper_too=False)),
        ("Standard deviations in the calibration equations [mm]", study_page.equations(record)),
        *((f"{name} [mm, frame: {frame}]", study_page.parameters(fit, frame)) for name, fit in fits.items()),
        ("Errors of the validation poses", study_page.validation(record)),
        *(() if record.budget is None else study_page.budget_tables(record.budget)),
    )
    for heading, content in tables:
        show_table(talk, content, heading)
    talk.say(*record.sentences)
