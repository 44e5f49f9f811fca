"""`cpcal calibrate`: the classical calibration of a study. `cpcal demo`: the paper's whole study, simulated."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import typer

from cpcal.cli.certify import certified_into, show, show_result, status_of, warned
from cpcal.cli.report import study_found
from cpcal.cli.verbs import (
    CAMPAIGN,
    FITS,
    FORCE,
    RUN,
    STUDY,
    TIMEOUT,
    VALIDATION,
    Status,
    Talk,
    argument,
    check_new,
    check_writable,
    line,
    option,
    options,
    output,
)
from cpcal.common.errors import unusable
from cpcal.common.files import unwritable, write_file
from cpcal.common.numbers import stated
from cpcal.common.values import Json
from cpcal.files import load_campaign, load_study, save_campaign, save_study
from cpcal.models import PLAIN
from cpcal.questions import (
    RECORD_NAME,
    CalibrationRecord,
    Inputs,
    Result,
    StudyCalibration,
    budget,
    calibrate_study,
    certify,
    save_record,
    save_result,
)
from cpcal.questions.points import certify_fits
from cpcal.questions.question import question_of
from cpcal.report.run_page import REPORT_NAME
from cpcal.report.section import Section
from cpcal.report.study_page import COMPARED, PAPERS_WAY, calibration, render_study, solutions, summary
from cpcal.robot import Campaign
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard

# ------------------------------------------------------------------------------------------------------------------
# `cpcal calibrate`: statistics, frames, least squares and validation, in tables and files.

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
    given = {name: value for name, value in asdict(options).items() if value is not None}
    inputs = Inputs(**given)
    check_writable(folder)
    found = calibrate_study(load_study(study), factor=factor)
    record = found.record
    if given:
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


# ------------------------------------------------------------------------------------------------------------------
# `cpcal demo`: from readings to one page.

FACTOR = 3.0  # half-width of the reading sets, in standard deviations of single readings: the paper's choice
IMPERFECT = {"sag": 2.0, "axis_offset": 2.0}  # mm: legs that no seven parameters describe; the model must be refuted
TOLERANCE = 1.0  # mm: what the legs are to be good to
TIMEOUT_GAP = 0.01  # relative


class DemoPlan(NamedTuple):
    """How much is done: the size of the study (else the paper's), legs, seconds of the timeout method a leg."""

    size: Mapping[str, int] = {}
    legs: tuple[int, ...] | None = None
    timeout_seconds: float = 3.0


PLAN = DemoPlan()


def demo(
    folder: Path = output("DIR", "Folder for the study and all that follows from it.", Path("cpcal-demo")),
    seed: int = option(1, "Of the simulated robot and its readings."),
    force: bool = FORCE,
    resume: bool = option(False, "Go on in DIR, from where a stopped demo of the same options was."),
    *,
    talk: Talk,
) -> Status:
    """The paper's whole study on a simulated robot: calibrate, certify, check the proofs, write the report.

    The robot is the DeltaLab Table of Stewart with legs that sag and joints whose axes miss each other by 2 mm, which
    the model with seven parameters a leg does not know; the noise is the paper's. Writes DIR/study, DIR/campaign,
    DIR/validation, DIR/calibration.json, DIR/fits, DIR/run, DIR/timeout and the page DIR/report.html. A certificate
    that the checker refuses makes the exit status 1, a leg that fails the tolerance does not.
    """
    check_new(folder, force=force or resume)
    (folder / REPORT_NAME).unlink(missing_ok=True)  # what is older must not stand beside newer results
    given: Json = {"seed": seed, **PLAN.size, **IMPERFECT}
    save_study(simulate_study(**given), folder / STUDY)
    how = ", ".join(f"{name.replace('_', ' ')} {stated(size)} mm" for name, size in IMPERFECT.items())
    talk.say(f"Study: {folder / STUDY} (simulated, seed {seed}; {how})")
    found = calibrate_study(load_study(folder / STUDY), factor=FACTOR, of="single")
    write_calibration(found, found.record, folder)
    show_record(talk, found.record)
    talk.say(PAPERS_WAY, f"Tolerance: {stated(TOLERANCE)} mm for each leg.")
    campaign = load_campaign(folder / CAMPAIGN)
    fits = certify_fits(campaign, found.record, folder / FITS, legs=PLAN.legs)
    talk.say(*solutions(fits))
    if talk.verbose:
        talk.say(*(f"Leg {f.leg}: {f.verified.sentence(name)}" for name, each in fits.items() for f in each))
    question = question_of(campaign, legs=PLAN.legs, ranges=True, tolerance=TOLERANCE)
    with heard(terminate=True):
        result = certified_into(folder / RUN, question, talk=talk, resume=resume)
        if not result.interrupted:
            result = _timeout(campaign, folder / TIMEOUT, talk)
        if result.interrupted:
            raise typer.Exit(status_of(result))
    whole = study_found(folder)
    page = write_file(folder / REPORT_NAME, render_study(whole, folder / RUN))
    talk.say(whole.checked, f"The whole study: {page}")
    answered = all(leg.bracket.verdict is not Verdict.UNKNOWN for leg in whole.result.legs)
    return Status.ANSWERED if answered else Status.UNKNOWN


def _timeout(campaign: Campaign, folder: Path, talk: Talk) -> Result:
    """eps by the paper's timeout method, a few seconds a leg."""
    legs = list(PLAN.legs or range(1, campaign.legs + 1))
    talk.say(f"The paper's timeout method (section 5.2.1), {stated(PLAN.timeout_seconds)} s a leg:")
    seconds, gap = PLAN.timeout_seconds, TIMEOUT_GAP
    with line(talk.console()) as shown:
        timeout = certify(campaign, legs=legs, method="timeout", progress=shown.leg, time_limit=seconds, gap=gap)
    save_result(timeout, folder, campaign)
    show_result(replace(talk, verbose=False), campaign, timeout, PLAIN)
    return timeout
