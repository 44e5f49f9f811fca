"""Figures as inline SVG: no colours and fonts of their own (the page's CSS has them), no date, no chance."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.figure import Figure

# Colours that stand for CSS variables of the page.
INK, GRID, BAND, EDGE, ROOM, DOT, MASS, SUPPORT = (f"#0102{k:02x}" for k in range(1, 9))
_VARIABLES = {
    INK: "ink",
    GRID: "grid",
    BAND: "band",
    EDGE: "edge",
    ROOM: "room",
    DOT: "dot",
    MASS: "mass",
    SUPPORT: "support",
}
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cpcal",
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
}
_NO_METADATA = {"Creator": None, "Date": None, "Format": None, "Type": None}


def figure_svg(draw: Callable[[Figure], None], size: tuple[float, float], *, prefix: str, label: str) -> str:
    """What `draw` draws on a figure of `size` inches; ids in the SVG begin with `prefix`.

    `prefix` and `label` are markup: text of ours alone. Nothing of the user's matplotlib settings shows.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    return _inline(buffer.getvalue(), prefix, label)


def _inline(svg: str, prefix: str, label: str) -> str:
    """The <svg> element alone, for an HTML page that holds several: own ids, the page's colours and fonts."""
    svg = svg[svg.index("<svg") :].strip()
    svg = re.sub(r"\bid=\"", f'id="{prefix}', svg)
    svg = re.sub(r"xlink:href=\"#", f'href="#{prefix}', svg)
    svg = svg.replace("url(#", f"url(#{prefix}")
    for colour, name in _VARIABLES.items():
        svg = svg.replace(colour, f"var(--{name})")
    svg = svg.replace("'DejaVu Sans'", "system-ui, sans-serif")
    box = re.search(r'viewBox="[^"]*"', svg)
    assert box is not None
    head = f'<svg {box.group()} role="img" aria-label="{label}">'
    return re.sub(r"<svg[^>]*>", lambda _: head, svg, count=1)
