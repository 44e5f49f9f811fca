"""`cpcal camera`: a camera from one kind of file to another."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_writable
from cpcal.common.atomic import write_file
from cpcal.common.errors import InputError, Problem, printable
from cpcal.vision.files.plate_and_camera import YAML_SUFFIXES, camera_yaml, load_camera, save_camera


class Style(StrEnum):
    """Who reads the YAML."""

    OPENCV = "opencv"
    ROS = "ros"


def camera(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="camera.toml, or a YAML file of OpenCV or ROS.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Ends in .toml, .yaml or .yml.")],
    style: Annotated[Style, typer.Option("--as", help="Who shall read the YAML.")] = Style.ROS,
) -> None:
    """Rewrite a camera: OpenCV's and ROS's YAML to camera.toml, and back."""
    record = load_camera(source)
    check_writable(output.absolute().parent)
    if output.suffix == ".toml":
        save_camera(record, output)
    elif output.suffix in YAML_SUFFIXES:
        write_file(output, camera_yaml().camera_yaml(record.camera, style.value))
    else:
        raise InputError([Problem(str(output), "is neither a .toml nor a .yaml file", "name it so")])
    seen = record.camera
    leaves_covariance = record.covariance is not None and output.suffix != ".toml"
    lost = "; the covariance is in camera.toml only" if leaves_covariance else ""
    typer.echo(f"{seen.width} x {seen.height} pixels, lens {seen.model}: {printable(output)}{lost}")
