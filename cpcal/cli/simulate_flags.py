"""The options of `cpcal simulate`, by what they belong to. None: not given; what is simulated has its own default."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any

import typer

_STUDY = "Study: the paper's experiment (--study)"
_LEGS = "Imperfect legs (--study): what seven parameters a leg leave out; 0: perfect"


def _study(metavar: str | None = None, *names: str, help: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=_STUDY)


def _leg(metavar: str, help: str) -> Any:
    return typer.Option(metavar=metavar, help=help, rich_help_panel=_LEGS)


@dataclass(frozen=True)
class CommonFlags:
    """Of campaigns and studies."""

    seed: Annotated[
        int,
        typer.Option(help="The same seed gives the same files, with the same cpcal, numpy and kind of processor."),
    ] = 1
    runs: Annotated[
        int | None, typer.Option(help="Measurements of each configuration [default: 1; of a study: 11]")
    ] = None
    random_poses: Annotated[
        int | None,
        typer.Option(
            help="Random configurations, on top of the extremal ones [default: 0], or to validate a study [64]"
        ),
    ] = None
    joint_error: Annotated[
        float, typer.Option(metavar="MM", help="Amplitude of an error that 7 parameters a leg cannot describe.")
    ] = 0.0
    noise: Annotated[float, typer.Option(help="Scale of the paper's standard deviations.")] = 1.0
    truncate: Annotated[float | None, typer.Option(help="Draw noise beyond this many standard deviations again.")] = (
        None
    )
    deviation: Annotated[
        float, typer.Option(metavar="MM", help="Standard deviation of true parameters from nominal ones.")
    ] = 1.0
    stroke: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="SHORT LONG", help="Shortest and longest reading, mm.", show_default="the robot's"),
    ] = None


@dataclass(frozen=True)
class CampaignFlags:
    """Without --study."""

    extremal: Annotated[
        bool | None, typer.Option("--extremal/--no-extremal", help="Whether to take the 64 extremal configurations.")
    ] = None
    factor: Annotated[
        float | None,
        typer.Option(help="Half-width of the reading sets in standard deviations; 0: exact readings [default: 3]"),
    ] = None


@dataclass(frozen=True)
class StudyFlags:
    """With --study."""

    validation_runs: Annotated[int | None, _study(help="Runs of each random configuration [default: 10]")] = None
    images: Annotated[
        int | None, _study(help="Rows of single images in each run [default: one row, the mean of 10]")
    ] = None
    render: Annotated[
        bool | None,
        _study(
            None,
            "--render",
            help="Write images instead of poses, for `cpcal detect`, with target.toml, camera.toml and leg readings.",
        ),
    ] = None


@dataclass(frozen=True)
class LegFlags:
    """With --study: what is imperfect about the legs."""

    axis_offset: Annotated[float | None, _leg("MM", "Distance of the two axes of each lower joint.")] = None
    joint_offset: Annotated[float | None, _leg("MM", "Offsets of the three axes of each upper joint.")] = None
    backlash: Annotated[float | None, _leg("MM", "Clearance along each leg; its side follows the load.")] = None
    friction: Annotated[
        float | None,
        _leg(
            "WEIGHTS",
            "By how many platform weights the direction of approach, random in each run, shifts the load that "
            "decides the side of the backlash [default: 0.2]",
        ),
    ] = None
    sag: Annotated[float | None, _leg("MM", "Shortening of a leg lying flat, by its weight.")] = None
    gain: Annotated[float | None, _leg("REL", "Relative error of each length sensor, about mid-stroke.")] = None


@dataclass(frozen=True)
class SimulateFlags(LegFlags, StudyFlags, CampaignFlags, CommonFlags):
    """All of them."""

    study: Annotated[bool, _study(None, "--study", help="A study: a target seen by a camera, both frames unknown.")] = (
        False
    )
    force: Annotated[bool, typer.Option("--force", help="Replace what is in a folder that is not empty.")] = False

    def given(self, *kinds: type[Any]) -> dict[str, Any]:
        """The options of these kinds that have a value."""
        names = (field.name for kind in kinds for field in fields(kind))
        return {name: value for name in names if (value := getattr(self, name)) is not None}
