"""The page of `cpcal image detect`: counts with reasons, some images, where residuals point, time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cpcal.common.numbers import about, nearest
from cpcal.report.section import Drawing, Mark, Page, Picture, Section, Table, Words, origin, verdict
from cpcal.report.svg import DOT, EDGE, GRID, INK, Plot, Span, Svg, evenly, rectangle
from cpcal.vision.batch.detect import NUMBERS, RMS, SCALE, SHARED, SIGMA, Detection, Detections, by_reason, values_of
from cpcal.vision.batch.study_images import Sample
from cpcal.vision.camera import Camera
from cpcal.vision.measure import MeanVectors, over_image, over_plate
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# The figure of mean residuals as lines from dots where they are, not to scale; a bar tells how long they are.

_REACH = 0.9  # of the distance between places: how long the longest line is


def arrow_svg(means: MeanVectors, x: Span, y: Span, unit: str, *, label: str, least: float = 1e-9) -> Svg:
    """Lines within the frame `x`, `y` (left to right, bottom to top), lengths and places in `unit`.

    Lines that are shorter than `least` are not blown up to be seen.
    """
    plot = Plot((430.0, 456.0), x, y, (f"x [{unit}]", f"y [{unit}]"), margin=(24.0, 12.0), equal=True)
    plot.area("none", rectangle(x[0], y[0], x[1], y[1]), edge=GRID)
    if not len(means.at):
        return plot.svg(label)
    lengths = np.hypot(*means.mean.T)
    longest = max(float(lengths.max()), least)
    pitch = math.sqrt(abs(x[1] - x[0]) * abs(y[1] - y[0]) / max(len(means.at), 9))  # between neighbours, about
    stretch = _REACH * pitch / longest
    plot.line(DOT, *np.stack([means.at, means.at + stretch * means.mean], axis=1), width=0.9)
    plot.marks(means.at, "dot", EDGE, 3.6)
    bar = evenly(0.0, longest, 2)[-1]
    start, height = x[1] - math.copysign(stretch * bar, x[1] - x[0]), y[1] + 0.04 * (y[1] - y[0])
    plot.line(INK, [(start, height), (x[1], height)], width=1.4)
    left, top = plot.at([(start, height)])[0].tolist()
    plot.text(left - 6.0, top, f"residual {about(bar, 2)} {unit}", anchor="end")
    told = [f"{about(v, 2)} {unit}, mean of {n}" for v, n in zip(lengths.tolist(), means.counts.tolist(), strict=True)]
    plot.hover(means.at, told, 9.0)
    return plot.svg(label)


# ------------------------------------------------------------------------------------------------------------------
# The page.

MOST_ROWS = 12  # of a table
_NAMED = 3  # files for each reason
_NOT_NOISE = 2.0  # times what noise leaves of the means
_LEAST = 1e-4  # px or mm, shorter lines are not blown up
_MARGIN = 0.08  # of the plate, around its dots


def write_detections_page(found: Detections, sample: Sample, target: Target, camera: Camera, table: Path) -> Path:
    """Write `TABLE.html` beside the table of poses, all or nothing; its path. Raises InputError."""
    name, doubtful = table.name, sum(bool(row.doubt) for row in found.rows)
    poses = sum(row.found for row in found.rows)
    time = "No image was measured now: all rows are those of the journal."
    if found.measured:
        each = nearest(1e3 * found.seconds / found.measured, 1)
        time = (
            f"{found.measured:,} images were measured now, in {each} ms of processor time each, all workers together."
        )
    page = Page(
        f"Images to poses: {name}",
        "images to poses",
        f"What was found in the images of {name}",
        [
            *_rejected(found, name),
            *_some_images(sample),
            *_numbers(found.rows),
            *_maps(sample, target, camera),
            origin({"Numbers": f"In full they are in {name}.", "Time": time}),
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


def _rejected(found: Detections, name: str) -> Iterator[Section]:
    """Images without a pose, and with a doubtful one."""
    refused = [
        (reason, f"{len(files):,}", ", ".join(files[:_NAMED]) + ", ..." * (len(files) > _NAMED))
        for reason, files in by_reason(found.rows).items()
    ]
    if refused:
        head = ("why there is no pose", "images", "such as")
        yield Section("Refused", tables=[Table(head, refused, most=MOST_ROWS, where=name)])
    worst = sorted((row for row in found.rows if row.doubt), key=lambda row: -row.values[SCALE])
    if worst:
        rows = [(row.file, about(row.values[SCALE]), nearest(row.values[RMS], 4), str(row.dots)) for row in worst]
        said = (
            "Residuals are larger than the dots’ noise explains, so that the pose may be off by more than is stated: "
            "check the camera’s calibration, the target’s dots and whether the plate is flat."
        )
        doubtful = Table(("image", "scale", "residuals, RMS [px]", "dots"), rows, most=MOST_ROWS, where=name)
        yield Section("Doubtful", [said], tables=[doubtful])


def _some_images(sample: Sample) -> Iterator[Section]:
    pictures: list[tuple[Picture, Words]] = []
    for seen in sample.pictures:
        row, caption, kind, word = seen.row, seen.row.file, "unexplained", "refused"
        if row.found:
            kind, word = ("undecided", "doubtful") if row.doubt else ("explained", "found")
            caption += f": {row.dots} dots, {nearest(row.values[RMS], 4)} px RMS"
        words = verdict(word, kind), f" {caption}"
        pictures.append((Picture(f"{caption}, {word}", seen.jpeg, seen.size), words))
    caption = (
        "Blue rings: dots that the pose rests on; red: dots that should be seen and are not; violet: dots that fit no "
        "pose with the others; yellow crosses: found dots that are none of the target’s. Red and green lines: the "
        "target’s x and y axis. Refused images first, then the most doubtful, then others, evenly spread. "
        "--overlay DIR writes all of them, larger."
    )
    if pictures:
        yield Section("Some images", figures=[Drawing(caption=caption, pictures=pictures)])


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
    told = []
    for name, of_all, decimals in lines:
        worst = of_all.min() if of_all is dots else of_all.max()
        told.append((name, nearest(float(np.median(of_all)), decimals), nearest(float(worst), decimals)))
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
        "where both maps are more than noise, calibrate first"
    )
    image, plate = over_image(sample.residuals, camera.width, camera.height), over_plate(sample.residuals, target.dots)
    parts = []
    for title, means, spans, unit, why in (
        ("By place in the image", image, (across, down), "px", lens),
        ("By dot of the plate", plate, (x, y), "mm", bent),
    ):
        caption = "Too few residuals for means."
        if len(means.at):
            caption = (
                f"{len(means.at)} means of {nearest(float(np.median(means.counts)), 0)} residuals each (median). Their "
                f"RMS per axis is {about(means.rms, 2)} {unit}; noise alone would leave {about(means.noise_rms, 2)} "
                f"{unit}."
            )
        svg = arrow_svg(means, *spans, unit, label=f"Mean residuals: {title}", least=_LEAST)
        warning = [Mark(f"More than noise: {why}.", "notice")] if means.rms > _NOT_NOISE * means.noise_rms else []
        parts.append(Section(title, warning, figures=[Drawing([svg], caption=caption, style="fits")]))
    said = (
        f"Found minus predicted centres of {sample.measured} images, evenly spread, the most doubtful among them. "
        "Lines begin at the dots. Noise points nowhere, and its means shrink; what stays is the same in every image, "
        "and no mean of poses lessens what it does to them."
    )
    yield Section("Where residuals point", [said], parts=parts)
