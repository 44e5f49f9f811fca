"""`cpcal export`: the parameters of a run for a controller."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.calibration import load_record
from cpcal.cli.folders import check_writable, output_path
from cpcal.cli.report import checked_run
from cpcal.common.atomic import write_file
from cpcal.report.drawing_frames import DrawingFrames
from cpcal.report.export import WRITERS, exported


class Format(StrEnum):
    TOML = "toml"
    JSON = "json"
    YAML = "yaml"
    CSV = "csv"


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that certify wrote.")],
    format: Annotated[Format, typer.Option("--format", "-f", help="Of what is written.")] = Format.TOML,
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
            help="Folder of calibration.json: write the drawing's frames instead of camera's and target's.",
        ),
    ] = None,
) -> None:
    """Check a RUN as `verify` does, and write its parameters: certified, with ranges, and of least squares.

    Beside each number stand unit and frame; what a proof does not hold is left out. Lengths are in mm.
    """
    if output is not None:
        check_writable(output.parent)
    campaign, result = checked_run(run)
    found = exported(campaign, result, None if frames is None else DrawingFrames.of(load_record(frames)))
    text = WRITERS[format.value](found)
    if output is None:
        typer.echo(text, nl=False)
    else:
        write_file(output, text)
        typer.echo(f"Parameters: {output}")
