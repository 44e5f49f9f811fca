"""Results on axes of matplotlib, for notebooks: axes in, axes out. Drawn in floating point."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from cpcal.common.errors import InputError, Problem, printable
from cpcal.common.numbers import bracket_text, stated
from cpcal.legs import PLAIN, LegModel, model_residuals
from cpcal.questions.result import LegResult, Result
from cpcal.questions.verdict import EpsBracket, verdict_of, verdict_on
from cpcal.robot import Campaign

if TYPE_CHECKING:
    from pandas import DataFrame

    from cpcal.questions.result import LegResult, Result

_COLOURS = {  # by the kind of a verdict
    "explained": "#17693a",
    "unexplained": "#a11d2b",
    "bounded": "#1d4f8f",
    "undecided": "#7a5200",
    "undetermined": "#6b2f86",
}
_GREY, _BAND, _ORANGE = "#e3e7ec", "#dbe8f8", "#c2410c"


def errors_axes(result: Result, ax: Axes | None) -> Axes:
    """A row a leg: grey what is proved impossible, a bar from eps_lo to eps_hi."""
    axes = _axes(ax)
    known = [v for leg in result.legs for v in (leg.eps_lo, leg.eps_hi) if math.isfinite(v)]
    most = max([*known, result.options.tolerance or 0.0, 1e-12])
    for row, leg in enumerate(result.legs):
        lo = min(leg.eps_lo, most)
        axes.barh(row, lo, height=0.4, color=_GREY)
        if math.isfinite(leg.eps_hi):
            width = max(leg.eps_hi - lo, 0.01 * most)
            axes.barh(row, width, left=lo, height=0.7, color=_COLOURS[verdict_of(result, leg).kind])
    if result.options.tolerance is not None:
        axes.axvline(result.options.tolerance, color="black", linestyle="--", label="tolerance")
        axes.legend()
    axes.set_yticks(range(len(result.legs)), [f"leg {leg.leg}" for leg in result.legs])
    axes.invert_yaxis()
    axes.set_xlabel("model error eps [mm]")
    return axes


def residuals_axes(leg: LegResult, campaign: Campaign, ax: Axes | None, model: LegModel | None) -> Axes:
    """Raises ValueError without a proved point, or for a model with other parameters."""
    model = model or PLAIN
    if leg.point is None:
        raise ValueError("there is no proved point whose residuals could be drawn")
    if len(model.parameters) != len(leg.point):
        raise ValueError(f"the leg's model has {len(leg.point)} parameters, {model.name!r} has {len(model.parameters)}")
    axes, numbers = _axes(ax), np.arange(1, len(campaign) + 1)
    axes.axhspan(-leg.eps_hi, leg.eps_hi, color=_BAND, label="±eps_hi")
    for x, mark, colour, name in (
        (leg.center, "x", _ORANGE, "center (least squares)"),
        (leg.point, ".", "black", "proved point"),
    ):
        axes.plot(numbers, model_residuals(campaign, leg.leg, x, model), mark, color=colour, label=name)
    axes.set_xlabel("measurement, counted from 1")
    axes.set_ylabel("residual [mm]")
    axes.legend()
    return axes


def parameters_axes(leg: LegResult, ax: Axes | None) -> Axes:
    """Of (a, b, l); a model's own parameters may have other units."""
    axes = _axes(ax)
    box, what = (leg.enclosure, "eps_hi") if leg.ranges is None else (leg.ranges.box, f"{stated(leg.ranges.eps)} mm")
    middle = box.mid if leg.point is None else np.array(leg.point)
    rows, center = np.arange(7), np.array(leg.center)
    axes.barh(rows, box.width[:7], left=(box.lo - middle)[:7], height=0.5, color=_BAND, label=f"range at {what}")
    axes.plot((center - middle)[:7], rows, "x", color=_ORANGE, label="center (least squares)")
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_yticks(rows, box.names[:7])
    axes.invert_yaxis()
    axes.set_xlabel("parameter − proved point [mm]")
    axes.legend()
    return axes


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot  # which chooses a window system

    return pyplot.subplots()[1]


# ------------------------------------------------------------------------------------------------------------------
# What a notebook shows of results, as HTML: text escaped, bounds rounded to the side on which they stay proved.


def leg_html(leg: LegResult) -> str:
    """The proved bounds. The verdict needs the question, which the result has."""
    hi = leg.eps_hi if leg.point is not None else math.inf
    said = verdict_on(EpsBracket(leg.eps_lo, hi), None).sentence
    return f"<p><b>Leg {_escaped(leg.leg)}.</b> {_escaped(said)}</p>"


def result_html(result: Result) -> str:
    """A table, a row a leg."""
    eps = result.options.eps
    names = ("eps_lo [mm]", "eps_hi [mm]") if eps is None else ("eps asked [mm]",)
    header = "".join(f"<th>{name}</th>" for name in ("leg", "verdict", *names, "certified", "support", "sentence"))
    rows = []
    for leg in result.legs:
        verdict = verdict_of(result, leg)
        bounds = bracket_text(leg.eps_lo, leg.eps_hi) if eps is None else (stated(eps),)
        certified = "yes" if leg.certified else "no"
        cells = (leg.leg, verdict.word, *bounds, certified, len(leg.support), verdict.sentence)
        rows.append("<tr>" + "".join(f"<td>{_escaped(cell)}</td>" for cell in cells) + "</tr>")
    title = f"{_escaped(result.robot)}: {result.measurements:,} measurements"
    stopped = "; interrupted: what is shown was proved until then" if result.interrupted else ""
    return (
        f"<table><caption>{title}{stopped}</caption><thead><tr>{header}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _escaped(value: object) -> str:
    return html.escape(printable(str(value)))


# ------------------------------------------------------------------------------------------------------------------
# A result as a table of pandas, which is needed only here.


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
            "certified": math.nan if leg.point is None else leg.point[k],
            "range_lo": math.nan if known is None else float(known.box.lo[k]),
            "range_hi": math.nan if known is None else float(known.box.hi[k]),
            "range_eps": math.nan if known is None else known.eps,
            "verdict": verdict_of(result, leg).word,
            "eps_lo": leg.eps_lo,
            "eps_hi": leg.eps_hi,
        }
        for k, name in enumerate(result.parameters)
    ]
