"""`cpcal report`, `export`, `accuracy`: a run that is checked again becomes a page, parameters, or bounds of poses."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import typer

from cpcal.cli.verbs import CAMPAIGN, FITS, RUN, TIMEOUT, Status, Talk, answer, argument, numbers_of, option, output
from cpcal.cli.verify import checked_certificates, refusals, runs_in
from cpcal.common.documents import toml_text
from cpcal.common.errors import printable, unusable
from cpcal.common.files import write_file
from cpcal.common.numbers import at_least, bracket_text, rounded_down, rounded_up
from cpcal.common.values import ArrayPair, Floats, Json
from cpcal.files import load_campaign, load_campaign_json, save_campaign_json
from cpcal.files.run_folder import ACCURACY, HANDEYE
from cpcal.files.tables import load_poses
from cpcal.questions import (
    RECORD_NAME,
    CalibrationRecord,
    LegResult,
    Result,
    load_record,
    load_result,
    model_of,
    recommendation,
    verdict_of,
)
from cpcal.questions.hand_eye import HandEyeResult, load_hand_eye_result
from cpcal.questions.points import fits_of
from cpcal.report.run_page import REPORT_NAME, command, render
from cpcal.report.study_page import StudyFound, render_study
from cpcal.report.words import FRAME, fitted, overall
from cpcal.robot import Campaign, normalised, rotation_matrix
from cpcal.simulate import true_robot

# ------------------------------------------------------------------------------------------------------------------
# What is refused has no page, and no parameters.


def _accepted(folder: Path) -> None:
    """Raises typer.Exit when something of a folder is refused, which is said, and InputError."""
    refused = refusals(folder)
    for sentence in refused:
        typer.echo(printable(f"{folder.name}: {sentence}"))
    if refused:
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
# `cpcal report`: the page of any run, or of the study that `cpcal demo` leaves, written again.


def report(
    run: Path = argument("RUN", "Folder that certify, accuracy, handeye certify or demo wrote."),
    page: Path | None = output("FILE", "The page; replaced.", None, show_default="in RUN, as it was named"),
) -> None:
    """Check a RUN as `verify` does, and write its HTML page again, from its own files.

    One self-contained file: it loads nothing, prints, and checks a leg's certificates in the browser. Of a folder that
    `cpcal demo` wrote it is the page of the whole study; its certificates are checked anew.
    """
    kind = next((kind for kind in (HANDEYE, ACCURACY) if (run / kind.head).is_file()), None)
    both = kind is None and any((inner / HANDEYE.head).is_file() for inner in runs_in(run))
    kind = HANDEYE if both else kind
    file = page or (run / REPORT_NAME if kind is None else (run / kind.head).with_suffix(".html"))
    if file.is_dir():
        raise unusable(str(file), "is a folder", "name a file, such as report.html")
    if (run / RECORD_NAME).is_file():  # the folder of a study
        write_file(file, render_study(study_found(run), run / RUN))
    else:
        _accepted(run)
        if both:
            from cpcal.report.hand_eye_page import write_both

            write_both(run, file)
        elif kind is HANDEYE:  # each kind of run loads its own page alone
            from cpcal.report.hand_eye_page import write_hand_eye

            write_hand_eye(load_hand_eye_result(run), file.parent, file.name)
        elif kind is ACCURACY:
            from cpcal.questions.accuracy import load_accuracy
            from cpcal.report.accuracy_page import write_accuracy

            write_accuracy(load_accuracy(run), file.parent, file.name)
        else:
            write_file(file, render(load_campaign_json(run), load_result(run), run=run))
    Talk().say(f"Report: {file}")


# ------------------------------------------------------------------------------------------------------------------
# `cpcal export`: parameters in the frames of the robot's drawing, where a study found camera and target in them.

DRAWING_FRAME = (
    "a: base joint centre, in the base frame of the robot's drawing; b: mobile joint centre, in its mobile frame; "
    "l: length offset. These frames are estimates of the study: certified values were moved by them, ranges are the "
    "hulls of the moved boxes."
)
_ROUNDING = 1e-9  # mm, more than moving a box in float64 can lose


class DrawingFrames(NamedTuple):
    """Camera in the base frame and target in the mobile frame: rotations (3, 3) and positions (3,), mm."""

    camera: ArrayPair
    target: ArrayPair

    def point(self, x: Floats) -> Floats:
        """Parameters (n,); those of the model, after l, stay."""
        (turn, at), (other, there) = self.camera, self.target
        return np.concatenate([turn @ x[:3] + at, other @ x[3:6] + there, x[6:]])

    def box(self, lo: Floats, hi: Floats) -> ArrayPair:
        """A box that holds all parameters of the box `lo`, `hi` (n,)."""
        middle, half = self.point(0.5 * (lo + hi)), 0.5 * (hi - lo)
        (turn, _), (other, _) = self.camera, self.target
        radius = np.concatenate([np.abs(turn) @ half[:3], np.abs(other) @ half[3:6], half[6:]])
        return middle - radius - _ROUNDING, middle + radius + _ROUNDING


def frames_of_run(result: Result, record: CalibrationRecord, where: str) -> DrawingFrames:
    """The frames of the study that the run's campaign comes from.

    Raises InputError where the record is of another, and for a model whose own parameters depend on the frames.
    """
    if record.campaign_sha256 != result.campaign.sha256:
        what = "holds the frames of another study: the SHA-256 of its campaign differs"
        raise unusable(where, what, "name the folder that cpcal calibrate wrote with the run's campaign")
    if result.model.name not in ("plain", "gain", "lateral"):
        what = f"has the model {result.model.name!r}, whose own parameters depend on the frames"
        raise unusable("run", what, "export it in the campaign's frames")
    camera, target = (
        (rotation_matrix(np.array([frame.quaternion]))[0], np.array(frame.position))
        for frame in (record.camera_in_base, record.target_in_mobile)
    )
    return DrawingFrames(camera, target)


# ------------------------------------------------------------------------------------------------------------------
# Parameters for a controller: those recommended beside least squares, with ranges, frame and provenance.

_FORMAT = "cpcal-parameters/2"
NOT_CERTIFIED = "not certified"  # the verdict where no certificate holds it


def exported(campaign: Campaign, result: Result, frames: DrawingFrames | None = None) -> Json:
    """What is exported, as texts, numbers, lists and dicts; what is not known, or in no certificate, is left out.

    `frames`: of the drawing, to which the parameters are moved. Raises InputError for a model that is not known here.
    """
    verdict, certified = overall(result), all(leg.certified for leg in result.legs)
    provenance = {
        **campaign.provenance,
        "campaign_sha256": result.campaign.sha256,
        "measurements": result.campaign.measurements,
        "cpcal": result.version,
        "command": command(result),
    }
    return _known(
        format=_FORMAT,
        robot=result.campaign.robot,
        model=result.model.name,
        not_compared=result.model.not_compared or None,
        frame=FRAME if frames is None else DRAWING_FRAME,
        tolerance=result.options.tolerance,
        verdict=None if verdict is None else verdict.word.lower() if certified else NOT_CERTIFIED,
        missing_legs=sorted({*range(1, campaign.legs + 1)} - {leg.leg for leg in result.legs}) or None,
        provenance=provenance,
        legs=[_leg(campaign, result, leg, frames) for leg in result.legs],
    )


def _leg(campaign: Campaign, result: Result, leg: LegResult, frames: DrawingFrames | None) -> Json:
    best, passes, bracket = leg.recommended, leg.passes_from, leg.bracket
    ranges = None if leg.ranges is None or leg.ranges.certificate is None else leg.ranges
    columns = {
        "nominal": np.append(campaign.robot.parameters[leg.leg - 1], np.zeros(len(result.model.extra))),
        "least_squares": fitted(campaign, result, leg, model_of(result)).x,
        "recommended": np.array(best.point),
    }
    if frames is not None:
        columns = {name: frames.point(x) for name, x in columns.items()}
    if ranges is not None:
        lo, hi = ranges.box.lo, ranges.box.hi
        columns["range_lo"], columns["range_hi"] = (lo, hi) if frames is None else frames.box(lo, hi)
    proofs = [bracket.certificate, best.certificate, ranges and ranges.certificate]
    return _known(
        leg=leg.leg,
        verdict=verdict_of(result, leg).word if leg.certified else NOT_CERTIFIED,
        recommended=recommendation(result, leg),
        largest_error=best.largest if best.certificate else None,
        passes_from=passes.eps if passes is not None and passes.certificate else None,
        not_certified=str(leg.not_certified) or None,
        eps_lo=bracket.lo if leg.certified and math.isfinite(bracket.lo) else None,
        eps_hi=bracket.hi if leg.certified and math.isfinite(bracket.hi) else None,
        range_eps=None if ranges is None else ranges.eps,
        certificates=[name for name in proofs if name],
        parameters={
            name: {"unit": result.model.unit(name), **{column: float(x[k]) for column, x in columns.items()}}
            for k, name in enumerate(result.model.parameters)
        },
    )


def _known(**fields: Any) -> Json:
    return {name: value for name, value in fields.items() if value is not None}


# ------------------------------------------------------------------------------------------------------------------
# The camera's frame of a hand-eye run, as other programs take it, with the proved ranges beside each number.
#
# What is written are the best frames found: those that attain the upper end of the bracket. Lengths are in m where the
# format has them in m.


def _told(found: HandEyeResult, mark: str) -> str:
    """What is proved, as comments."""
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    without = f", without {', '.join(found.left_out)}" if found.left_out else ""
    said = [
        f"cpcal {found.version}, {found.setup}: camera in {_PARENTS[found.setup]}; eps* in [{low}, {high}] px{without}"
    ]
    if found.ranges is not None and not found.ranges.empty:
        said.append(f"proved of all frames that explain every pixel to {at_least(found.eps, 4)} px:")
        ends = zip(_AXES, found.ranges.low, found.ranges.high, strict=False)
        for k, (name, lo, hi) in enumerate(ends):
            unit = "mm" if k < 3 else "deg from the rotation below"
            said.append(f"  {name}: {rounded_down(lo, 4)} to {rounded_up(hi, 4)} {unit}")
    return "\n".join(f"{mark} {line}" for line in said)


_PARENTS = {"eye-in-hand": "tool0", "eye-to-hand": "base_link"}
_AXES = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


def _metres(found: HandEyeResult) -> dict[str, str]:
    """Position in m and quaternion, by the names that ROS has for them."""
    (w, i, j, k), position = found.point.camera_quaternion, (v / 1000.0 for v in found.point.camera_position)
    return dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), map(repr, (*position, i, j, k, w)), strict=True))


def _ros2(found: HandEyeResult) -> str:
    """A node of a ROS 2 launch file in Python."""
    given = _metres(found) | {"frame-id": _PARENTS[found.setup], "child-frame-id": "camera_optical_frame"}
    arguments = "\n".join(f'        "--{name}", "{value}",' for name, value in given.items())
    return f"""from launch_ros.actions import Node

{_told(found, "#")}
Node(
    package="tf2_ros",
    executable="static_transform_publisher",
    arguments=[
{arguments}
    ],
)
"""


def _urdf(found: HandEyeResult) -> str:
    """A fixed joint; rpy are turns about fixed axes x, y, z in that order, rad."""
    r = rotation_matrix(normalised(found.point.camera_quaternion)).tolist()
    roll, yaw = math.atan2(r[2][1], r[2][2]), math.atan2(r[1][0], r[0][0])
    pitch, xyz = math.asin(max(-1.0, min(1.0, -r[2][0]))), " ".join([*_metres(found).values()][:3])
    return f"""<!--
{_told(found, "  ")}
-->
<joint name="camera_optical_joint" type="fixed">
  <parent link="{_PARENTS[found.setup]}"/>
  <child link="camera_optical_frame"/>
  <origin xyz="{xyz}" rpy="{roll!r} {pitch!r} {yaw!r}"/>
</joint>
"""


def _opencv(found: HandEyeResult) -> str:
    """Matrices of both frames for cv::FileStorage, translations in mm, named as OpenCV's functions name them."""
    point, in_hand = found.point, found.setup == "eye-in-hand"
    camera, target = ("cam2gripper", "target2base") if in_hand else ("cam2base", "target2gripper")
    lines = ["%YAML:1.0", "---", _told(found, "#")]
    for name, position, quaternion in (
        (camera, point.camera_position, point.camera_quaternion),
        (target, point.target_position, point.target_quaternion),
    ):
        turn = rotation_matrix(normalised(quaternion)).ravel().tolist()
        for letter, columns, values in (("R", 3, turn), ("t", 1, position)):
            lines += [f"{letter}_{name}: !!opencv-matrix", "  rows: 3", f"  cols: {columns}", "  dt: d"]
            lines += [f"  data: [ {', '.join(map(repr, values))} ]"]
    return "\n".join(lines) + "\n"


HAND_EYE_FORMS: dict[str, Callable[[HandEyeResult], str]] = {
    "ros2": _ros2,
    "urdf": _urdf,
    "opencv": _opencv,
}


# ------------------------------------------------------------------------------------------------------------------
# `cpcal export`: the parameters of a run for a controller.

Format = Literal["toml", "json", "ros2", "urdf", "opencv"]


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
    run the camera's frame is written as ros2, urdf (in m) or opencv.
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
        save_campaign_json(campaign, draft)
        return questions.certify_accuracy(
            campaign,
            result,
            poses=named,
            workspace=space,
            assume=error,
            cells=cells,
            next_poses=count,
            certificates=draft,
            tell=talk.progress(),
        )

    found = answer(
        run / "accuracy" if folder is None else folder,
        ACCURACY,
        find,
        questions.save_accuracy,
        write_accuracy,
        lambda found: talk.say(headline(found), assumption(found), *sentences(found)),
        talk,
    )
    over = found.workspace
    lost = found.refuted or any(not pose.proved for pose in found.poses) or (over is not None and over.left_out)
    return Status.UNKNOWN if lost else Status.ANSWERED
