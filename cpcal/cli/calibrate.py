"""`cpcal calibrate`: the classical calibration of a study, in tables and files."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from cpcal.calibration import (
    RECORD_NAME,
    CalibrationRecord,
    Inputs,
    StudyCalibration,
    budget,
    calibrate_study,
    save_record,
)
from cpcal.cli.certify import show, warned
from cpcal.cli.options import CAMPAIGN, VALIDATION, argument, check_writable, option, options, output
from cpcal.cli.terminal import Talk
from cpcal.common.errors import unusable
from cpcal.common.files import unwritable
from cpcal.files import load_study, save_campaign
from cpcal.report.section import Section
from cpcal.report.study_page import COMPARED, calibration, summary

_input = partial(option, panel="Uncertainty budget (GUM): standard uncertainties of what all readings share")


@options
class BudgetFlags:
    """The arguments of `Inputs`. Left out: not stated. The budget is made where any is given."""

    camera_scale: float | None = _input(None, "Of the distances that the camera gives (focal length), relative.", "REL")
    target_scale: float | None = _input(None, "Of the target's dots, relative.", "REL")
    lens: float | None = _input(None, "Of a position, by the rest of the distortion, from pose to pose.", "MM")
    sensor_scale: float | None = _input(None, "Of each leg's sensor, relative.", "REL")
    temperature: float | None = _input(None, "Between target and robot; with the expansion of steel.", "K")


def calibrate(
    study: Path = argument("STUDY", "Folder of study.toml and two tables of poses."),
    folder: Path = output("DIR", "Folder for campaign/, validation/ and calibration.json; replaced there."),
    factor: float = option(3.0, "Half-width of the reading sets, in standard deviations."),
    *,
    options: BudgetFlags,
    talk: Talk,
) -> None:
    """Calibrate a STUDY as is usual: statistics, frames, least squares x_c and x_c_sigma, validation. Proves nothing.

    DIR/campaign, one measurement a configuration with reading sets from the repeats, is what `cpcal certify` goes
    on from.
    """
    if not 0.0 < factor < float("inf"):
        raise unusable("option --factor", f"has no meaning: {factor}", "give a number > 0, such as 3")
    stated = {name: value for name, value in asdict(options).items() if value is not None}
    inputs = Inputs(**stated)
    check_writable(folder)
    found = calibrate_study(load_study(study), factor=factor)
    record = found.record
    if stated:
        record = replace(record, budget=budget(found.x_c_sigma, found.campaign, found.drawing, inputs))
    warned(found.campaign)
    write_calibration(found, record, folder)
    show_record(talk, record)
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


def show_record(talk: Talk, record: CalibrationRecord) -> None:
    """A few sentences; with --verbose every table and sentence."""
    if not talk.verbose:
        talk.say(*summary(record), "Tables of deviations, parameters and validation: --verbose.")
        return
    title = f"{record.robot}: {record.repeats.readings:,} readings of {record.repeats.configurations} configurations"
    show(talk, Section(title, [COMPARED], parts=[*calibration(record)]))
