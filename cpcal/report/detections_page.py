"""The page of `cpcal image detect`: counts with reasons, some images, where residuals point, where time went."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.common.files import write_file
from cpcal.common.numbers import about, nearest
from cpcal.report.page import rendered, versions
from cpcal.report.study_report import Picture, TextTable, picture
from cpcal.report.svg import DOT, EDGE, GRID, INK, Axes, Figure, Span, label_room, tick_labels, ticks
from cpcal.vision.batch.detect import Detections
from cpcal.vision.batch.study_images import Sample, SeenImage
from cpcal.vision.camera import Camera
from cpcal.vision.files.detection import NUMBERS, RMS, SCALE, SHARED, SIGMA, Detection, by_reason, values_of
from cpcal.vision.measure import MeanVectors, over_image, over_plate
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# The figure of mean residuals as arrows from where they are, not to scale; a bar tells how long they are.

_WIDTH, _HEIGHT = 430.0, 400.0  # points: of the figure, and at most of the frame
_FOOT, _HEAD = 32.0, 24.0  # points below the frame for the axis, above it for the bar
_REACH = 0.9  # of the distance between places: how long the longest arrow is
_BARB = 3.0  # points, the longest


def arrow_svg(means: MeanVectors, x: Span, y: Span, unit: str, place: str, *, label: str, least: float = 1e-9) -> str:
    """Arrows within the frame `x`, `y` (left to right, bottom to top; places in `place`), lengths in `unit`.

    Arrows that are shorter than `least` are not blown up to be seen.
    """
    wide, high = abs(x[1] - x[0]), abs(y[1] - y[0])
    across, up = ticks(min(x), max(x), 6), ticks(min(y), max(y), 6)
    left = label_room(tick_labels(up)) + 8.0
    scale = min((_WIDTH - left - 10.0) / wide, _HEIGHT / high)  # points for each unit of place
    figure = Figure(_WIDTH, _HEAD + scale * high + _FOOT)
    axes = Axes(figure, (left, _HEAD, left + scale * wide, _HEAD + scale * high), x, y)
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]), (x[0], y[0])]
    axes.line(corners, GRID, 0.8)
    axes.x_axis(across, f"x [{place}]")
    axes.y_axis(up, f"y [{place}]")
    if not len(means.at):
        return figure.svg(label)
    longest = max(float(np.hypot(*means.mean.T).max()), least)
    stretch = _REACH * _pitch(means, wide, high) / longest
    ends = means.at + stretch * means.mean
    _arrows(axes, means, ends)
    axes.dots(means.at, EDGE, 2.6)
    _bar(axes, stretch * scale, _round(longest), unit)
    lengths = np.hypot(*means.mean.T)
    told = [f"{about(v, 2)} {unit}, mean of {n}" for v, n in zip(lengths.tolist(), means.counts.tolist(), strict=True)]
    axes.hover(means.at, told, 9.0)
    return figure.svg(label)


def _arrows(axes: Axes, means: MeanVectors, ends: np.ndarray) -> None:
    """Shafts, and heads of two barbs, drawn in points of the figure and told back in data."""
    axes.lines(np.stack([means.at, ends], axis=1), DOT, 0.9)
    start, tip = axes.at(means.at), axes.at(ends)
    along = tip - start
    length = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    back = -along / length * np.minimum(_BARB, 0.4 * length)
    across = np.stack([-back[:, 1], back[:, 0]], axis=1)
    one, two = tip + back + 0.5 * across, tip + back - 0.5 * across
    axes.lines(axes.data(np.stack([one, tip, two], axis=1)), DOT, 0.9)


def _bar(axes: Axes, points: float, length: float, unit: str) -> None:
    """`length` as it is drawn, above the frame at the right."""
    right, top = axes.frame[2], axes.frame[1]
    ends = np.array([[right - points * length, top - 10.0], [right, top - 10.0]])
    axes.line(axes.data(ends), INK, 1.4)
    axes.marks(axes.data(ends), "|", INK, 6.0, width=1.0)
    axes.figure.text(right - points * length - 6.0, top - 10.0, f"residual {about(length, 2)} {unit}", anchor="end")


def _pitch(means: MeanVectors, wide: float, high: float) -> float:
    """Distance between neighbours, about."""
    return math.sqrt(wide * high / max(len(means.at), 9))


def _round(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above it."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9))


MOST_ROWS = 12  # of a table
_NAMED = 3  # files for each reason
_NOT_NOISE = 2.0  # times what noise leaves of the means
_LEAST_PX, _LEAST_MM = 1e-4, 1e-4  # shorter arrows are not blown up
_MARGIN = 0.08  # of the plate, around its dots


def write_detections_page(found: Detections, sample: Sample, target: Target, camera: Camera, table: Path) -> Path:
    """Write `TABLE.html` beside the table of poses, all or nothing; its path. Raises InputError."""
    context = _context(found, sample, target, camera, table.name)
    return write_file(table.with_name(f"{table.name}.html"), rendered("detections.html.j2", context))


def _context(found: Detections, sample: Sample, target: Target, camera: Camera, name: str) -> dict[str, Any]:
    image = over_image(sample.residuals, camera.width, camera.height)
    plate = over_plate(sample.residuals, target.dots)
    doubtful = [row for row in found.rows if row.doubt]
    reasons = by_reason(found.rows)
    return {
        "name": name,
        "target": target.name,
        "counts": _counts(found, len(doubtful)),
        "reasons": _table_of_reasons(reasons),
        "more_reasons": max(len(reasons) - MOST_ROWS, 0),
        "doubtful": _table_of_doubt(doubtful),
        "more_doubtful": max(len(doubtful) - MOST_ROWS, 0),
        "numbers": _numbers(found.rows),
        "pictures": [_picture(seen) for seen in sample.pictures],
        "sampled": sample.measured,
        "maps": [] if not len(sample.residuals.at) else _maps(image, plate, target, camera),
        "measured": found.measured,
        "time": _time(found),
        "versions": versions(),
    }


def _counts(found: Detections, doubtful: int) -> list[tuple[str, str, str]]:
    """Number, style and what it counts."""
    poses = sum(row.found for row in found.rows)
    return [
        (f"{poses - doubtful:,}", "explained", "found"),
        (f"{doubtful:,}", "undecided", "found, doubtful"),
        (f"{len(found.rows) - poses:,}", "unexplained", "refused"),
    ]


def _table_of_reasons(reasons: dict[str, list[str]]) -> TextTable | None:
    rows = []
    for reason, files in list(reasons.items())[:MOST_ROWS]:
        more = ", ..." if len(files) > _NAMED else ""
        rows.append((reason, f"{len(files):,}", ", ".join(files[:_NAMED]) + more))
    return TextTable(("why there is no pose", "images", "such as"), tuple(rows)) if rows else None


def _table_of_doubt(doubtful: Sequence[Detection]) -> TextTable | None:
    worst = sorted(doubtful, key=lambda row: -row.values[SCALE])[:MOST_ROWS]
    rows = [(row.file, about(row.values[SCALE]), nearest(row.values[RMS], 4), str(row.dots)) for row in worst]
    return TextTable(("image", "scale", "residuals, RMS [px]", "dots"), tuple(rows)) if rows else None


def _numbers(rows: Sequence[Detection]) -> TextTable | None:
    """Of all poses: the median and the worst."""
    values = values_of(rows)
    if not len(values):
        return None
    degrees = np.degrees(1.0)
    columns = {name: values[:, NUMBERS.index(name)] for name in ("missing", "false")}
    dots = np.array([row.dots for row in rows if row.found])
    lines = [
        ("dots that the pose rests on", dots, float(dots.min()), 0),
        ("dots of the target that are missing", columns["missing"], float(columns["missing"].max()), 0),
        ("found dots that are none of the target's", columns["false"], float(columns["false"].max()), 0),
        ("residuals, RMS per axis [px]", values[:, RMS], float(values[:, RMS].max()), 4),
        ("scale: mean square of residuals over the stated one", values[:, SCALE], float(values[:, SCALE].max()), 2),
    ]
    for part, of in ((SIGMA, "stated deviation of"), (SHARED, "of it shared by all images,")):
        position, turn = values[:, part][:, :3].max(axis=1), degrees * values[:, part][:, 3:].max(axis=1)
        lines.append((f"{of} the position, largest axis [mm]", position, float(position.max()), 4))
        lines.append((f"{of} the rotation, largest axis [°]", turn, float(turn.max()), 5))
    told = [(name, nearest(float(np.median(v)), d), nearest(worst, d)) for name, v, worst, d in lines]
    return TextTable(("of all poses", "median", "worst"), tuple(told))


def _picture(seen: SeenImage) -> tuple[Picture, str, str]:
    """With style and word."""
    if not seen.row.found:
        kind = "unexplained", "refused"
    else:
        kind = ("undecided", "doubtful") if seen.row.doubt else ("explained", "found")
    caption = seen.row.file
    if seen.row.found:
        caption += f": {seen.row.dots} dots, {nearest(seen.row.values[RMS], 4)} px RMS"
    return picture(caption, seen.jpeg, seen.size), *kind


def _maps(image: MeanVectors, plate: MeanVectors, target: Target, camera: Camera) -> list[dict[str, Any]]:
    low, high = target.dots.min(axis=0), target.dots.max(axis=0)
    edge = _MARGIN * float((high - low).max()) + target.radius
    x, y = ((float(low[k]) - edge, float(high[k]) + edge) for k in (0, 1))
    across, down = (-0.5, camera.width - 0.5), (camera.height - 0.5, -0.5)
    lens = "the lens is not quite as the camera file says, or its model does not fit: calibrate the camera again"
    bent = (
        "dots are not quite where the target file says, or the plate is not flat. A wrong lens shows here as well: "
        "where both maps are more than noise, calibrate first; --calibrate --refine-dots finds the dots, too"
    )
    drawn = [
        ("By place in the image", image, (across, down), "px", "px", _LEAST_PX, lens),
        ("By dot of the plate", plate, (x, y), "mm", "mm", _LEAST_MM, bent),
    ]
    return [
        {
            "title": title,
            "svg": Markup(arrow_svg(means, *spans, unit, place, label=f"Mean residuals: {title}", least=least)),  # ours
            "said": _said(means, unit),
            "warning": why if means.rms > _NOT_NOISE * means.noise_rms else "",
        }
        for title, means, spans, unit, place, least, why in drawn
    ]


def _said(means: MeanVectors, unit: str) -> str:
    if not len(means.at):
        return "Too few residuals for means."
    return (
        f"{len(means.at)} means of {nearest(float(np.median(means.counts)), 0)} residuals each (median). Their RMS per "
        f"axis is {about(means.rms, 2)} {unit}; noise alone would leave {about(means.noise_rms, 2)} {unit}."
    )


def _time(found: Detections) -> TextTable | None:
    total = sum(found.seconds.values())
    if not found.measured or total <= 0.0:
        return None
    rows = []
    for stage, seconds in [*found.seconds.items(), ("together", total)]:
        share = f"{nearest(100.0 * seconds / total, 0)} %"
        rows.append((stage, nearest(seconds, 2), nearest(1e3 * seconds / found.measured, 1), share))
    return TextTable(("stage", "work [s]", "an image [ms]", "share"), tuple(rows))
