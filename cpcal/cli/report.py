"""`cpcal report` and `cpcal export`: a run that is checked again becomes a page, or parameters for a controller."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.calibration import RECORD_NAME, load_record
from cpcal.cli.options import (
    CAMPAIGN,
    FITS,
    PIXEL_RUN,
    PIXEL_SETS,
    RUN,
    TIMEOUT,
    Status,
    Talk,
    check_writable,
    output,
)
from cpcal.cli.verified import stated_otherwise
from cpcal.cli.verify import check_all, checked_certificates, checked_legs, result_of
from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.files import write_file
from cpcal.files import campaign_sha256, load_campaign, load_campaign_json
from cpcal.files.run_folder import HANDEYE, REPORT_NAME
from cpcal.questions import Result, load_result
from cpcal.questions.hand_eye import load_hand_eye_result, verify_hand_eye
from cpcal.questions.points import fits_of
from cpcal.report.export import HAND_EYE_FORMS, WRITERS, exported, frames_of_run
from cpcal.report.run_page import render
from cpcal.report.study_page import StudyFound, load_images, render_study
from cpcal.robot import Campaign

# ------------------------------------------------------------------------------------------------------------------
# The page of a whole study from the folder that `cpcal demo` leaves.


def study_found(folder: Path) -> tuple[bool, StudyFound]:
    """What the folder holds, and whether the checker, asked now, accepts all its certificates. Raises InputError."""
    campaign, record = load_campaign(folder / CAMPAIGN), load_record(folder)
    result, timeout = load_result(folder / RUN), load_result(folder / TIMEOUT)
    found = {part: checked_certificates(folder / part) for part in (FITS, RUN, PIXEL_RUN)}
    accepted, said = check_all(found.values())
    if (folder / PIXEL_SETS).is_dir():  # their certificates name rows, which only a claim's pixels give
        from cpcal.checker.sight import check_pose_sets

        sets = check_pose_sets(folder / PIXEL_SETS)
        refused = [f"{one.name} ({one.refused})" for one in sets if one.refused is not None]
        accepted = accepted and not refused
        many = f"{len(sets)} pose sets with {sum(len(one.certificates) for one in sets)} certificates"
        wrong = f"REFUSED {len(refused)} of {many}: {'; '.join(refused)}"
        said += f" It {wrong if refused else f'accepted all {many}'}."
    return accepted, StudyFound(
        campaign=campaign,
        record=record,
        fits=fits_of(folder / FITS, found[FITS]),
        result=result,
        timeout=timeout,
        checked=said,
        images=load_images(folder),
    )


# ------------------------------------------------------------------------------------------------------------------
# `cpcal report`: the page of a run, written again.


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that certify wrote, or demo.")],
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="CAMPAIGN", help="Folder of the original campaign, to compare the run's with."),
    ] = None,
    page: Annotated[Path | None, output("FILE", "The page; replaced.", show_default="RUN/report.html")] = None,
    no_checker: Annotated[bool, typer.Option("--no-checker", help="A page that does not check itself.")] = False,
) -> None:
    """Check a RUN as `verify` does, and write its HTML page again, from its result.json and campaign.json.

    One self-contained file: it loads nothing, prints, and checks its certificates in the browser. With --campaign,
    another campaign than the one that was certified is refused. Of a folder that `cpcal demo` wrote it is the page of
    the whole study; its certificates are checked anew.
    """
    file = run / REPORT_NAME if page is None else page
    if file.is_dir():
        raise InputError([Problem(str(file), "is a folder", "name a file, such as report.html")])
    check_writable(file.parent)
    if (run / RECORD_NAME).is_file():  # the folder of a study
        text = _study(run, campaign, checker=not no_checker)
    else:
        text = render(*checked_run(run, campaign), run=None if no_checker else run)
    write_file(file, text)
    Talk().say(f"Report: {file}")


def checked_run(run: Path, campaign: Path | None = None) -> tuple[Campaign, Result]:
    """A run's campaign and result. Raises InputError, and typer.Exit when the checker refuses something."""
    result = result_of(run)
    if isinstance(result, str):
        raise _refusal(run, [result])
    _stop(run, _refused(run))
    kept = load_campaign_json(run)
    if campaign is not None and campaign_sha256(load_campaign(campaign)) != campaign_sha256(kept):
        what = "is another campaign than the run's: its SHA-256 differs"
        raise InputError([Problem(str(campaign), what, "name the campaign that was certified, or leave it out")])
    _stop(run, list(stated_otherwise(kept, result)))
    return kept, result


def _stop(folder: Path, wrong: list[str]) -> None:
    """No page of what is refused."""
    if wrong:
        raise _refusal(folder, wrong)


def _refusal(folder: Path, wrong: list[str]) -> typer.Exit:
    for sentence in wrong:
        typer.echo(printable(f"{folder.name}: REFUSED, {sentence}"))
    return typer.Exit(Status.UNKNOWN)


def _refused(run: Path) -> list[str]:
    """What the checker refuses of a run. Raises InputError where there is nothing to check."""
    legs = checked_legs(run)
    if isinstance(legs, str):
        return [legs]
    return [f"leg {leg.leg}: {leg.refused}" for leg in legs if leg.refused is not None]


def _study(folder: Path, campaign: Path | None, *, checker: bool) -> str:
    if campaign is not None:
        raise InputError(
            [Problem("option --campaign", "has no meaning for a study, which holds its own", "leave it out")]
        )
    for run in (folder / RUN, folder / PIXEL_RUN):
        if run.is_dir():
            _stop(run, [*_refused(run), *stated_otherwise(load_campaign_json(run), load_result(run))])
    found = checked_certificates(folder / FITS)
    _stop(folder / FITS, [f"{name}: {reason}" for name, reason in found.items() if isinstance(reason, str)])
    return render_study(study_found(folder)[1], folder / RUN if checker else None)


# ------------------------------------------------------------------------------------------------------------------
# `cpcal export`: the parameters of a run for a controller.


class Format(StrEnum):
    TOML = "toml"
    JSON = "json"
    YAML = "yaml"
    CSV = "csv"
    ROS2 = "ros2"
    EASY_HANDEYE = "easy-handeye"
    URDF = "urdf"
    OPENCV = "opencv"


_YAML = (".yaml", ".yml")
_SUFFIXES = {
    Format.TOML: (".toml",),
    Format.JSON: (".json",),
    Format.YAML: _YAML,
    Format.CSV: (".csv",),
    Format.ROS2: (".py",),
    Format.EASY_HANDEYE: _YAML,
    Format.URDF: (".urdf", ".xacro", ".xml"),
    Format.OPENCV: _YAML,
}


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that certify or handeye wrote.")],
    format: Annotated[
        Format | None,
        typer.Option("--format", "-f", help="Of what is written.", show_default="as FILE is called, or toml"),
    ] = None,
    file: Annotated[Path | None, output("FILE", "The file; replaced.", show_default="print")] = None,
    frames: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of the campaign's calibration.json: write the drawing's frames, not camera's and target's.",
        ),
    ] = None,
) -> None:
    """Check a RUN as `verify` does, and write its parameters: certified, with ranges, and of least squares.

    Beside each number stand unit and frame; what a proof does not hold is left out. Lengths are in mm. Of a hand-eye
    run the camera's frame is written as ros2, easy-handeye, urdf (in m) or opencv.
    """
    if file is not None:
        check_writable(file.parent)
    if (run / HANDEYE.head).exists():
        refused = [sentence for accepted, sentence in verify_hand_eye(run) if not accepted]
        if refused:
            raise InputError([Problem(str(run), refused[0], "run cpcal handeye certify again")])
        chosen = _chosen(format, file, [Format(name) for name in HAND_EYE_FORMS])
        text = HAND_EYE_FORMS[chosen.value](load_hand_eye_result(run))
    else:
        chosen = _chosen(format, file, [Format(name) for name in WRITERS])
        campaign, result = checked_run(run)
        moved = None if frames is None else frames_of_run(result, load_record(frames), str(frames))
        text = WRITERS[chosen.value](exported(campaign, result, moved))
    if file is None:
        typer.echo(text, nl=False)
    else:
        write_file(file, text)
        Talk().say(f"Parameters: {file}")


def _chosen(asked: Format | None, file: Path | None, known: list[Format]) -> Format:
    """One of the formats `known` of a run: what was asked for, or what the file's name says. Raises InputError."""
    suffix = "" if file is None else file.suffix.lower()
    fit = [form for form in known if suffix in _SUFFIXES[form]]
    names = f"of this run write one of {', '.join(known)}"
    if asked is None and len(fit) == 1:
        return fit[0]
    if asked is None and not suffix and Format.TOML in known:
        return Format.TOML
    if asked is None:
        what = f"is missing, and the name {file.name} does not say it" if file is not None else "is missing"
        raise InputError([Problem("option --format", what, names)])
    if asked not in known:
        raise InputError([Problem("option --format", f"is {asked}", names)])
    if asked not in fit and any(suffix in some for some in _SUFFIXES.values()):
        what, remedy = (
            f"is {file}, and the format {asked}",
            f"call the file *{_SUFFIXES[asked][0]}, or leave --format out",
        )
        raise InputError([Problem("option --output", what, remedy)])
    return asked
