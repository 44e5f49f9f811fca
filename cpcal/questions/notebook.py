"""Results in a notebook: as HTML, and as a table of pandas. Bounds are rounded to the proved side."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.numbers import bracket_text, stated
from cpcal.questions.result import LegResult, Result
from cpcal.questions.verdict import verdict_of, verdict_on

if TYPE_CHECKING:
    from pandas import DataFrame


def leg_html(leg: LegResult) -> str:
    """The proved bounds. The verdict needs the question, which the result has."""
    hi = leg.bracket.hi if leg.bracket.point is not None else math.inf
    said = verdict_on(leg.bracket.lo, hi, None).sentence
    return f"<p><b>Leg {_escaped(leg.leg)}.</b> {_escaped(said)}</p>"


def result_html(result: Result) -> str:
    """A table, a row a leg."""
    eps = result.options.eps
    names = ("eps_lo [mm]", "eps_hi [mm]") if eps is None else ("eps asked [mm]",)
    header = "".join(f"<th>{name}</th>" for name in ("leg", "verdict", *names, "certified", "support", "sentence"))
    rows = []
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        bounds = bracket_text(leg.bracket.lo, leg.bracket.hi) if eps is None else (stated(eps),)
        certified = "yes" if leg.certified else "no"
        cells = (leg.leg, verdict.word, *bounds, certified, len(leg.support.ids), verdict.sentence)
        rows.append("<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in cells) + "</tr>")
    title = f"{_escaped(result.campaign.robot)}: {result.campaign.measurements:,} measurements"
    stopped = "; interrupted: what is shown was proved until then" if result.interrupted else ""
    return (
        f"<table><caption>{title}{stopped}</caption><thead><tr>{header}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _escaped(value: object) -> str:
    return html.escape(printable(str(value)))


def result_frame(result: Result) -> DataFrame:
    """Raises InputError without pandas."""
    try:
        import pandas
    except ImportError:
        raise InputError([Problem("to_frame", "needs pandas", "pip install 'cpcal[frames]'")]) from None
    return pandas.DataFrame([row for leg in result.legs for row in _rows(result, leg)])


def _rows(result: Result, leg: LegResult) -> list[dict[str, Any]]:
    known = leg.ranges
    return [
        {
            "leg": leg.leg,
            "parameter": name,
            "unit": result.model.unit(name),
            "center": leg.center[k],
            "certified": math.nan if leg.bracket.point is None else leg.bracket.point[k],
            "range_lo": math.nan if known is None else float(known.box.lo[k]),
            "range_hi": math.nan if known is None else float(known.box.hi[k]),
            "range_eps": math.nan if known is None else known.eps,
            "verdict": verdict_of(result, leg).word,
            "eps_lo": leg.bracket.lo,
            "eps_hi": leg.bracket.hi,
        }
        for k, name in enumerate(result.model.parameters)
    ]
