"""`cpcal export`: the parameters of a run for a controller."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.calibration import load_record
from cpcal.cli.folders import check_writable, output_path
from cpcal.cli.report import checked_run
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import write_file
from cpcal.files.run_folder import HANDEYE
from cpcal.handeye.certify import load_hand_eye_result
from cpcal.handeye.verify import verify_hand_eye
from cpcal.report.export import WRITERS, exported
from cpcal.report.hand_eye_export import HAND_EYE_FORMS, hand_eye_text
from cpcal.report.leg_section import frames_of_run


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
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            parser=output_path,
            help="The file; replaced.",
            show_default="print",
        ),
    ] = None,
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
    if output is not None:
        check_writable(output.parent)
    hand_eye = (run / HANDEYE.head).exists()
    chosen = _chosen(format, output, [Format(name) for name in (HAND_EYE_FORMS if hand_eye else WRITERS)])
    text = _hand_eye(run, chosen) if hand_eye else _legs(run, chosen, frames)
    if output is None:
        typer.echo(text, nl=False)
    else:
        write_file(output, text)
        typer.echo(f"Parameters: {output}")


def _chosen(asked: Format | None, output: Path | None, known: list[Format]) -> Format:
    """One of the formats `known` of a run: what was asked for, or what the file's name says. Raises InputError."""
    suffix = "" if output is None else output.suffix.lower()
    fit = [form for form in known if suffix in _SUFFIXES[form]]
    names = f"of this run write one of {', '.join(known)}"
    if asked is None and len(fit) == 1:
        return fit[0]
    if asked is None and not suffix and Format.TOML in known:
        return Format.TOML
    if asked is None:
        what = f"is missing, and the name {output.name} does not say it" if output is not None else "is missing"
        raise InputError([Problem("option --format", what, names)])
    if asked not in known:
        raise InputError([Problem("option --format", f"is {asked}", names)])
    if asked not in fit and any(suffix in some for some in _SUFFIXES.values()):
        what, remedy = (
            f"is {output}, and the format {asked}",
            f"call the file *{_SUFFIXES[asked][0]}, or leave --format out",
        )
        raise InputError([Problem("option --output", what, remedy)])
    return asked


def _legs(run: Path, format: Format, frames: Path | None) -> str:
    campaign, result = checked_run(run)
    moved = None if frames is None else frames_of_run(result, load_record(frames), str(frames))
    return WRITERS[format.value](exported(campaign, result, moved))


def _hand_eye(run: Path, format: Format) -> str:
    """Raises InputError where the run is refused."""
    refused = [sentence for accepted, sentence in verify_hand_eye(run) if not accepted]
    if refused:
        raise InputError([Problem(str(run), refused[0], "run cpcal handeye again")])
    return hand_eye_text(load_hand_eye_result(run), format.value)
