"""The page of a hand-eye run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from cpcal.common.files import write_file
from cpcal.common.numbers import about, at_least, at_most, bracket_text, gap_text, nearest, rounded_down, rounded_up
from cpcal.handeye.certify import HandEyeResult
from cpcal.handeye.words import frames_of, names_of, sentences
from cpcal.report.page import rendered, versions
from cpcal.report.svg import (
    DASHES,
    DOT,
    GRID,
    INK,
    SUPPORT,
    Axes,
    Enclosure,
    Figure,
    enclosure_svg,
    label_room,
    tick_labels,
    ticks,
)

# ------------------------------------------------------------------------------------------------------------------
# A figure: the largest error of a pixel in each image.

_SIZE = (620.0, 190.0)  # points


def image_errors_svg(images: Sequence[tuple[str, float, bool]], full: float, dashed: float, label: str) -> str:
    """Name, px and whether it is within the tolerance, of each image; two lines across, px."""
    drawn = [min(value, 1e6) for _, value, _ in images]
    top = 1.08 * max([*drawn, dashed, full, 1e-9])
    numbers = ticks(0.0, top, 5)
    figure, count = Figure(*_SIZE), len(images)
    left = label_room(tick_labels(numbers)) + 8.0
    axes = Axes(figure, (left, 6.0, _SIZE[0] - 12.0, _SIZE[1] - 32.0), (0.0, count + 1.0), (0.0, top))
    axes.y_axis(numbers, "largest error [px]", grid=True)
    axes.x_axis(
        [t for t in ticks(0.0, count + 1.0, 12, whole=True) if 1.0 <= t <= count], "image, in the order of poses.csv"
    )
    for (name, exact, ok), value, k in zip(images, drawn, range(1, count + 1), strict=True):
        axes.line([(k, 0.0), (k, value)], GRID, 1.2)
        axes.dots([(k, value)], DOT if ok else SUPPORT, 5.0)
        axes.hover([(k, value)], [f"{name}: {at_most(exact, 4)} px"])
    axes.line([(0.0, full), (count + 1.0, full)], INK, 1.0)
    axes.line([(0.0, dashed), (count + 1.0, dashed)], INK, 1.0, DASHES)
    return figure.svg(label)


HAND_EYE_PAGE = "handeye.html"
_MOST = 40  # rows of a table


def write_hand_eye(found: HandEyeResult, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye.html` into the folder; its path. The same result gives the same bytes."""
    return write_file(Path(folder) / HAND_EYE_PAGE, rendered("handeye.html.j2", _context(found)))


def _context(found: HandEyeResult) -> dict[str, Any]:
    first, *rest = sentences(found)
    camera, target = frames_of(found.setup)
    point, classical = found.point, found.asked.center
    ranges = found.ranges
    return {
        "setup": found.setup,
        "asked": first,
        "verdict": _verdict(found),
        "bracket": bracket_text(found.eps_lo, found.eps_hi),
        "gap": gap_text(found.eps_lo, found.eps_hi),
        "sentences": rest[:-1] if rest and rest[-1].endswith(":") else rest,
        "tolerance": at_least(ranges.eps, 4),
        "empty": ranges.empty,
        "rows": [] if ranges.empty else _rows(found),
        "positions": None if ranges.empty else Markup(_positions(found)),  # made by us
        "errors": Markup(_errors(found)),
        "images": _images(found),
        "more_images": max(len(found.classical.images) - _MOST, 0),
        "frames": [
            (camera, _position(point.camera_position), _quaternion(point.camera_quaternion)),
            (target, _position(point.target_position), _quaternion(point.target_quaternion)),
        ],
        "least_squares": [
            (camera, _position(classical.camera_position), _quaternion(classical.camera_quaternion)),
            (target, _position(classical.target_position), _quaternion(classical.target_quaternion)),
        ],
        "support": _support(found),
        "remarks": found.remarks,
        "uncertain": found.uncertain,
        "programs": f"{found.programs:,}",
        "seconds": about(found.seconds),
        "version": found.version,
        "versions": versions(),
    }


def _verdict(found: HandEyeResult) -> tuple[str, str]:
    """Style and word."""
    if found.tolerance is not None:
        if found.passes is None:
            return "undecided", "undecided"
        return ("explained", "tolerance met") if found.passes else ("unexplained", "tolerance refuted")
    return ("explained", "bracket closed") if found.complete else ("undecided", "bracket open")


def _rows(found: HandEyeResult) -> list[tuple[str, ...]]:
    """Name, ends, width and unit of each parameter."""
    ends = zip(found.ranges.low, found.ranges.high, strict=True)
    return [
        (
            name,
            rounded_down(low, 4),
            rounded_up(high, 4),
            at_most(high - low, 3),
            unit,
        )
        for (name, unit), (low, high) in zip(names_of(found.setup), ends, strict=True)
    ]


def _positions(found: HandEyeResult) -> str:
    """Ranges of the six position parameters about the point."""
    places = [0, 1, 2, 6, 7, 8]
    names = names_of(found.setup)
    point = np.array([*found.point.camera_position, *found.point.target_position])
    classical = found.asked.center
    data = Enclosure(
        tuple(names[k][0] for k in places),
        point,
        np.array(found.ranges.low)[places],
        np.array(found.ranges.high)[places],
        np.array([*classical.camera_position, *classical.target_position]),
    )
    return enclosure_svg(data, label="Ranges of the positions", origin="best frames")


def _errors(found: HandEyeResult) -> str:
    """The largest error of the least-squares answer in each image, with the bracket and the tolerance."""
    drawn = [(verdict.image, verdict.largest, verdict.ok) for verdict in found.classical.images]
    return image_errors_svg(drawn, found.eps_hi, found.ranges.eps, "Largest error of least squares in each image")


def _images(found: HandEyeResult) -> list[tuple[str, str, str]]:
    """Worst first."""
    worst = sorted(found.classical.images, key=lambda verdict: -verdict.largest)[:_MOST]
    return [(v.image, at_most(v.largest, 4), "within" if v.ok else "beyond") for v in worst]


def _support(found: HandEyeResult) -> list[str]:
    """A line an image."""
    points: dict[str, list[str]] = {}
    for image, point in found.support:
        points.setdefault(image, []).append(point)
    return [f"{image}: {', '.join(names)}" for image, names in points.items()][:_MOST]


def _position(values: tuple[float, ...]) -> str:
    return ", ".join(nearest(v, 4) for v in values)


def _quaternion(values: tuple[float, ...]) -> str:
    return ", ".join(nearest(v, 7) for v in values)
