"""`cpcal certify`: the main job. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.folders import check_writable
from cpcal.cli.run import Question, answer, publish, status_of
from cpcal.cli.suspected import read_campaign


class Center(StrEnum):
    FIT = "fit"
    PLAIN = "plain"
    NOMINAL = "nominal"


class Engine(StrEnum):
    FLOAT64 = "float64"
    ARB = "arb"


class Method(StrEnum):
    BOUND = "bound"
    TIMEOUT = "timeout"


class Support(StrEnum):
    FEW = "few"
    IRREDUCIBLE = "irreducible"


def certify(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
    run: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="RUN",
            help="Folder for result.json, report.html and certificates; replaced there.",
        ),
    ],
    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None,
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of parameters.")] = 100.0,
    center: Annotated[Center, typer.Option(help="Middle of that box: a least-squares fit, or nominal.")] = Center.FIT,
    gap: Annotated[float, typer.Option(help="Relative width at which the bracket counts as closed.")] = 1e-6,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg, at most.")] = None,
    contractors: Annotated[str, typer.Option(metavar="A,B", help="See `cpcal plugins`.")] = "lifted",
    arithmetic: Annotated[Engine, typer.Option(help="Rigorous arithmetic.")] = Engine.FLOAT64,
    eps: Annotated[
        float | None, typer.Option(metavar="MM", help="Ask instead whether any parameters reach this eps.")
    ] = None,
    support: Annotated[
        Support, typer.Option(help="Few measurements that prove the bound alone, or none that could be left out.")
    ] = Support.FEW,
    method: Annotated[
        Method, typer.Option(help="Branch and bound on eps, or the paper's script; that needs a time limit.")
    ] = Method.BOUND,
    model: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Leg model, such as plain or gain.", show_default="the campaign's"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json and nothing else.")] = False,
) -> None:
    """Bracket, leg by leg, the smallest model error eps of a CAMPAIGN, by proofs from both sides.

    A leg's parameters reach eps when for every measurement THERE EXISTS a reading in its set at which the leg
    equation is off by at most eps (mm). With --eps the question is whether any parameters in the box do.
    """
    check_writable(run)
    question = Question(
        legs=None if legs is None else numbers_of(legs),
        delta=delta,
        center=center.value,
        gap=gap,
        time_limit=time_limit,
        contractors=tuple(name.strip() for name in contractors.split(",") if name.strip()),
        arithmetic=arithmetic.value,
        eps=eps,
        support=support.value,
        method=method.value,
        model=model,
    )
    measured = read_campaign(campaign)
    result = answer(measured, question, run, quiet=as_json)
    publish(measured, result, run, as_json=as_json)
    raise typer.Exit(status_of(result))


def numbers_of(text: str) -> tuple[int, ...]:
    """The numbers of --legs. Raises BadParameter."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        message = f"{text!r} is no list of legs: give numbers with commas between them, such as 1,3"
        raise typer.BadParameter(message, param_hint="--legs") from None
