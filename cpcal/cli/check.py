"""`cpcal check`: is the data good enough before a long run?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from cpcal.cli.status import Status
from cpcal.cli.terminal import terminal
from cpcal.common.errors import printable
from cpcal.common.numbers import about
from cpcal.files import load_campaign
from cpcal.legs import PLAIN
from cpcal.questions.data_check import DataCheck, check_data, expected
from cpcal.robot import Campaign


def check(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
) -> None:
    """Look for what is wrong with a CAMPAIGN before it is certified: units, orders, frames, odd rows, open parameters.

    Says what each leg's parameters can be expected to be known to. Estimates in floating point: nothing is proved.
    """
    loaded = load_campaign(campaign)
    found = check_data(loaded)
    show_check(terminal(), loaded, found)
    raise typer.Exit(Status.ANSWERED if found.good else Status.UNKNOWN)


def show_check(console: Console, campaign: Campaign, found: DataCheck) -> None:
    """The table of legs, and a line for each finding."""
    wrap = not console.is_terminal
    console.print(printable(f"{campaign.robot.name}: {len(campaign):,} measurements, {campaign.legs} legs"))
    off = ", ".join(about(value, 2) for value in found.nominal)
    console.print(f"At the nominal parameters the legs are off by {off} mm (median of each leg).", soft_wrap=wrap)
    if found.legs:
        console.print(_table(found))
        console.print(f"Expected: {_meaning(campaign)}", soft_wrap=wrap)
    for finding in found.findings:
        console.print(f"! {finding.sentence}", soft_wrap=wrap)
    if found.good:
        console.print("Nothing looks wrong. Next: cpcal certify CAMPAIGN -o RUN", soft_wrap=wrap)


def _meaning(campaign: Campaign) -> str:
    if campaign.exact:
        return "readings are called exact, so only the model error leaves parameters a range."
    return "mm, by how far the reading sets leave each parameter open if the model is right; runs come out narrower."


def _table(found: DataCheck) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in ("leg", "rank", "condition", "index O1", *PLAIN.parameters):
        table.add_column(name, justify="right")
    for leg in found.legs:
        indices = leg.observability
        rank = f"{leg.determination.rank} of {leg.determination.of}"
        table.add_row(str(leg.leg), rank, about(indices.condition, 2), about(indices.product, 2), *expected(leg))
    return table
