"""The page of `cpcal image detect`: counts with reasons, some images, time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cpcal.common.numbers import about, nearest
from cpcal.report.section import Drawing, Page, Picture, Section, Table, Words, origin, verdict
from cpcal.robot.campaign import titled
from cpcal.vision.batch.detect import NUMBERS, RMS, SCALE, SHARED, SIGMA, Detection, Detections, by_reason, values_of
from cpcal.vision.batch.study_images import SeenImage
from cpcal.vision.files.plate_and_camera import CameraRecord
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# The page.

MOST_ROWS = 12  # of a table
_NAMED = 3  # files for each reason


def write_detections_page(
    found: Detections, pictures: Sequence[SeenImage], target: Target, lens: CameraRecord, table: Path
) -> Path:
    """Write `TABLE.html` beside the table of poses, all or nothing; its path. Raises InputError.

    Images that were simulated are called so, as the camera's provenance says.
    """
    name, doubtful = table.name, sum(bool(row.doubt) for row in found.rows)
    poses = sum(row.found for row in found.rows)
    time = "No image was measured now: all rows are those of the journal."
    if found.measured:
        each = nearest(1e3 * found.seconds / found.measured, 1)
        time = (
            f"{found.measured:,} images were measured now, in {each} ms of processor time each, all workers together."
        )
    page = Page(
        titled(f"Images to poses: {name}", lens.provenance),
        "images to poses",
        titled(f"What was found in the images of {name}", lens.provenance),
        [
            *rejected(found, name),
            *_some_images(pictures),
            *numbers(found.rows),
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


def rejected(found: Detections, name: str) -> Iterator[Section]:
    """Images without a pose, and with a doubtful one: on the page and on a terminal."""
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


def _some_images(seen_images: Sequence[SeenImage]) -> Iterator[Section]:
    pictures: list[tuple[Picture, Words]] = []
    for seen in seen_images:
        row, caption, kind, word = seen.row, seen.row.file, "unexplained", "refused"
        if row.found:
            kind, word = ("undecided", "doubtful") if row.doubt else ("explained", "found")
            caption += f": {row.dots} dots, {nearest(row.values[RMS], 4)} px RMS"
        words = verdict(word, kind), f" {caption}"
        pictures.append((Picture(f"{caption}, {word}", seen.jpeg, seen.size), words))
    caption = (
        "Blue rings: dots that the pose rests on; red: dots that should be seen and are not; violet: dots that fit no "
        "pose with the others; yellow crosses: found dots that are none of the target’s. Red and green lines: the "
        "target’s x and y axis. Refused images first, then the most doubtful, then others, evenly spread."
    )
    if pictures:
        yield Section("Some images", figures=[Drawing(caption=caption, pictures=pictures)])


def numbers(rows: Sequence[Detection]) -> Iterator[Section]:
    """Of all poses the median and the worst: on the page and on a terminal."""
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
