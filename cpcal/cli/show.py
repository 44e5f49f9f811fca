"""What is printed at the end: a line a leg; with --verbose every table, and the sentences in full."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cpcal.common.errors import printable
from cpcal.common.numbers import bracket_text, nearest, rounded_down, rounded_up, stated
from cpcal.legs import LegModel
from cpcal.report import FRAME, LONGER, QUANTIFIER, center_sentence, leg_sentence, notices, result_table
from cpcal.report.advice import advise
from cpcal.report.fitted import fitted
from cpcal.report.words import SHORT_QUANTIFIER, overall, short_fit, uncertified_legs
from cpcal.results import LegResult, Result, verdict_of
from cpcal.robot import Campaign

STYLES = {  # by the kind of a verdict
    "explained": "bold green",
    "unexplained": "bold red",
    "bounded": "bold cyan",
    "undecided": "bold yellow",
    "undetermined": "bold magenta",
    "uncompared": "bold yellow",
}
_MOST_LEGS = 6  # of which each has a line
_DECIMALS = 4  # of parameters, mm


def show_result(
    console: Console, campaign: Campaign, result: Result, model: LegModel, *, verbose: bool = False
) -> None:
    """The answer in ten lines at most, or all of it."""
    title = Text(f"{printable(result.robot)}: {result.measurements:,} measurements", style="bold")
    verdict = overall(result)
    if verdict is not None:
        title.append(f"; tolerance {stated(result.options.tolerance or 0.0)} mm: ")
        title.append(verdict.word, style=STYLES[verdict.kind])
    console.print(title, soft_wrap=True)
    if verbose:
        _everything(console, campaign, result)
    else:
        _lines(console, campaign, result, model)
    missing = notices(result, campaign.legs)
    if missing:
        console.print(Text(missing, style="bold yellow"))
    uncertified = uncertified_legs(result)
    if uncertified is not None:
        console.print(Text(uncertified, style="bold yellow"), soft_wrap=True)


def _lines(console: Console, campaign: Campaign, result: Result, model: LegModel) -> None:
    """A line a leg: how well it fits, what to look at first, what to do next."""
    for leg in result.legs[:_MOST_LEGS]:
        verdict = verdict_of(result, leg)
        found = advise(campaign, result, leg, model, fitted(campaign, result, leg, model))
        line = Text(f"Leg {leg.leg}: ").append(short_fit(verdict), style=STYLES[verdict.kind])
        if found.first:
            line.append(f"; look at {', '.join(str(k + 1) for k in found.first)}")
        console.print(line.append(f"; next: {found.short}"), soft_wrap=not console.is_terminal)
    more = len(result.legs) - _MOST_LEGS
    if more > 0:
        console.print(f"and {more} more legs, which the report shows")
    console.print(Text(SHORT_QUANTIFIER, style="italic"), soft_wrap=not console.is_terminal)


def _everything(console: Console, campaign: Campaign, result: Result) -> None:
    console.print(_table(result))
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        line = Text(f"Leg {leg.leg}: ").append(verdict.word, style=STYLES[verdict.kind])
        said = [leg_sentence(result, leg), center_sentence(result, leg) or ""]
        console.print(line.append(f". {printable(' '.join(said).strip())}"), soft_wrap=not console.is_terminal)
        if leg.ranges is not None:
            console.print(_ranges(campaign, result, leg))
    console.print(Text(FRAME), soft_wrap=not console.is_terminal)
    console.print(Text(f"{QUANTIFIER} {LONGER}", style="italic"), soft_wrap=not console.is_terminal)


def _table(result: Result) -> Table:
    content = result_table(result)
    table = _columns(*content.header, left=("verdict",))
    for row in content.rows:
        word = Text(row.verdict.word, style=STYLES[row.verdict.kind])
        table.add_row(str(row.leg), word, *row.cells)
    return table


def _ranges(campaign: Campaign, result: Result, leg: LegResult) -> Table:
    """The parameters of a leg, with their ranges; units of extra parameters are those of the model."""
    assert leg.ranges is not None
    at = bracket_text(leg.ranges.eps, leg.ranges.eps)[0]
    table = _columns("parameter", "nominal", "certified", f"at least, at eps {at} mm", "at most", left=("parameter",))
    nominal = [*campaign.robot.parameters[leg.leg - 1], *(0.0 for _ in result.model.extra)]
    for k, name in enumerate(result.parameters):
        decimals = _DECIMALS if result.model.unit(name) == "mm" else 9
        point = "—" if leg.point is None else nearest(leg.point[k], decimals)
        lo, hi = float(leg.ranges.box.lo[k]), float(leg.ranges.box.hi[k])
        sides = rounded_down(lo, decimals), rounded_up(hi, decimals)
        table.add_row(f"{name} [{result.model.unit(name)}]", nearest(float(nominal[k]), decimals), point, *sides)
    return table


def _columns(*names: str, left: tuple[str, ...]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in names:
        table.add_column(name, justify="left" if name in left else "right", overflow="fold")
    return table
