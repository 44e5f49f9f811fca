"""`cpcal camera`: a camera from one kind of file to another."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_writable
from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.files import write_file
from cpcal.vision.files.plate_and_camera import (
    YAML_SUFFIXES,
    camera_yaml,
    load_camera,
    load_target,
    save_camera,
    save_target,
)
from cpcal.vision.files.target_print import on_paper, print_target
from cpcal.vision.target import DELTALAB_TARGET, design_target, separation


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


# ------------------------------------------------------------------------------------------------------------------
# `cpcal target`: a target's file and its page to print; the default one, or one designed for another plate.


class Paper(StrEnum):
    """Sheets to print on."""

    A4 = "a4"
    A3 = "a3"
    A2 = "a2"
    A1 = "a1"
    A0 = "a0"
    LETTER = "letter"


def target(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="What to write: target.toml, or a .pdf or .svg page.")
    ],
    source: Annotated[
        Path | None, typer.Option("--from", metavar="FILE", help="Print the target of this target.toml.")
    ] = None,
    side: Annotated[
        float | None, typer.Option(metavar="MM", help="Design one: side of the square that holds the dots' centres.")
    ] = None,
    pitch: Annotated[float, typer.Option(metavar="MM", help="Of the designed grid.")] = 25.0,
    radius: Annotated[float, typer.Option(metavar="MM", help="Of the designed dots.")] = 6.0,
    dark: Annotated[bool, typer.Option("--dark", help="Design dark dots on a bright plate.")] = False,
    seed: Annotated[int, typer.Option(help="Of the search for the spacings.")] = 1,
    paper: Annotated[
        Paper | None,
        typer.Option(help="Sheet to print on; the default target is made to fit it."),
    ] = None,
) -> None:
    """Write a target: a grid of dots whose two diagonals tell where its axes are, whatever it is seen from.

    Without --from, --side and --paper it is the one that the demo's images show, 300 mm wide, on A2.
    """
    if source is not None and side is not None:
        raise InputError([Problem("options", "--from and --side exclude each other", "give one of them")])
    check_writable(output.absolute().parent)
    if source is not None:
        plate = load_target(source)
    elif side is not None:
        name = f"asymmetric dots, {side:g} mm square"
        plate = design_target(name, side=side, pitch=pitch, radius=radius, bright=not dark, seed=seed)
    else:
        plate = DELTALAB_TARGET if paper is None else on_paper(DELTALAB_TARGET, paper.value)
    if output.suffix == ".toml":
        save_target(plate, output)
    else:
        print_target(plate, output, None if paper is None else paper.value)
    told = f"; separation of its diagonals {separation(plate).least:.3g}" if plate.lines else ""
    typer.echo(f"{printable(plate.name)}: {len(plate.dots)} dots{told}: {printable(output)}")
