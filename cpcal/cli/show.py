"""What is printed at the end: the table, a sentence a leg, and for which readings they hold."""

from __future__ import annotations

from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cpcal.common.errors import printable
from cpcal.report import LONGER, QUANTIFIER, center_sentence, leg_sentence, missing_legs, result_table
from cpcal.results import Result, verdict_of

STYLES = {  # by the kind of a verdict
    "explained": "bold green",
    "unexplained": "bold red",
    "bounded": "bold cyan",
    "undecided": "bold yellow",
    "undetermined": "bold magenta",
}
_WIDE = 120  # where there is no terminal to fit


class _Terminal(Console):
    """Reads no markup in what it prints, and shows hidden characters as escapes: names forge no line."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


def terminal(*, stderr: bool = False) -> Console:
    """A console that prints text as it is, but for hidden characters."""
    console = _Terminal(stderr=stderr, markup=False, emoji=False, highlight=False)
    if not console.is_terminal:
        console.width = _WIDE
    return console


def show_result(console: Console, result: Result, legs: int) -> None:
    """The whole answer; `legs` is how many the robot has."""
    console.print(Text(f"{printable(result.robot)}: {result.measurements:,} measurements", style="bold"))
    console.print(_table(result))
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        line = Text(f"Leg {leg.leg}: ").append(verdict.word, style=STYLES[verdict.kind])
        said = [leg_sentence(result, leg), center_sentence(result, leg) or ""]
        console.print(line.append(f". {printable(' '.join(said).strip())}"), soft_wrap=not console.is_terminal)
    missing = missing_legs(result, legs)
    if missing:
        console.print(Text(missing, style="bold yellow"))
    console.print(Text(f"{QUANTIFIER} {LONGER}", style="italic"), soft_wrap=not console.is_terminal)


def _table(result: Result) -> Table:
    content = result_table(result)
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for name in content.header:
        table.add_column(name, justify="left" if name == "verdict" else "right", overflow="fold")
    for row in content.rows:
        word = Text(row.verdict.word, style=STYLES[row.verdict.kind])
        table.add_row(str(row.leg), word, *row.cells)
    return table
