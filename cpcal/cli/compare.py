"""`cpcal compare`: leg models side by side. For exit statuses see `cpcal.cli`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cpcal.cli.certify import STYLES, Engine, names_of, numbers_of
from cpcal.cli.folders import check_target, output_path
from cpcal.cli.grouped import grouped
from cpcal.cli.running import Where
from cpcal.cli.status import Status
from cpcal.cli.suspected import read_campaign
from cpcal.cli.talk import Talk, record, talking
from cpcal.common.errors import InputError, printable
from cpcal.common.numbers import nearest
from cpcal.execution.executors import Place
from cpcal.execution.stopping import Reason, asked
from cpcal.files.run_folder import COMPARED as FOLDER
from cpcal.files.run_folder import answers_into
from cpcal.questions import COMPARED, Comparison, Entry, Explained, comparison_text, save_comparison
from cpcal.questions.compare import compared, comparison_question
from cpcal.report.comparison_page import (
    COMPARISON_PAGE,
    comparison_header,
    comparison_lines,
    comparison_row,
    comparison_sentences,
    said,
    write_comparison,
)
from cpcal.report.words import SHORT_QUANTIFIER
from cpcal.robot import Campaign


@dataclass(frozen=True)
class CompareFlags(Where):
    """The options of the command line: those of `cpcal.compare`, and where it runs."""

    models: Annotated[str, typer.Option(metavar="A,B", help="Leg models.")] = ",".join(COMPARED)
    tolerance: Annotated[float | None, typer.Option(metavar="MM", help="Say which models are refuted at it.")] = None
    legs: Annotated[str | None, typer.Option(metavar="1,3", help="Legs, counted from 1.", show_default="all")] = None
    delta: Annotated[float, typer.Option(metavar="MM", help="Half-width of the box of (a, b, l).")] = 100.0
    gap: Annotated[float, typer.Option(help="Relative width at which a bracket counts as closed.")] = 1e-6
    time_limit: Annotated[float | None, typer.Option(metavar="S", help="Seconds a leg and model, at most.")] = None
    arithmetic: Annotated[Engine, typer.Option(help="Rigorous arithmetic.")] = Engine.FLOAT64


@talking
@grouped(CompareFlags)
def compare_models(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Folder of campaign.toml, measurements.csv.")],
    folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            parser=output_path,
            help="Folder for compare.json, compare.html, campaign.json and certificates; replaced there.",
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print compare.json and nothing else.")] = False,
    *,
    options: CompareFlags,
    talk: Talk,
) -> None:
    """Bracket the smallest model error eps of every leg of a CAMPAIGN under each of several leg models.

    With --tolerance it says which models the measurements refute at that many mm, and which certificate proves it; the
    exit status is then 0 if every leg has a model that passes, else 1: one has none, or is undecided.
    """
    legs = None if options.legs is None else numbers_of(options.legs)
    check_target(folder, FOLDER, campaign)
    if as_json:
        talk = replace(talk, quiet=True)
    with options.place() as place:
        found, failure = _written(read_campaign(campaign), options, legs, folder, talk, place)
        status = _status(found)
    if as_json:
        typer.echo(comparison_text(found), nl=False)
    _show(talk.out, found, verbose=talk.verbose)
    if failure is not None:
        raise failure
    talk.say(f"Page: {folder / COMPARISON_PAGE}")
    raise typer.Exit(status)


def _written(
    campaign: Campaign, options: CompareFlags, legs: tuple[int, ...] | None, folder: Path, talk: Talk, place: Place
) -> tuple[Comparison, InputError | None]:
    """What was found, and why it could not be written."""
    question, models = comparison_question(
        campaign,
        names_of(options.models),
        tolerance=options.tolerance,
        legs=legs,
        delta=options.delta,
        gap=options.gap,
        time_limit=options.time_limit,
        arithmetic=options.arithmetic.value,
    )
    errors = talk.errors

    def tell(entry: Entry) -> None:
        record("entry", subject=entry.subject, model=entry.model, eps_lo=entry.eps_lo, eps_hi=entry.eps_hi)
        errors.print(f"{entry.subject}, {entry.model}: {nearest(entry.seconds, 1)} s", soft_wrap=True)

    found: Comparison | None = None
    try:
        with answers_into(folder, FOLDER, campaign) as draft:
            found = compared(replace(question, certificates=draft), models, tell, place)
            save_comparison(found, draft)
            write_comparison(found, draft)
    except InputError as error:
        if found is None:
            raise
        return found, error
    return found, None


def _show(console: Console, found: Comparison, *, verbose: bool) -> None:
    wrapped = not console.is_terminal
    if not verbose:
        for line in comparison_lines(found):
            console.print(line, soft_wrap=wrapped)
        console.print(Text(SHORT_QUANTIFIER, style="italic"), soft_wrap=wrapped)
        return
    console.print(_table(found))
    for sentence in comparison_sentences(found):
        console.print(printable(sentence), soft_wrap=wrapped)
    console.print(Text(said(found), style="italic"), soft_wrap=wrapped)


def _table(found: Comparison) -> Table:
    """Without the enclosures of extra parameters, which are too wide for a terminal but for a single one."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for k, name in enumerate(comparison_header(found)):
        table.add_column(name, justify="right" if k in (2, 3) else "left", overflow="fold")
    for entry in found.entries:
        cells = [Text(printable(cell)) for cell in comparison_row(found, entry)]
        if found.tolerance is not None:
            cells[4].stylize(STYLES[entry.leg_verdict(found.tolerance, found.options).kind])
        if len(entry.enclosure.names) > 8:
            cells[6] = Text(f"{len(entry.enclosure.names) - 7}, see the page", style="dim")
        table.add_row(*cells)
    return table


def _status(found: Comparison) -> Status:
    """Without a tolerance every bracket is an answer; with one, each leg needs a model that passes."""
    if found.interrupted:
        return Status(asked() or Reason.INTERRUPTED)
    at, subjects = found.tolerance, {entry.subject for entry in found.entries}
    if at is None:
        return Status.ANSWERED
    passed = {entry.subject for entry in found.entries if isinstance(entry.leg_verdict(at, found.options), Explained)}
    return Status.ANSWERED if passed == subjects else Status.UNKNOWN
