"""`cpcal certify`: the main job. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cpcal.cli.certified_run import certified_into, status_of
from cpcal.cli.folders import check_target, check_writable, output_path
from cpcal.cli.grouped import grouped
from cpcal.cli.many_campaigns import CampaignWork, certified_all
from cpcal.cli.running import Running
from cpcal.cli.suspected import read_campaign
from cpcal.cli.talk import Talk, talking
from cpcal.common.errors import InputError, Problem
from cpcal.files.run_folder import RUN


class Center(StrEnum):
    FIT = "fit"
    PLAIN = "plain"
    NOMINAL = "nominal"


class Engine(StrEnum):
    FLOAT64 = "float64"
    ARB = "arb"


class MethodName(StrEnum):
    BOUND = "bound"
    TIMEOUT = "timeout"


class Support(StrEnum):
    FEW = "few"
    IRREDUCIBLE = "irreducible"
    NONE = "none"


@dataclass(frozen=True)
class CertifyFlags(Running):
    """The options of the command line: those of `cpcal.certify`, and where it runs."""

    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of parameters.")] = 100.0
    center: Annotated[Center, typer.Option(help="Middle of that box: a least-squares fit, or nominal.")] = Center.FIT
    gap: Annotated[float, typer.Option(help="Relative width at which the bracket counts as closed.")] = 1e-6
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg, at most.")] = None
    node_limit: Annotated[int | None, typer.Option(metavar="N", min=1, help="Boxes a leg, at most.")] = None
    contractors: Annotated[str, typer.Option(metavar="A,B", help="See `cpcal plugins`.")] = "lifted"
    arithmetic: Annotated[Engine, typer.Option(help="Rigorous arithmetic.")] = Engine.FLOAT64
    eps: Annotated[
        float | None, typer.Option(metavar="MM", help="Ask instead whether any parameters reach this eps.")
    ] = None
    tolerance: Annotated[
        float | None, typer.Option(metavar="MM", help="The error that the legs may have: each passes or fails.")
    ] = None
    support: Annotated[
        Support, typer.Option(help="Few measurements that prove the bound alone, or none that could be left out.")
    ] = Support.FEW
    method: Annotated[
        MethodName,
        typer.Option(help="Branch and bound on eps, or the paper's timeout method; that needs a time limit."),
    ] = MethodName.BOUND
    model: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Leg model, such as plain or gain.", show_default="the campaign's"),
    ] = None
    half_width: Annotated[
        list[str] | None, typer.Option(metavar="NAME=X", help="Of an extra parameter of the model; repeat for others.")
    ] = None

    def given(self) -> dict[str, object]:
        """The keyword arguments of `cpcal.certify`. Raises BadParameter."""
        return {
            "legs": None if self.legs is None else numbers_of(self.legs),
            "delta": self.delta,
            "center": self.center.value,
            "gap": self.gap,
            "time_limit": self.time_limit,
            "node_limit": self.node_limit,
            "contractors": names_of(self.contractors),
            "arithmetic": self.arithmetic.value,
            "eps": self.eps,
            "tolerance": self.tolerance,
            "support": self.support.value,
            "method": self.method.value,
            "model": self.model,
            "half_widths": half_widths_of(self.half_width or []),
        }


@talking
@grouped(CertifyFlags)
def certify(
    campaigns: Annotated[
        list[Path], typer.Argument(metavar="CAMPAIGN...", help="Folders of campaign.toml, measurements.csv.")
    ],
    run: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="RUN",
            parser=output_path,
            help="Folder for result.json, campaign.json, report.html and certificates; replaced there. Of several "
            "campaigns each has a folder in it.",
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json and nothing else.")] = False,
    no_checker: Annotated[bool, typer.Option("--no-checker", help="A page that does not check itself.")] = False,
    *,
    options: CertifyFlags,
    talk: Talk,
) -> None:
    """Bracket, leg by leg, the smallest model error eps of each CAMPAIGN, by proofs from both sides.

    A leg's parameters reach eps when for every measurement THERE EXISTS a reading in its set at which the leg
    equation is off by at most eps (mm). With --eps the question is whether any parameters in the box do.
    With --tolerance the exit status is 0 if every leg passes, else 1: one fails, or is undecided.

    Ctrl-C, SIGTERM and limits end it with what is proved until then, and certificates of that.
    """
    given = options.given()
    if len(campaigns) > 1:
        if as_json:
            raise InputError([Problem("option --json", "prints one result", "read summary.csv, or name one campaign")])
        check_writable(run)
        work = CampaignWork(given, checker=not no_checker, resume=options.resume)
        with options.place() as place:
            status = certified_all(campaigns, run, work, place, talk=talk)
        raise typer.Exit(status)
    (campaign,) = campaigns
    check_target(run, RUN, campaign)
    with options.place() as place:
        result = certified_into(
            run,
            read_campaign(campaign),
            given,
            as_json=as_json,
            talk=talk,
            checker=not no_checker,
            place=place,
            resume=options.resume,
        )
        status = status_of(result)
    raise typer.Exit(status)


def names_of(text: str) -> tuple[str, ...]:
    """Names with commas between them."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def numbers_of(text: str) -> tuple[int, ...]:
    """The numbers of --legs. Raises BadParameter."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        message = f"{text!r:.60} is no list of legs: give numbers with commas between them, such as 1,3"
        raise typer.BadParameter(message, param_hint="--legs") from None


def half_widths_of(texts: list[str]) -> dict[str, float]:
    """The values of --half-width. Raises BadParameter."""
    out = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            out[name.strip()] = float(number)
        except ValueError:
            message = f"{text!r:.60} is no half-width: give a name and a number, such as s=0.01"
            raise typer.BadParameter(message, param_hint="--half-width") from None
    return out
