"""`cpcal demo`: the paper's whole study on a simulated platform, from readings to one page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import typer

from cpcal.calibration import CalibrationRecord, calibrate_study
from cpcal.calibration.statistics import Of
from cpcal.cli.calibrate import show_record, write_calibration
from cpcal.cli.certify import certified_into, show_result, status_of
from cpcal.cli.options import (
    CAMPAIGN,
    FITS,
    FORCE,
    RUN,
    STUDY,
    TIMEOUT,
    Status,
    check_new,
    option,
    output,
)
from cpcal.cli.report import study_found
from cpcal.cli.terminal import Talk, line
from cpcal.common.files import write_file
from cpcal.common.numbers import stated
from cpcal.files import load_campaign, load_study, save_study
from cpcal.files.run_folder import REPORT_NAME
from cpcal.models import PLAIN
from cpcal.questions import Result, certify, save_result
from cpcal.questions.points import certify_fits
from cpcal.questions.question import question_of
from cpcal.report.study_page import PAPERS_WAY, render_study
from cpcal.robot import Campaign
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict
from cpcal.solver.execution.stopping import heard

FACTOR = 3.0  # half-width of the reading sets, in standard deviations of
OF: Of = "single"  # readings: the paper's choice


@dataclass(frozen=True)
class DemoPlan:
    """How much is done. `imperfect`: legs that no seven parameters describe, so that the model must be refuted."""

    imperfect: Mapping[str, float] = field(default_factory=lambda: {"sag": 2.0, "axis_offset": 2.0})  # mm
    size: Mapping[str, int] = field(default_factory=dict)  # of the study; left out: the paper's
    legs: tuple[int, ...] | None = None
    tolerance: float = 1.0  # mm: what the legs are to be good to
    timeout_seconds: float = 3.0  # a leg, for the paper's timeout method
    timeout_gap: float = 0.01  # relative


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
    given: dict[str, Any] = {"seed": seed, **PLAN.size, **PLAN.imperfect}
    save_study(simulate_study(**given), folder / STUDY)
    how = ", ".join(f"{name.replace('_', ' ')} {stated(size)} mm" for name, size in PLAN.imperfect.items())
    talk.say(f"Study: {folder / STUDY} (simulated, seed {seed}; {how})")
    found = calibrate_study(load_study(folder / STUDY), factor=FACTOR, of=OF)
    write_calibration(found, found.record, folder)
    show_record(talk, found.record)
    talk.say(PAPERS_WAY, f"Tolerance: {stated(PLAN.tolerance)} mm for each leg.")
    campaign = load_campaign(folder / CAMPAIGN)
    _fits(campaign, found.record, folder / FITS, talk)
    question = question_of(campaign, legs=PLAN.legs, ranges=True, tolerance=PLAN.tolerance)
    result = _unless_stopped(lambda: certified_into(folder / RUN, question, talk=talk, resume=resume))
    _unless_stopped(lambda: _timeout(campaign, folder / TIMEOUT, talk))
    accepted, whole = study_found(folder)
    page = write_file(folder / REPORT_NAME, render_study(whole, folder / RUN))
    talk.say(whole.checked, f"The whole study: {page}")
    answered = all(leg.bracket.verdict is not Verdict.UNKNOWN for leg in result.legs)
    return Status.ANSWERED if accepted and answered else Status.UNKNOWN


def _unless_stopped(certified: Callable[[], Result]) -> Result:
    """The result of long work; the demo ends with it where a signal stopped it."""
    with heard(terminate=True):
        result = certified()
        if result.interrupted:
            raise typer.Exit(status_of(result))
        return result


def _fits(campaign: Campaign, record: CalibrationRecord, folder: Path, talk: Talk) -> None:
    """Are x_c and x_c_sigma solutions? A line for each; with --verbose for each leg."""
    fits = certify_fits(campaign, record, folder, legs=PLAN.legs)
    for name, verified in fits.both:
        if talk.verbose:
            talk.say(*(f"Leg {fit.leg}: {fit.verified.sentence(name)}" for fit in verified))
            continue
        legs = {word: [str(fit.leg) for fit in verified if fit.verified.verdict is word] for word in Verdict}
        said = [f"{word.value} for leg {', '.join(some)}" for word, some in legs.items() if some]
        talk.say(f"Is {name} a solution, within the stated reading uncertainty? {'; '.join(said).capitalize()}.")


def _timeout(campaign: Campaign, folder: Path, talk: Talk) -> Result:
    """eps by the paper's timeout method, a few seconds a leg."""
    legs = list(PLAN.legs or range(1, campaign.legs + 1))
    talk.say(f"The paper's timeout method (section 5.2.1), {stated(PLAN.timeout_seconds)} s a leg:")
    limits: dict[str, Any] = {"time_limit": PLAN.timeout_seconds, "gap": PLAN.timeout_gap}
    with line(talk.console()) as shown:
        timeout = certify(campaign, legs=legs, method="timeout", progress=shown.leg, **limits)
    save_result(timeout, folder, campaign)
    show_result(replace(talk, verbose=False), campaign, timeout, PLAIN)
    return timeout
