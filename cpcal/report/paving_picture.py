"""A picture of a paving: inside, boundary and outside boxes over two of the variables, as SVG.

paving = net.solve(width=0.05, inner=True)
Path("paving.svg").write_text(paving_svg(paving, "x", "y"))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import Floats
from cpcal.report.svg import Axes, Figure, label_room, tick_labels, ticks
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box
from cpcal.solver.search import Paving

_OUTSIDE, _BOUNDARY, _INSIDE, _PROVED = "#e8ecf1", "#f0b429", "#2f855a", "#c53030"
_LINE = "#ffffff"
_PAGE_COLOURS = {"var(--ink)": "#222222"}  # which an HTML page would give


def paving_svg(paving: Paving, horizontal: str, vertical: str, *, size: float = 4.5) -> str:
    """One SVG document of `size` inches: outside boxes grey, boundary yellow, inside green, single solutions red dots.

    Of more than two variables it is the projection, without outside boxes, which mean nothing there. The same paving
    gives the same text. Raises ModelError for an unbounded or empty paving, or an unknown variable.
    """
    single = [s.box for s in paving.solutions if s.verdict is Verdict.PROVED]
    everything = [*paving.inside, *paving.outside, *paving.boundary, *single]
    if not everything or not all(box.is_bounded for box in everything):
        raise ModelError("only a paving of bounded boxes, and of at least one, can be drawn")
    pair = (everything[0].index(horizontal), everything[0].index(vertical))

    (left, right), (low, high) = (_span(everything, i) for i in pair)
    figure, numbers = Figure(72.0 * size, 72.0 * size), ticks(low, high)
    frame = (label_room(tick_labels(numbers)) + 8.0, 6.0, 72.0 * size - 8.0, 72.0 * size - 32.0)
    axes = Axes(figure, frame, (left, right), (low, high))
    axes.x_axis(ticks(left, right), horizontal)
    axes.y_axis(numbers, vertical)
    if len(everything[0]) == 2:
        axes.areas(_corners(paving.outside, pair), _OUTSIDE, _LINE, 0.2)
    axes.areas(_corners(paving.boundary, pair), _BOUNDARY, _LINE, 0.2)
    axes.areas(_corners(paving.inside, pair), _INSIDE, _LINE, 0.2)
    axes.dots([box.mid[list(pair)] for box in single], _PROVED, 4.0)
    svg = figure.svg("paving")
    for colour, value in _PAGE_COLOURS.items():
        svg = svg.replace(colour, value)
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def _span(boxes: Sequence[Box], i: int) -> tuple[float, float]:
    """What boxes cover of variable i, with a margin."""
    lo, hi = min(float(box.lo[i]) for box in boxes), max(float(box.hi[i]) for box in boxes)
    margin = 0.05 * (hi - lo) or 0.05 * abs(lo) or 1.0
    return lo - margin, hi + margin


def _corners(boxes: Sequence[Box], pair: tuple[int, int]) -> list[Floats]:
    """The projections of boxes as rectangles."""
    ends = ((*box.lo[list(pair)].tolist(), *box.hi[list(pair)].tolist()) for box in boxes)
    return [np.array([(a, b), (c, b), (c, d), (a, d)]) for a, b, c, d in ends]
