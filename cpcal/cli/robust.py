"""`cpcal robust`: brackets when some measurements may be wrong. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cpcal.cli.certify import Center, numbers_of
from cpcal.cli.folders import check_target, output_path
from cpcal.cli.grouped import grouped
from cpcal.cli.running import Where
from cpcal.cli.status import Status
from cpcal.cli.suspected import read_campaign
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.numbers import bracket_text
from cpcal.files.run_folder import ROBUST
from cpcal.questions.outliers import certify_robust
from cpcal.questions.robust_result import RobustResult


@talking
@grouped(Where, "where")
def robust_brackets(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
    folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            parser=output_path,
            help="Folder for robust.json, campaign.json and certificates; replaced there.",
        ),
    ],
    outliers: Annotated[int, typer.Option(help="Measurements of a leg that may be wrong, at most.")],
    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None,
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of parameters.")] = 100.0,
    center: Annotated[
        Center,
        typer.Option(help="Middle of that box: a least-squares fit, which gross errors move, or nominal."),
    ] = Center.FIT,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg, at most.")] = None,
    model: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Leg model, such as plain or gain.", show_default="the campaign's"),
    ] = None,
    *,
    where: Where,
    talk: Talk,
) -> None:
    """Bracket the smallest model error of a CAMPAIGN's legs when some measurements may be wrong, nobody knows which.

    Proved: whichever so many are left out, no parameters explain all others better than eps_lo. The point explains all
    but those that are named.
    """
    check_target(folder, ROBUST, campaign)
    with where.stoppable():
        found = certify_robust(
            read_campaign(campaign),
            outliers=outliers,
            legs=None if legs is None else numbers_of(legs),
            delta=delta,
            center=center.value,
            time_limit=time_limit,
            model=model,
            certificates=folder,
            tell=talk.progress(),
            workers=where.workers,
            scheduler=where.scheduler,
        )
    for leg in found.legs:
        record("leg", leg=leg.leg, eps_lo=leg.eps_lo, eps_hi=leg.eps_hi, left_out=leg.left_out, seconds=leg.seconds)
    _show(talk.out, found)
    raise typer.Exit(Status.ANSWERED if all(leg.complete for leg in found.legs) else Status.UNKNOWN)


def _show(console: Console, found: RobustResult) -> None:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("leg", "eps_lo [mm]", "eps_hi [mm]", "left out", "proofs"):
        table.add_column(name, justify="right" if name.startswith("eps") else "left", overflow="fold")
    for leg in found.legs:
        bounds = bracket_text(leg.eps_lo, leg.eps_hi)
        table.add_row(str(leg.leg), *bounds, ", ".join(leg.left_out) or "none", str(len(leg.proofs)))
    console.print(table)
    for leg in found.legs:
        console.print(f"Leg {leg.leg}: {leg.sentence}", soft_wrap=not console.is_terminal)
    said = f"Whichever {found.outliers} measurements of a leg are wrong, no parameters in the box explain the others"
    console.print(f"{said} better than eps_lo; some explain all but those left out to within eps_hi.", soft_wrap=True)
