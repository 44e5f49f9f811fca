"""The page of an accuracy certificate."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.accuracy.findings import Accuracy, CellAccuracy, PoseAccuracy, WorkspaceAccuracy
from cpcal.common.files import write_file
from cpcal.common.numbers import about, at_most, nearest
from cpcal.report.page import rendered, versions
from cpcal.report.svg import DASHES, EDGE, INK, SUPPORT, Axes, Figure, ticks
from cpcal.report.words import assumption, degrees_up, growth_rows, sentences

# ------------------------------------------------------------------------------------------------------------------
# The map of an accuracy certificate: slices of the workspace, each cell shaded by its proved bound.

_SIDE, _LEFT, _TOP, _GAP, _BOTTOM = 150.0, 44.0, 18.0, 22.0, 36.0  # points
_STEPS = 5  # shades


def slices(found: WorkspaceAccuracy) -> list[float]:
    """Heights, mm."""
    lo, hi = found.lo[2], found.hi[2]
    return [lo] if lo == hi else [lo + share * (hi - lo) for share in (1 / 6, 0.5, 5 / 6)]


def shades(found: WorkspaceAccuracy) -> list[float]:
    """Upper ends of the shades, mm."""
    bounds = [cell.position_bound for cell in found.cells if cell.proved]
    if not bounds:
        return []
    low, high = min(bounds), max(bounds)
    return [low + (high - low) * (k + 1) / _STEPS for k in range(_STEPS)]


def fill(share: float) -> str:
    """Of a shade from 0 to 1."""
    return f"{EDGE}; fill-opacity: {nearest(0.1 + 0.75 * share, 2)}"


def map_svg(found: WorkspaceAccuracy) -> str:
    """Slices side by side, seen from above."""
    heights = slices(found)
    figure = Figure(_LEFT + len(heights) * (_SIDE + _GAP), _TOP + _SIDE + _BOTTOM)
    span = [(found.lo[k] - 0.5 * (lo == hi), found.hi[k] + 0.5 * (lo == hi)) for k, lo, hi in _spans(found)]
    ends = shades(found)
    for n, height in enumerate(heights):
        left = _LEFT + n * (_SIDE + _GAP)
        axes = Axes(figure, (left, _TOP, left + _SIDE, _TOP + _SIDE), span[0], span[1])
        figure.text(left + 0.5 * _SIDE, 7.0, f"z = {nearest(height, 0)} mm", anchor="middle")
        for cell in _cells_at(found, height):
            _draw(axes, cell, ends)
        if n == 0:
            axes.y_axis(ticks(*span[1], 5), "y [mm]")
        axes.x_axis(ticks(*span[0], 5), "x [mm]")
        if abs(found.worst_pose[2] - height) <= 0.5 * _thickness(found, heights):
            axes.marks([found.worst_pose[:2]], "x", INK, 7.0, width=1.4)
    return figure.svg("Slices of the workspace, each cell shaded by the proved bound of the position")


def _spans(found: WorkspaceAccuracy) -> list[tuple[int, float, float]]:
    return [(k, found.lo[k], found.hi[k]) for k in (0, 1)]


def _thickness(found: WorkspaceAccuracy, heights: list[float]) -> float:
    return (found.hi[2] - found.lo[2]) / len(heights) or np.inf


def _cells_at(found: WorkspaceAccuracy, height: float) -> list[CellAccuracy]:
    """Cells that the slice meets; of those with other rotations the worst is drawn last."""
    met = [cell for cell in found.cells if cell.lo[2] <= height <= cell.hi[2]]
    return sorted(met, key=lambda cell: (not cell.proved, cell.position_bound if cell.proved else 0.0))


def _draw(axes: Axes, cell: CellAccuracy, ends: list[float]) -> None:
    (x0, y0), (x1, y1) = cell.lo[:2], cell.hi[:2]
    if not cell.proved:
        axes.area([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], "none", SUPPORT, 1.0, DASHES)
        return
    shade = next((k for k, end in enumerate(ends) if cell.position_bound <= end), _STEPS - 1)
    square = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    axes.area(square, "var(--paper)")
    axes.area(square, fill(shade / (_STEPS - 1)))


def key(found: WorkspaceAccuracy) -> list[tuple[str, str]]:
    """Fill, and what it means."""
    return [(fill(k / (_STEPS - 1)), f"up to {at_most(end)} mm") for k, end in enumerate(shades(found))]


def dominating(
    found: WorkspaceAccuracy, where: Callable[[CellAccuracy], bool] = lambda _: True
) -> list[tuple[str, float]]:
    """Pairs of legs whose uncertainty moves the platform most, and the share of the proved volume where they do."""
    volume: Counter[tuple[int, int]] = Counter()
    for cell in found.cells:
        if cell.proved and where(cell):
            first, second = sorted(np.argsort(-np.array(cell.shares))[:2].tolist())
            sides = [hi - lo for lo, hi in zip(cell.lo, cell.hi, strict=True) if hi > lo]
            volume[(first + 1, second + 1)] += float(np.prod(sides))  # type: ignore[assignment]
    total = sum(volume.values())
    return [(f"{a} and {b}", share / total) for (a, b), share in volume.most_common()]


ACCURACY_PAGE = "accuracy.html"
_MOST = 20  # rows of a table


def write_accuracy(found: Accuracy, folder: str | os.PathLike[str]) -> Path:
    """Write `accuracy.html` into the folder; its path. The same certificate gives the same bytes."""
    return write_file(Path(folder) / ACCURACY_PAGE, rendered("accuracy.html.j2", _context(found)))


def _context(found: Accuracy) -> dict[str, Any]:
    over = found.workspace
    worst_first = sorted(found.proved_poses, key=lambda pose: -pose.position_bound)
    return {
        "robot": found.campaign.robot,
        "measurements": found.campaign.measurements,
        "sha256": found.campaign.sha256,
        "controller": found.controller,
        "assumption": assumption(found),
        "sentences": [_styled(sentence) for sentence in sentences(found)],
        "map": None if over is None or not over.cells else Markup(map_svg(over)),  # made by us
        "key": [] if over is None else key(over),
        "worst": None if over is None else _pose_text(over.worst_pose),
        "dominating": [] if over is None else [(n, f"{nearest(100.0 * s, 0)} %") for n, s in dominating(over)[:6]],
        "left_out": [] if over is None else [_cell_text(cell) for cell in over.left_out[:_MOST]],
        "more_left_out": 0 if over is None else max(len(over.left_out) - _MOST, 0),
        "summary": _summary(found),
        "poses": [_pose_row(pose, found.truth_known) for pose in worst_first[:_MOST]],
        "more_poses": max(len(worst_first) - _MOST, 0),
        "truth": found.truth_known,
        "growth_head": [f"{n} poses" for n in found.assumed[0].poses],
        "growth": growth_rows(found.assumed),
        "next": [(_pose_text((*n.position, *n.rotation)), n.by, about(n.expected)) for n in found.next_poses],
        "versions": versions(),
        "seconds": about(found.seconds),
    }


def _styled(sentence: str) -> tuple[str, str]:
    """A sentence and the style of its first word."""
    kinds = {"PROVED": "explained", "REFUTED": "unexplained", "THE ASSUMPTION": "unexplained", "LEFT OUT": "undecided"}
    return next((kind for word, kind in kinds.items() if sentence.startswith(word)), ""), sentence


def _summary(found: Accuracy) -> list[tuple[str, ...]]:
    """Mean and largest over the poses, as position accuracy is stated; a row a quantity."""
    poses = found.proved_poses
    if not poses:
        return []
    rows = [
        ("proved bound", [p.position_bound for p in poses], [p.rotation_bound for p in poses], True),
        (
            "U of least squares, k = 2",
            [p.estimated.u_position for p in poses],
            [p.estimated.u_rotation for p in poses],
            False,
        ),
    ]
    if found.truth_known:
        true = [p.estimated for p in poses]
        rows.append(
            ("simulator's truth", [e.true_position or 0.0 for e in true], [e.true_rotation or 0.0 for e in true], False)
        )
    out: list[tuple[str, ...]] = []
    for name, position, rotation, bound in rows:
        angles = [math.degrees(v) for v in rotation]
        form = at_most if bound else about
        out.append(
            (name, form(float(np.mean(position))), form(max(position)), form(float(np.mean(angles))), form(max(angles)))
        )
    axes = [max(max(abs(p.lo[k]), abs(p.hi[k])) for p in poses) for k in range(6)]
    per_axis = [f"{at_most(v)} mm" for v in axes[:3]] + [f"{degrees_up(v)}°" for v in axes[3:]]
    names = ("x", "y", "z", "rx", "ry", "rz")
    out.append(("largest by axis", ", ".join(f"{n} {v}" for n, v in zip(names, per_axis, strict=True)), "", "", ""))
    return out


def _pose_row(pose: PoseAccuracy, truth: bool) -> tuple[str, ...]:
    e = pose.estimated
    legs = " and ".join(str(k + 1) for k in sorted(np.argsort(-np.array(pose.shares))[:2].tolist()))
    box = [at_most(max(abs(a), abs(b)), 2) for a, b in zip(pose.lo[:3], pose.hi[:3], strict=True)]
    row = (pose.name, at_most(pose.position_bound), degrees_up(pose.rotation_bound), *box, about(e.u_position), legs)
    return (*row, about(e.true_position or 0.0)) if truth else row


def _pose_text(pose: tuple[float, ...]) -> str:
    turns = [math.degrees(v) for v in pose[3:]]
    text = f"({', '.join(nearest(v, 1) for v in pose[:3])}) mm"
    return text if not any(turns) else f"{text}, turned by ({', '.join(nearest(v, 2) for v in turns)})°"


def _cell_text(cell: CellAccuracy) -> str:
    lo, hi = list(cell.lo[:3]), list(cell.hi[:3])
    lo += [math.degrees(v) for v in cell.lo[3:]]
    hi += [math.degrees(v) for v in cell.hi[3:]]
    names = ("x", "y", "z", "rx", "ry", "rz")
    parts = zip(names, lo, hi, strict=True)
    return ", ".join(f"{n} {nearest(a, 2)} to {nearest(b, 2)}" for n, a, b in parts if b > a)
