"""`cpcal compare`: leg models side by side. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table
from rich.text import Text

from cpcal.certify import COMPARED, compare
from cpcal.cli.certify import Engine, numbers_of
from cpcal.cli.folders import check_writable, unwritable
from cpcal.cli.show import terminal
from cpcal.cli.status import Status
from cpcal.cli.suspected import read_campaign
from cpcal.errors import printable
from cpcal.numbers import nearest
from cpcal.report.comparison import (
    COMPARISON_PAGE,
    comparison_header,
    comparison_row,
    comparison_sentences,
    said,
    write_comparison,
)
from cpcal.results import Comparison, Entry, save_comparison
from cpcal.solver.contract import Verdict

_STYLES = {Verdict.PROVED: "bold green", Verdict.REFUTED: "bold red", Verdict.UNKNOWN: "bold yellow"}


def compare_models(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
    folder: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Folder for compare.json, compare.html, certificates; replaced there."
        ),
    ],
    models: Annotated[str, typer.Option(metavar="A,B", help="Leg models.")] = ",".join(COMPARED),
    tolerance: Annotated[float | None, typer.Option(metavar="MM", help="Say which models are refuted at it.")] = None,
    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None,
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of (a, b, l).")] = 100.0,
    gap: Annotated[float, typer.Option(help="Relative width at which a bracket counts as closed.")] = 1e-6,
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg and model, at most.")] = None,
    arithmetic: Annotated[Engine, typer.Option(help="Rigorous arithmetic.")] = Engine.FLOAT64,
    as_json: Annotated[bool, typer.Option("--json", help="Print compare.json and nothing else.")] = False,
) -> None:
    """Bracket the smallest model error eps of every leg of a CAMPAIGN under each of several leg models.

    With --tolerance it says which models the measurements refute at that many mm, and which certificate proves it.
    """
    check_writable(folder)
    names = [name.strip() for name in models.split(",") if name.strip()]
    console, errors = terminal(), terminal(stderr=True)

    def tell(entry: Entry) -> None:
        if errors.is_terminal and not as_json:
            errors.print(f"{entry.subject}, {entry.model}: {nearest(entry.seconds, 1)} s")

    found = compare(
        read_campaign(campaign),
        names,
        tolerance=tolerance,
        legs=None if legs is None else numbers_of(legs),
        delta=delta,
        gap=gap,
        time_limit=time_limit,
        arithmetic=arithmetic.value,
        certificates=folder,
        progress=tell,
    )
    failure: OSError | None = None
    try:
        (folder / COMPARISON_PAGE).unlink(missing_ok=True)
        save_comparison(found, folder)
        write_comparison(found, folder)
    except OSError as error:
        failure = error
    if as_json:
        typer.echo(json.dumps(found.to_json(), indent=1, allow_nan=False))
    else:
        console.print(_table(found))
        for sentence in comparison_sentences(found):
            console.print(printable(sentence), soft_wrap=not console.is_terminal)
        console.print(Text(said(found), style="italic"), soft_wrap=not console.is_terminal)
    if failure is not None:
        raise unwritable(folder, failure)
    if not as_json:
        console.print(f"Page: {folder / COMPARISON_PAGE}", soft_wrap=True)
    raise typer.Exit(_status(found))


def _table(found: Comparison) -> Table:
    """Without the enclosures of extra parameters, which are too wide for a terminal but for a single one."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for k, name in enumerate(comparison_header(found)):
        table.add_column(name, justify="right" if k in (2, 3) else "left", overflow="fold")
    for entry in found.entries:
        cells = [Text(printable(cell)) for cell in comparison_row(found, entry)]
        if found.tolerance is not None:
            cells[4].stylize(_STYLES[entry.verdict(found.tolerance)])
        if len(entry.enclosure.names) > 8:
            cells[6] = Text(f"{len(entry.enclosure.names) - 7}, see the page", style="dim")
        table.add_row(*cells)
    return table


def _status(found: Comparison) -> Status:
    """As of `certify`; without a tolerance every bracket is an answer."""
    if found.interrupted:
        return Status.INTERRUPTED
    at = found.tolerance
    unknown = at is not None and any(e.verdict(at) is Verdict.UNKNOWN for e in found.entries)
    return Status.UNKNOWN if unknown else Status.ANSWERED
