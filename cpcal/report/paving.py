"""A picture of a paving: inside, boundary and outside boxes over two of the variables, as SVG.

paving = net.solve(width=0.05, inner=True)
Path("paving.svg").write_text(paving_svg(paving, "x", "y"))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from cpcal.common.errors import ModelError
from cpcal.report.svg import figure_svg
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

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        if len(everything[0]) == 2:
            _fill(axes, paving.outside, pair, _OUTSIDE)
        _fill(axes, paving.boundary, pair, _BOUNDARY)
        _fill(axes, paving.inside, pair, _INSIDE)
        dots = np.array([box.mid[list(pair)] for box in single]).reshape(-1, 2)
        axes.plot(dots[:, 0], dots[:, 1], "o", color=_PROVED, markersize=4.0, markeredgewidth=0.0)
        axes.set_xlabel(horizontal)
        axes.set_ylabel(vertical)
        axes.autoscale_view()

    svg = figure_svg(draw, (size, size), prefix="paving-", label="paving")
    for colour, value in _PAGE_COLOURS.items():
        svg = svg.replace(colour, value)
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def _fill(axes: Axes, boxes: Sequence[Box], pair: tuple[int, int], colour: str) -> None:
    """The projections of boxes as rectangles, one path each."""
    if not boxes:
        return
    lo, hi = np.stack([box.lo[list(pair)] for box in boxes]), np.stack([box.hi[list(pair)] for box in boxes])
    corners = np.stack([lo, np.stack([hi[:, 0], lo[:, 1]], 1), hi, np.stack([lo[:, 0], hi[:, 1]], 1)], axis=1)
    axes.add_collection(PolyCollection(list(corners), facecolors=colour, edgecolors=_LINE, linewidths=0.2))
