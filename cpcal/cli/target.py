"""`cpcal target`: a target's file and its page to print; the default one, or one designed for another plate."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_writable
from cpcal.common.errors import InputError, Problem, printable
from cpcal.vision.files.plate_and_camera import load_target, save_target
from cpcal.vision.files.target_print import on_paper, print_target
from cpcal.vision.target import DELTALAB_TARGET, design_target, separation


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
