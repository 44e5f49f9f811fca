"""One picture for a file of results: CPU seconds of every method, a row for each problem and task."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from benchmarks.records import ANSWERED, TIMEOUT, UNDECIDED, Results, Run

_MARKERS = "osD^vPX*<>"
_FEW = 3000.0  # as many times the least value has room for labels between powers of ten
_SWEEP = "ns per equation"


def draw(results: Results, path: Path) -> Path | None:
    """An SVG, the same for the same results; None when there is nothing to draw."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    medians = [run for run in results.medians().values() if run.status in (ANSWERED, UNDECIDED, TIMEOUT)]
    medians = [run for run in medians if math.isfinite(_value(run))]
    if not medians:
        return None
    rows = list(dict.fromkeys((run.problem, run.task) for run in medians))
    methods = list(dict.fromkeys(run.method for run in medians))
    with pyplot.rc_context({"svg.hashsalt": "cpcal", "svg.fonttype": "none", "font.family": "sans-serif"}):
        figure, axes = pyplot.subplots(figsize=(9.0, 1.4 + 0.45 * len(rows)), layout="constrained")
        for number, method in enumerate(methods):
            shift = min(0.15, 0.7 / len(methods)) * (number - 0.5 * (len(methods) - 1))
            _points(axes, number, [run for run in medians if run.method == method], rows, shift)
        _frame(axes, rows, any(_SWEEP in run.figures for run in medians))
        figure.legend(loc="outside lower center", ncols=min(len(methods), 4), frameon=False, fontsize=9)
        figure.savefig(path, metadata={"Date": None})
        pyplot.close(figure)
    return path


def _value(run: Run) -> float:
    return run.figures.get(_SWEEP, run.cpu)


def _points(axes: Any, number: int, runs: list[Run], rows: list[tuple[str, str]], shift: float) -> None:
    """Filled where the task was answered, hollow where it was not."""
    label: str | None = runs[0].method
    for answered in (True, False):
        mine = [run for run in runs if (run.status == ANSWERED) is answered]
        if not mine:
            continue
        axes.plot(
            [_value(run) for run in mine],
            [rows.index((run.problem, run.task)) + shift for run in mine],
            linestyle="none",
            marker=_MARKERS[number % len(_MARKERS)],
            color=f"C{number % 10}",
            fillstyle="full" if answered else "none",
            markersize=6,
            label=label,
        )
        label = None


def _frame(axes: Any, rows: list[tuple[str, str]], sweep: bool) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_xscale("log")
    least, most = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if most < _FEW * least else (1.0,)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="x", labelsize=8)
    axes.set_yticks(range(len(rows)), [f"{problem}  {task}" for problem, task in rows], fontsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(axis="x", color="0.85")
    axes.set_axisbelow(True)
    unit = "nanoseconds for each equation and box" if sweep else "CPU seconds"
    axes.set_xlabel(f"{unit}; hollow: not answered")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
