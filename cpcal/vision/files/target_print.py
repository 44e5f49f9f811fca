"""A target on paper, at true scale: one PDF or SVG page, whose bytes depend on the target alone.

Printers scale pages unless told not to: a bar of 100 mm stands below the dots to be measured.
"""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from cpcal.common.errors import unusable
from cpcal.common.files import StrPath, write_file
from cpcal.common.values import ArrayPair, Floats, Pair
from cpcal.vision.opencv import marker_dictionary, opencv
from cpcal.vision.target import Board, Target, resized

_SIZES = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "a2": (420.0, 594.0), "a1": (594.0, 841.0), "a0": (841.0, 1189.0)}
_PAPERS = {**_SIZES, "letter": (215.9, 279.4)}  # mm
PAPERS = tuple(_PAPERS)
_STEP = 0.05  # sizes of targets for a paper are multiples of it
_BORDER = 10.0  # mm, of the page
_FOOT = 18.0  # mm, below the plate: the bar, the name
_BAR, _BELOW = 100.0, 7.0  # mm, and so far below the plate
_TICK = 3.0  # mm, at each of the bar's ends
_CAPTION = 8.0  # mm, its line below the bar
_TEXT = 4.0  # mm, its size
_MM_PER_INCH = 25.4
_POINTS_PER_MM = 72.0 / _MM_PER_INCH
_STYLE: dict[Any, Any] = {
    "pdf.fonttype": 42,
    "pdf.compression": 6,
    "svg.hashsalt": "cpcal",
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
}


class Sheet(NamedTuple):
    """The page of a target: its paper, "" for a size of its own; width and height, mm; and its lower left corner as the
    target's frame has it, y up (`upward`)."""

    paper: str
    size: Pair
    corner: Floats


def on_paper(target: Target, paper: str) -> Target:
    """The target in the largest size, a multiple of 0.05 of its own, that the paper (one of PAPERS) holds."""
    fits = [resized(target, k * _STEP) for k in range(1, 101)]
    return [size for size in fits if _sheet_for(size, (paper,)).paper][-1]


def upward(target: Target, places: Floats) -> Floats:
    """Places (n, 2) with y up, as on paper: of OpenCV's boards it goes down."""
    return np.asarray(places * np.array([1.0, -1.0 if target.board else 1.0]))


def _plate(target: Target) -> ArrayPair:
    """The corners of the ground, mm, y up: a detector needs some all around what is printed."""
    margin = target.radius + max(2.0 * target.radius, 5.0)
    squares = _squares(target)
    every = np.concatenate([upward(target, target.dots), squares[:, :2], squares[:, :2] + squares[:, 2:]])
    return every.min(axis=0) - margin, every.max(axis=0) + margin


def _squares(target: Target) -> Floats:
    """x, y (up) of the lower left corner and side (m, 3) of what is black, beside dots."""
    if not target.printed:
        return np.zeros((0, 3))
    squares = dark_squares(Board.parsed(target.board))
    return np.column_stack([upward(target, squares[:, :2]) - [0.0, 1.0] * squares[:, 2:], squares[:, 2]])


def _sheet_for(target: Target, papers: Iterable[str]) -> Sheet:
    """The first of the papers, upright or lying, that holds the target; where none does, none and the size it needs."""
    low, high = _plate(target)
    low = low - [0.0, _FOOT]
    needs = np.maximum(high - low, [_BAR + 2.0 * _TICK, 0.0]) + 2.0 * _BORDER
    sizes = [(name, way) for name in papers for way in (_PAPERS[name], _PAPERS[name][::-1])]
    every = ((name, way) for name, way in sizes if (needs <= way).all())
    name, (width, height) = next(every, ("", (float(needs[0]), float(needs[1]))))
    return Sheet(name, (width, height), 0.5 * (low + high - [width, height]))


def sheet(target: Target, paper: str | None = None) -> Sheet:
    """That paper, or the smallest sheet from A4 to A0, upright or lying, that holds the target; else one of the size
    that it needs. Raises InputError when the target does not fit the paper that is named."""
    found = _sheet_for(target, _SIZES if paper is None else (paper,))
    if paper is not None and not found.paper:
        what = "needs {:.0f} x {:.0f} mm and does not fit ".format(*found.size) + paper
        raise unusable(f"target {target.name}", what, "choose another --paper")
    return found


def print_target(target: Target, path: StrPath, paper: str | None = None) -> None:
    """Write the page to a .pdf or .svg file, on that paper (one of PAPERS) or on the smallest that holds the target.

    Raises InputError for another kind of file, one that cannot be written, or a target that the paper does not hold.
    """
    file = Path(path)
    if file.suffix not in (".pdf", ".svg"):
        raise unusable(file, "is neither a .pdf nor an .svg file", "name it so")
    write_file(file, page_bytes(target, file.suffix[1:], paper))


def page_bytes(target: Target, kind: str, paper: str | None = None) -> bytes:
    """The page as "pdf" or "svg"."""
    on = sheet(target, paper)
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(on.size[0] / _MM_PER_INCH, on.size[1] / _MM_PER_INCH))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(on.corner[0], on.corner[0] + on.size[0])
        axes.set_ylim(on.corner[1], on.corner[1] + on.size[1])
        title = "".join(c if c.isprintable() else " " for c in target.name)
        _draw(axes, target, title)
        buffer = io.BytesIO()
        none = {"CreationDate": None, "Creator": None, "Producer": None} if kind == "pdf" else {"Date": None}
        figure.savefig(buffer, format=kind, metadata={"Title": title, **none})
    return buffer.getvalue()


def _draw(axes: Axes, target: Target, title: str) -> None:
    ground, ink = ("black", "white") if target.bright else ("white", "black")
    low, high = _plate(target)
    axes.add_patch(Rectangle(low.tolist(), *(high - low).tolist(), facecolor=ground, linewidth=0.0))
    for x, y, side in _squares(target).tolist():
        axes.add_patch(Rectangle((x, y), side, side, facecolor=ink, linewidth=0.0))
    for x, y in upward(target, target.dots).tolist() if not target.printed else ():
        axes.add_patch(Circle((x, y), target.radius, facecolor=ink, linewidth=0.0))
    middle, y = 0.5 * float(low[0] + high[0]), float(low[1]) - _BELOW
    ends = middle - 0.5 * _BAR, middle + 0.5 * _BAR
    thin: dict[str, Any] = {"color": "black", "linewidth": 0.2 * _POINTS_PER_MM, "solid_capstyle": "butt"}
    axes.plot(ends, [y, y], **thin)
    for end in ends:
        axes.plot([end, end], [y - _TICK, y + _TICK], **thin)
    size = np.format_float_positional(round(2.0 * target.radius, 6), trim="-")
    what = f"{len(target.dots)} " + ("corners" if target.printed else f"dots of {size} mm")
    axes.text(
        middle,
        y - _CAPTION,
        f"{title}: {what}; the bar is {_BAR:g} mm: print at 100 %",
        fontsize=_TEXT * _POINTS_PER_MM,
        horizontalalignment="center",
        parse_math=False,
    )


def dark_squares(board: Board) -> Floats:
    """What is black on a printed board: x, y of the upper left corner and side (m, 3), mm; none of a circle grid."""
    nodes, side = board.nodes(board.columns, board.rows), board.lengths[0]
    if board.kind == "grid":
        return _markers(board, sum(board.lengths) * nodes, side)
    if board.kind == "charuco":
        dark, inner = nodes.sum(axis=1) % 2.0 == 0.0, board.lengths[1]
        markers = _markers(board, side * nodes[~dark] + 0.5 * (side - inner), inner)
        return np.concatenate([np.column_stack([side * nodes[dark], np.full(dark.sum(), side)]), markers])
    if board.kind == "chessboard":
        nodes = board.nodes(board.columns + 1, board.rows + 1)
        nodes = nodes[nodes.sum(axis=1) % 2.0 == 1.0] - 1.0
        return np.column_stack([side * nodes, np.full(len(nodes), side)])
    return np.zeros((0, 3))


def _markers(board: Board, corners: Floats, side: float) -> Floats:
    """The dark bits of the first markers of a dictionary, at their upper left corners (n, 2)."""
    dictionary, out = marker_dictionary(board.dictionary), []
    count = dictionary.markerSize + 2  # a border of one bit all around
    for number, corner in enumerate(corners):
        bits = opencv().aruco.generateImageMarker(dictionary, number, count)
        rows, columns = np.nonzero(bits == 0)
        places = corner + side / count * np.column_stack([columns, rows])
        out.append(np.column_stack([places, np.full(len(places), side / count)]))
    return np.concatenate(out)
