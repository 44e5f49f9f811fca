"""The table of a result, as text: the terminal and the page show the same one."""

from __future__ import annotations

from dataclasses import dataclass

from cpcal.common.numbers import bracket_text, gap_text, nearest, stated
from cpcal.questions import LegResult, LegVerdict, Result, verdict_of


@dataclass(frozen=True)
class TableRow:
    """One leg; `cells` are those after leg and verdict, `exact` eps_lo and eps_hi as hexadecimal float64."""

    leg: int
    verdict: LegVerdict
    cells: tuple[str, ...]
    exact: tuple[str, str]


@dataclass(frozen=True)
class ResultTable:
    """`header` names the columns: leg, verdict, and one for each cell of a row. Lengths in mm."""

    header: tuple[str, ...]
    rows: tuple[TableRow, ...]


def result_table(result: Result) -> ResultTable:
    """A row a leg. Bounds are rounded to the side on which they stay proved."""
    bounds = ("eps_lo [mm]", "eps_hi [mm]", "gap [mm]") if result.options.eps is None else ("eps asked [mm]",)
    header = ("leg", "verdict", *bounds, "certified", "support", "nodes", "LPs", "seconds")
    rows = (
        TableRow(leg.leg, verdict_of(result, leg), _cells(result, leg), (leg.eps_lo.hex(), leg.eps_hi.hex()))
        for leg in result.legs
    )
    return ResultTable(header, tuple(rows))


def _cells(result: Result, leg: LegResult) -> tuple[str, ...]:
    work = (
        "yes" if leg.certified else "no",
        str(len(leg.support)),
        f"{leg.nodes:,}",
        f"{leg.programs:,}",
        nearest(leg.seconds, 2),
    )
    if result.options.eps is not None:
        return (stated(result.options.eps), *work)
    return (*bracket_text(leg.eps_lo, leg.eps_hi), gap_text(leg.eps_lo, leg.eps_hi), *work)
