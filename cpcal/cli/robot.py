"""`cpcal robot`: the catalogue of robots, and a campaign.toml to fill in."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.files import write_file
from cpcal.files import settings_template
from cpcal.robot import ROBOTS


class Action(StrEnum):
    INIT = "init"
    LIST = "list"


def robot(
    action: Annotated[Action, typer.Argument(help="list: the robots that cpcal knows. init: a campaign.toml.")],
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A known robot, or what your own is to be called.")
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="The file for init, which must not be there yet.")
    ] = Path("campaign.toml"),
    legs: Annotated[int, typer.Option(help="Legs of your own robot.")] = 6,
) -> None:
    """List the robots with published dimensions, or write a commented campaign.toml to fill in for a robot.

    Example: `cpcal robot init deltalab -o table.toml`, or `cpcal robot init "our crane" --legs 8`
    """
    if action is Action.LIST:
        for key, known in ROBOTS.items():
            typer.echo(printable(f"{key}: {known.robot.name}, {known.robot.legs} legs. {known.source}"))
        return
    if name is None:
        raise InputError([Problem("robot init", "lacks a name", "name a known robot, or your own")])
    if os.path.lexists(output):
        raise InputError([Problem(str(output), "is there already", "choose another file with -o, or remove it")])
    text = settings_template(name, legs)
    write_file(output, text)
    typer.echo(printable(f"{output}: replace every nan, then use it as --robot of `cpcal import`, or as it stands."))
