"""`cpcal report`, `export`, `accuracy`: a run that is checked again becomes a page, parameters, or bounds of poses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import typer

from cpcal.cli.verbs import (
    CAMPAIGN,
    FITS,
    RUN,
    TIMEOUT,
    Status,
    Talk,
    answer,
    argument,
    numbers_of,
    option,
    output,
)
from cpcal.cli.verify import checked_certificates, refusals
from cpcal.common.documents import toml_text
from cpcal.common.errors import printable, unusable
from cpcal.common.files import write_file
from cpcal.files import load_campaign, load_campaign_json
from cpcal.files.run_folder import ACCURACY, HANDEYE
from cpcal.files.tables import load_poses
from cpcal.questions import RECORD_NAME, load_record, load_result
from cpcal.questions.hand_eye import load_hand_eye_result
from cpcal.questions.points import fits_of
from cpcal.report.export import HAND_EYE_FORMS, exported, frames_of_run
from cpcal.report.run_page import REPORT_NAME, render
from cpcal.report.study_page import StudyFound, render_study
from cpcal.simulate import true_robot

# ------------------------------------------------------------------------------------------------------------------
# What is refused has no page, and no parameters.


def _accepted(folder: Path) -> None:
    """Raises typer.Exit when something of a folder is refused, which is said, and InputError."""
    if refused := refusals(folder):
        for sentence in refused:
            typer.echo(printable(f"{folder.name}: {sentence}"))
        raise typer.Exit(Status.UNKNOWN)


def study_found(folder: Path) -> StudyFound:
    """What the folder of a study holds, all of whose certificates are accepted now. Raises typer.Exit, InputError."""
    _accepted(folder / RUN)
    campaign, result = load_campaign(folder / CAMPAIGN), load_result(folder / RUN)
    accepted = checked_certificates(folder / FITS)
    count = len(accepted) + len([*(folder / RUN).glob("*.cert.jsonl")])
    return StudyFound(
        campaign=campaign,
        record=load_record(folder),
        fits=fits_of(folder / FITS, campaign, [leg.leg for leg in result.legs], accepted),
        result=result,
        timeout=load_result(folder / TIMEOUT),
        checked=f"The checker accepted all {count} certificates (exact arithmetic, no solver).",
        truth=true_robot(campaign),
    )


# ------------------------------------------------------------------------------------------------------------------
# `cpcal report`: the page of a run, or of the study that `cpcal demo` leaves, written again.


def report(
    run: Path = argument("RUN", "Folder that certify wrote, or demo."),
    page: Path | None = output("FILE", "The page; replaced.", None, show_default="RUN/report.html"),
) -> None:
    """Check a RUN as `verify` does, and write its HTML page again, from its result.json and campaign.json.

    One self-contained file: it loads nothing, prints, and checks its certificates in the browser. Of a folder that
    `cpcal demo` wrote it is the page of the whole study; its certificates are checked anew.
    """
    file = run / REPORT_NAME if page is None else page
    if file.is_dir():
        raise unusable(str(file), "is a folder", "name a file, such as report.html")
    if (run / RECORD_NAME).is_file():  # the folder of a study
        text = render_study(study_found(run), run / RUN)
    else:
        _accepted(run)
        text = render(load_campaign_json(run), load_result(run), run=run)
    write_file(file, text)
    Talk().say(f"Report: {file}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal export`: the parameters of a run for a controller.

Format = Literal["toml", "json", "ros2", "easy-handeye", "urdf", "opencv"]


def export(
    run: Path = argument("RUN", "Folder that certify or handeye wrote."),
    format: Format = option("toml", "Of what is written.", "--format", "-f"),
    file: Path | None = output("FILE", "The file; replaced.", None, show_default="print"),
    frames: Path | None = option(
        None, "Folder of the campaign's calibration.json: write the drawing's frames, not camera's, target's.", "DIR"
    ),
) -> None:
    """Check a RUN as `verify` does, and write its parameters: certified, with ranges, and of least squares.

    Beside each number stand unit and frame; what a proof does not hold is left out. Lengths are in mm. Of a hand-eye
    run the camera's frame is written as ros2, easy-handeye, urdf (in m) or opencv.
    """
    hand_eye = (run / HANDEYE.head).exists()
    known = list(HAND_EYE_FORMS) if hand_eye else ["toml", "json"]
    if format not in known:
        raise unusable("option --format", f"is {format}", f"of this run write one of {', '.join(known)}")
    _accepted(run)
    if hand_eye:
        text = HAND_EYE_FORMS[format](load_hand_eye_result(run))
    else:
        campaign, result = load_campaign_json(run), load_result(run)
        moved = None if frames is None else frames_of_run(result, load_record(frames), str(frames))
        data = exported(campaign, result, moved)
        text = (
            toml_text(data)
            if format == "toml"
            else json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        )
    if file is None:
        typer.echo(text, nl=False)
    else:
        write_file(file, text)
        Talk().say(f"Parameters: {file}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal accuracy`: how far from where its controller says the platform can be.


def accuracy(
    run: Path = argument("RUN", "Folder that certify wrote, with all legs."),
    folder: Path | None = output(
        "DIR",
        "Folder for accuracy.json, accuracy.html, campaign.json and certificates; replaced there.",
        None,
        show_default="RUN/accuracy",
    ),
    workspace: str | None = option(
        None, "x=LO:HI,y=LO:HI,z=LO:HI in mm, and rx, ry, rz in degrees (default 0).", "BOX", show_default="proposed"
    ),
    poses: Path | None = option(None, "Poses: pose,x,y,z,qw,qx,qy,qz.", "CSV", show_default="the measured ones"),
    count: int = option(4, "Poses to measure next.", "N", "--next", min=0),
    assume: str | None = option(
        None, "Model error ASSUMED everywhere: one number, or one a leg.", "MM", show_default="suggested"
    ),
    cells: int = option(600, "Of the workspace, at most."),
    *,
    talk: Talk,
) -> Status:
    """How far off can the platform of a certified RUN be, at given poses or anywhere in a workspace?

    Bounds are proved under one assumption: how large the model error is at poses that nobody
    measured. It also says which poses to measure next: those where the certified sets leave most open (estimates).
    """
    from cpcal.models.platform import Workspace  # the other verbs here start sooner without
    from cpcal.questions import accuracy as questions
    from cpcal.report.accuracy_page import assumption, headline, sentences, write_accuracy

    space = None if workspace is None else Workspace.parsed(workspace)
    named = None if poses is None else questions.NamedPoses(*load_poses(poses))
    error = numbers_of(assume, float, "mm: give one, or one for each leg: 0.2,0.3,...", "--assume")
    campaign, result = load_campaign_json(run), load_result(run)

    def find(draft: Path) -> questions.Accuracy:
        if refused := refusals(run):
            raise unusable(str(run), f"is refused: {refused[0]}", "certify again")
        return questions.certify_accuracy(
            campaign,
            result,
            poses=named,
            workspace=space,
            assume=error[0] if error is not None and len(error) == 1 else error,
            cells=cells,
            next_poses=count,
            certificates=draft,
            tell=talk.progress(),
        )

    def show(found: questions.Accuracy) -> None:
        talk.say(headline(found), assumption(found), *sentences(found))

    target = run / "accuracy" if folder is None else folder
    found = answer(target, ACCURACY, find, questions.save_accuracy, write_accuracy, show, talk, campaign)
    over = found.workspace
    lost = found.refuted or any(not pose.proved for pose in found.poses) or (over is not None and over.left_out)
    return Status.UNKNOWN if lost else Status.ANSWERED
