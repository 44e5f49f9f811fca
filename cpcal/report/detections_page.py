"""The page of `cpcal image detect`: counts with reasons, some images, where residuals point, time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cpcal.common.numbers import about, nearest
from cpcal.common.values import Floats
from cpcal.report.section import Drawing, Mark, Page, Picture, Section, Table, Words, origin, picture, verdict
from cpcal.report.svg import DOT, EDGE, GRID, INK, Axes, Figure, Span, Svg, label_room, tick_labels, ticks
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


def arrow_svg(means: MeanVectors, x: Span, y: Span, unit: str, place: str, *, label: str, least: float = 1e-9) -> Svg:
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
    axes.line(GRID, corners, width=0.8)
    axes.x_axis(across, f"x [{place}]")
    axes.y_axis(up, f"y [{place}]")
    if not len(means.at):
        return figure.svg(label)
    lengths = np.hypot(*means.mean.T)
    longest = max(float(lengths.max()), least)
    pitch = math.sqrt(wide * high / max(len(means.at), 9))  # the distance between neighbours, about
    stretch = _REACH * pitch / longest
    _arrows(axes, means.at, means.at + stretch * means.mean)
    axes.dots(means.at, EDGE, 2.6)
    power = 10.0 ** math.floor(math.log10(longest))  # the bar is as long as 1, 2 or 5 times it
    bar = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))
    right, top = axes.frame[2], _HEAD - 10.0
    ends = axes.data([[right - stretch * scale * bar, top], [right, top]])
    axes.line(INK, ends, width=1.4)
    axes.marks(ends, "|", INK, 6.0, width=1.0)
    figure.text(right - stretch * scale * bar - 6.0, top, f"residual {about(bar, 2)} {unit}", anchor="end")
    told = [f"{about(v, 2)} {unit}, mean of {n}" for v, n in zip(lengths.tolist(), means.counts.tolist(), strict=True)]
    axes.hover(means.at, told, 9.0)
    return figure.svg(label)


def _arrows(axes: Axes, at: Floats, ends: Floats) -> None:
    """Shafts, and heads of two barbs, drawn in points of the figure and told back in data."""
    axes.line(DOT, *np.stack([at, ends], axis=1), width=0.9)
    tip = axes.at(ends)
    along = tip - axes.at(at)
    length = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    back = -along / length * np.minimum(_BARB, 0.4 * length)
    aside = 0.5 * np.stack([-back[:, 1], back[:, 0]], axis=1)
    axes.line(DOT, *axes.data(np.stack([tip + back + aside, tip, tip + back - aside], axis=1)), width=0.9)


MOST_ROWS = 12  # of a table
_NAMED = 3  # files for each reason
_NOT_NOISE = 2.0  # times what noise leaves of the means
_LEAST_PX, _LEAST_MM = 1e-4, 1e-4  # shorter arrows are not blown up
_MARGIN = 0.08  # of the plate, around its dots


def write_detections_page(found: Detections, sample: Sample, target: Target, camera: Camera, table: Path) -> Path:
    """Write `TABLE.html` beside the table of poses, all or nothing; its path. Raises InputError."""
    name, doubtful = table.name, sum(bool(row.doubt) for row in found.rows)
    poses = sum(row.found for row in found.rows)
    page = Page(
        f"Images to poses: {name}",
        "images to poses",
        f"What was found in the images of {name}",
        [
            *_refused(found, name),
            *_doubtful(found, name),
            *_some_images(sample),
            *_numbers(found.rows),
            *_maps(sample, target, camera),
            _time(found),
            origin({"Numbers": f"In full they are in {name}."}),
        ],
        lead=(
            f"Target “{target.name}”. ",
            verdict(f"{poses - doubtful:,}", "explained"),
            " found, ",
            verdict(f"{doubtful:,}", "undecided"),
            " found, doubtful, ",
            verdict(f"{len(found.rows) - poses:,}", "unexplained"),
            " refused.",
        ),
    )
    return page.write(table.with_name(f"{name}.html"))


def _refused(found: Detections, name: str) -> Iterator[Section]:
    rows = []
    for reason, files in by_reason(found.rows).items():
        more = ", ..." if len(files) > _NAMED else ""
        rows.append((reason, f"{len(files):,}", ", ".join(files[:_NAMED]) + more))
    if rows:
        head = ("why there is no pose", "images", "such as")
        yield Section("Refused", tables=[Table(head, rows, most=MOST_ROWS, where=name)])


def _doubtful(found: Detections, name: str) -> Iterator[Section]:
    worst = sorted((row for row in found.rows if row.doubt), key=lambda row: -row.values[SCALE])
    if worst:
        rows = [(row.file, about(row.values[SCALE]), nearest(row.values[RMS], 4), str(row.dots)) for row in worst]
        said = (
            "Residuals are larger than the dots’ noise explains, so that the pose may be off by more than is stated: "
            "check the camera’s calibration, the target’s dots and whether the plate is flat."
        )
        head = ("image", "scale", "residuals, RMS [px]", "dots")
        yield Section("Doubtful", [said], tables=[Table(head, rows, most=MOST_ROWS, where=name)])


def _some_images(sample: Sample) -> Iterator[Section]:
    caption = (
        "Blue rings: dots that the pose rests on; red: dots that should be seen and are not; violet: dots that fit no "
        "pose with the others; yellow crosses: found dots that are none of the target’s. Red and green lines: the "
        "target’s x and y axis. Refused images first, then the most doubtful, then others, evenly spread. "
        "--overlay DIR writes all of them, larger."
    )
    if sample.pictures:
        drawing = Drawing(caption=caption, pictures=[_picture(seen) for seen in sample.pictures])
        yield Section("Some images", figures=[drawing])


def _picture(seen: SeenImage) -> tuple[Picture, Words]:
    row, caption = seen.row, seen.row.file
    if row.found:
        kind, word = ("undecided", "doubtful") if row.doubt else ("explained", "found")
        caption += f": {row.dots} dots, {nearest(row.values[RMS], 4)} px RMS"
    else:
        kind, word = "unexplained", "refused"
    return picture(f"{caption}, {word}", seen.jpeg, seen.size), (verdict(word, kind), f" {caption}")


def _numbers(rows: Sequence[Detection]) -> Iterator[Section]:
    """Of all poses: the median and the worst."""
    values = values_of(rows)
    if not len(values):
        return
    missing, false = (values[:, NUMBERS.index(name)] for name in ("missing", "false"))
    dots = np.array([row.dots for row in rows if row.found])
    lines = [
        ("dots that the pose rests on", dots, 0),
        ("dots of the target that are missing", missing, 0),
        ("found dots that are none of the target's", false, 0),
        ("residuals, RMS per axis [px]", values[:, RMS], 4),
        ("scale: mean square of residuals over the stated one", values[:, SCALE], 2),
    ]
    for part, of in ((SIGMA, "stated deviation of"), (SHARED, "of it shared by all images,")):
        position, turn = values[:, part][:, :3].max(axis=1), np.degrees(values[:, part][:, 3:].max(axis=1))
        lines += [(f"{of} the position, largest axis [mm]", position, 4)]
        lines += [(f"{of} the rotation, largest axis [°]", turn, 5)]
    worst = [float(v.min() if v is dots else v.max()) for _, v, _ in lines]
    told = [
        (name, nearest(float(np.median(v)), d), nearest(w, d)) for (name, v, d), w in zip(lines, worst, strict=True)
    ]
    yield Section("Poses", tables=[Table(("of all poses", "median", "worst"), told)])


def _maps(sample: Sample, target: Target, camera: Camera) -> Iterator[Section]:
    if not len(sample.residuals.at):
        return
    low, high = target.dots.min(axis=0), target.dots.max(axis=0)
    edge = _MARGIN * float((high - low).max()) + target.radius
    x, y = ((float(low[k]) - edge, float(high[k]) + edge) for k in (0, 1))
    across, down = (-0.5, camera.width - 0.5), (camera.height - 0.5, -0.5)
    lens = "the lens is not quite as the camera file says, or its model does not fit: calibrate the camera again"
    bent = (
        "dots are not quite where the target file says, or the plate is not flat. A wrong lens shows here as well: "
        "where both maps are more than noise, calibrate first; --calibrate --refine-dots finds the dots, too"
    )
    image, plate = over_image(sample.residuals, camera.width, camera.height), over_plate(sample.residuals, target.dots)
    parts = []
    for title, means, spans, unit, least, why in (
        ("By place in the image", image, (across, down), "px", _LEAST_PX, lens),
        ("By dot of the plate", plate, (x, y), "mm", _LEAST_MM, bent),
    ):
        svg = arrow_svg(means, *spans, unit, unit, label=f"Mean residuals: {title}", least=least)
        warning = [Mark(f"More than noise: {why}.", "notice")] if means.rms > _NOT_NOISE * means.noise_rms else []
        parts.append(Section(title, warning, figures=[Drawing([svg], caption=_said(means, unit), style="fits")]))
    said = (
        f"Found minus predicted centres of {sample.measured} images, evenly spread, the most doubtful among them. "
        "Noise points nowhere, and its means shrink; what stays is the same in every image, and no mean of poses "
        "lessens what it does to them."
    )
    yield Section("Where residuals point", [said], parts=parts)


def _said(means: MeanVectors, unit: str) -> str:
    if not len(means.at):
        return "Too few residuals for means."
    return (
        f"{len(means.at)} means of {nearest(float(np.median(means.counts)), 0)} residuals each (median). Their RMS per "
        f"axis is {about(means.rms, 2)} {unit}; noise alone would leave {about(means.noise_rms, 2)} {unit}."
    )


def _time(found: Detections) -> Section:
    if not found.measured:
        return Section("Time", ["No image was measured now: all rows are those of the journal."])
    each = nearest(1e3 * found.seconds / found.measured, 1)
    said = f"{found.measured:,} images were measured now, in {each} ms of processor time each, all workers together."
    return Section("Time", [said])
