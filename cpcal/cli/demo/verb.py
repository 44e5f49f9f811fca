"""`cpcal demo`: the paper's whole study on a simulated platform, from readings to one page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from cpcal.calibration import CalibrationRecord, calibrate_study, recorded
from cpcal.calibration.statistics import Of
from cpcal.cli.calibrate import show_record, write_calibration
from cpcal.cli.certify import certified_into, show_result, status_of
from cpcal.cli.demo.image_study import SUBSET, WHOLE, ImageStudy, image_study
from cpcal.cli.demo.image_study_page import images_found
from cpcal.cli.demo.pixel_sets import HALF_WIDTH, certify_pixels, with_sets
from cpcal.cli.folders import CAMPAIGN, FITS, RUN, STUDY, TIMEOUT, check_new, is_earlier_demo, unwritable
from cpcal.cli.progress import watch
from cpcal.cli.report import study_found
from cpcal.cli.status import Status
from cpcal.cli.talk import Talk, talking
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import stated
from cpcal.execution.stopping import heard
from cpcal.files import load_campaign, load_study, save_study
from cpcal.files.run_folder import REPORT_NAME
from cpcal.legs import PLAIN
from cpcal.questions import Result, certify, save_result
from cpcal.questions.fits import certify_fits
from cpcal.report.study_report import IMAGES_NAME, save_images, write_study_page
from cpcal.robot import Campaign
from cpcal.simulate import simulate_study
from cpcal.solver.contract import Verdict

FACTOR = 3.0  # half-width of the reading sets, in standard deviations of
OF: Of = "single"  # readings: the paper's choice


@dataclass(frozen=True)
class DemoPlan:
    """How much is done. `imperfect`: legs that no seven parameters describe, so that the model must be refuted."""

    imperfect: Mapping[str, float] = field(default_factory=lambda: {"sag": 2.0, "axis_offset": 2.0})  # mm
    size: Mapping[str, int] = field(default_factory=dict)  # of the study; left out: the paper's
    photographs: Mapping[str, int] | None = None  # of a study from images; left out: some hundred
    enclosed: int = 1  # of so many configurations one is enclosed from an image
    legs: tuple[int, ...] | None = None
    timeout_seconds: float = 3.0  # a leg, for the paper's timeout method
    script_gap: float = 0.01  # relative


PLAN = DemoPlan()


@talking
def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study and all that follows from it.")
    ] = Path("cpcal-demo"),
    seed: Annotated[int, typer.Option(help="Of the simulated robot and its readings.")] = 1,
    images: Annotated[
        bool, typer.Option("--images", help="Render images of the study, and find its poses in them.")
    ] = False,
    full: Annotated[
        bool, typer.Option("--full", help="With --images: all 14,784 of the paper, not kept, instead of some hundred.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where a stopped demo of the same options was.")
    ] = False,
    *,
    talk: Talk,
) -> None:
    """The paper's whole study on a simulated robot: calibrate, certify, check the proofs, write the report.

    The robot is the DeltaLab Table of Stewart with legs that sag and joints whose axes miss each other by 2 mm, which
    the model with seven parameters a leg does not know; the noise is the paper's. Writes DIR/study, DIR/campaign,
    DIR/validation, DIR/calibration.json, DIR/fits, DIR/run, DIR/timeout and the page DIR/report.html; with --images
    also DIR/images and what was found in them, and a campaign whose reading sets are proved from pixels, certified too.
    A certificate that the checker refuses makes the exit status 1.
    """
    if full and not images:
        raise InputError([Problem("option --full", "has no meaning without --images", "add --images, or leave it out")])
    check_new(output, force=force or is_earlier_demo(output))
    for name in (REPORT_NAME, IMAGES_NAME):  # what is older must not stand beside newer results
        (output / name).unlink(missing_ok=True)
    console = talk.out
    photos = _photos(output, seed, full, talk) if images else None
    study = photos.study if photos else simulate_study(seed=seed, **PLAN.size, **PLAN.imperfect)  # type: ignore[arg-type]
    save_study(study, output / STUDY)
    record = _calibrated(output, seed, talk)
    campaign = load_campaign(output / CAMPAIGN)
    _fits(campaign, record, output / FITS, talk)
    result = _unless_stopped(
        lambda: certified_into(output / RUN, campaign, {"legs": PLAN.legs}, talk=talk, resume=resume)
    )
    _unless_stopped(lambda: _timeout(campaign, output / TIMEOUT, talk))
    if photos is not None:
        _pixels(photos, campaign, result, output, talk, resume)
    accepted, found = study_found(output)
    console.print(found.checked, soft_wrap=True)
    page = write_study_page(found, output / REPORT_NAME, run=output / RUN)
    console.print(f"The whole study: {page}", soft_wrap=True)
    raise typer.Exit(status_of(result) if accepted else Status.UNKNOWN)


def _unless_stopped(certified: Callable[[], Result]) -> Result:
    """The result of long work; the demo ends with it where a signal stopped it."""
    with heard(terminate=True):
        result = certified()
        if result.interrupted:
            raise typer.Exit(status_of(result))
        return result


def _photos(output: Path, seed: int, full: bool, talk: Talk) -> ImageStudy:
    size, keep = (WHOLE, False) if full else (PLAN.photographs or SUBSET, True)
    return image_study(output, seed, PLAN.imperfect, talk, size=size, keep=keep)


def _calibrated(output: Path, seed: int, talk: Talk) -> CalibrationRecord:
    """Read the study, calibrate, write, show."""
    how = ", ".join(f"{name.replace('_', ' ')} {stated(size)} mm" for name, size in PLAN.imperfect.items())
    talk.say(f"Study: {output / STUDY} (simulated, seed {seed}; {how})")
    study = load_study(output / STUDY)
    found = calibrate_study(study, factor=FACTOR, of=OF)
    record = recorded(study, found, factor=FACTOR, of=OF)
    write_calibration(found, record, output)
    show_record(talk, record)
    return record


def _fits(campaign: Campaign, record: CalibrationRecord, folder: Path, talk: Talk) -> None:
    """Are x_c and x_c_sigma solutions? A line for each; with --verbose for each leg."""
    fits = certify_fits(campaign, record, folder, legs=PLAN.legs)
    for name, verified in fits.both:
        if talk.verbose:
            for fit in verified:
                talk.say(f"Leg {fit.leg}: {fit.verified.sentence(name)}")
            continue
        legs = {word: [str(fit.leg) for fit in verified if fit.verified.verdict is word] for word in Verdict}
        said = [f"{word.value} for leg {', '.join(some)}" for word, some in legs.items() if some]
        talk.say(f"{name} satisfies every equation exactly, for some readings in their sets: {'; '.join(said)}.")


def _pixels(photos: ImageStudy, campaign: Campaign, result: Result, output: Path, talk: Talk, resume: bool) -> None:
    """Reading sets from pixels, certified, and what the page says of the images."""
    talk.say(f"Reading sets from pixel boxes of ±{stated(HALF_WIDTH)} px:")
    with heard(terminate=True):
        run = certify_pixels(photos, campaign, PLAN.legs, output, talk, every=PLAN.enclosed, resume=resume)
        if run.result.interrupted:
            raise typer.Exit(status_of(run.result))
    try:
        save_images(with_sets(images_found(photos), photos, run, campaign, result), output)
    except OSError as error:
        raise unwritable(output, error) from None


def _timeout(campaign: Campaign, folder: Path, talk: Talk) -> Result:
    """eps by the paper's timeout method, a few seconds a leg."""
    legs = list(PLAN.legs or range(1, campaign.legs + 1))
    console = talk.out
    console.print(f"The paper's timeout method (section 5.2.1), {stated(PLAN.timeout_seconds)} s a leg:")
    with watch(legs, PLAN.script_gap, talk.errors) as progress:
        timeout = certify(
            campaign,
            legs=legs,
            method="timeout",
            time_limit=PLAN.timeout_seconds,
            gap=PLAN.script_gap,
            progress=progress,
        )
    save_result(timeout, folder, campaign)
    show_result(console, campaign, timeout, PLAIN)
    return timeout
