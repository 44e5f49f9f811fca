"""`cpcal demo`: the paper's whole study on a simulated platform, from readings to one page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from cpcal.calibration import calibrate_study
from cpcal.calibration.record import CalibrationRecord, recorded
from cpcal.certify import certify
from cpcal.certify.fits import certify_fits
from cpcal.cli.calibrate import show_record, write_calibration
from cpcal.cli.folders import CAMPAIGN, FITS, RUN, SCRIPT, STUDY, check_new, unwritable
from cpcal.cli.progress import watch
from cpcal.cli.run import Question, answer, publish
from cpcal.cli.show import show_result, terminal
from cpcal.cli.status import Status, status_of
from cpcal.cli.study_page import study_found
from cpcal.report import REPORT_NAME
from cpcal.report.study import write_study_page
from cpcal.result import Result, save_result
from cpcal.robot import Campaign, load_campaign, load_study, save_study, simulate_study

FACTOR = 3.0  # half-width of the reading sets, in standard deviations


@dataclass(frozen=True)
class Plan:
    """How much is done. `imperfect`: legs that no seven parameters describe, so that the model must be refuted."""

    imperfect: Mapping[str, float] = field(default_factory=lambda: {"sag": 2.0, "axis_offset": 2.0})  # mm
    size: Mapping[str, int] = field(default_factory=dict)  # of the study; left out: the paper's
    legs: tuple[int, ...] | None = None
    script_seconds: float = 3.0  # a leg, for the paper's script
    script_gap: float = 0.01  # relative


PLAN = Plan()


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study and all that follows from it.")
    ] = Path("cpcal-demo"),
    seed: Annotated[int, typer.Option(help="Of the simulated robot and its readings.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """The paper's whole study on a simulated robot: calibrate, certify, check the proofs, write the report.

    The robot is the DeltaLab Table of Stewart with legs that sag and joints whose axes miss each other by 2 mm, which
    the model with seven parameters a leg does not know; the noise is the paper's. Writes DIR/study, DIR/campaign,
    DIR/validation, DIR/calibration.json, DIR/fits, DIR/run, DIR/script and the page DIR/report.html.
    A certificate that the checker refuses makes the exit status 1.
    """
    check_new(output, force=force)
    (output / REPORT_NAME).unlink(missing_ok=True)  # an older page must not stand beside newer results
    console = terminal()
    record = _calibrated(output, seed, console)
    campaign = load_campaign(output / CAMPAIGN)
    _fits(campaign, record, output / FITS, console)
    result = answer(campaign, Question(legs=PLAN.legs), output / RUN, quiet=False)
    publish(campaign, result, output / RUN, as_json=False)
    if result.interrupted:
        raise typer.Exit(Status.INTERRUPTED)
    script = _script(campaign, output / SCRIPT, console)
    if script.interrupted:
        raise typer.Exit(Status.INTERRUPTED)
    accepted, found = study_found(output)
    console.print(found.checked, soft_wrap=True)
    try:
        page = write_study_page(found, output / REPORT_NAME)
    except OSError as error:
        raise unwritable(output, error) from None
    console.print(f"The whole study: {page}", soft_wrap=True)
    raise typer.Exit(status_of(result) if accepted else Status.UNKNOWN)


def _calibrated(output: Path, seed: int, console: Console) -> CalibrationRecord:
    """Simulate, write, read, calibrate, write, show."""
    simulated = simulate_study(seed=seed, **PLAN.size, **PLAN.imperfect)  # type: ignore[arg-type]
    save_study(simulated, output / STUDY)
    how = ", ".join(f"{name.replace('_', ' ')} {size:g} mm" for name, size in PLAN.imperfect.items())
    console.print(f"Study: {output / STUDY} (simulated, seed {seed}; {how})", soft_wrap=True)
    study = load_study(output / STUDY)
    found = calibrate_study(study, factor=FACTOR)
    record = recorded(study, found, factor=FACTOR)
    write_calibration(found, record, output)
    show_record(console, record)
    return record


def _fits(campaign: Campaign, record: CalibrationRecord, folder: Path, console: Console) -> None:
    """Are x_c and x_c_sigma solutions?"""
    try:
        fits = certify_fits(campaign, record, folder, legs=PLAN.legs)
    except OSError as error:
        raise unwritable(folder, error) from None
    for name, judged in fits.both:
        for fit in judged:
            console.print(f"Leg {fit.leg}: {fit.judged.sentence(name)}", soft_wrap=True)


def _script(campaign: Campaign, folder: Path, console: Console) -> Result:
    """eps by the paper's script, a few seconds a leg."""
    legs = list(PLAN.legs or range(1, campaign.legs + 1))
    console.print(f"The paper's script (section 5.2.1), {PLAN.script_seconds:g} s a leg:")
    with watch(legs, PLAN.script_gap, terminal(stderr=True)) as progress:
        script = certify(
            campaign,
            legs=legs,
            method="timeout",
            time_limit=PLAN.script_seconds,
            gap=PLAN.script_gap,
            progress=progress,
        )
    try:
        save_result(script, folder)
    except OSError as error:
        raise unwritable(folder, error) from None
    show_result(console, script, campaign.legs)
    return script
