"""The pages of hand-eye runs, and the camera's frame as other programs take it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cpcal.checker.hand_eye import errors, largest
from cpcal.checker.readers import up
from cpcal.common.files import listed
from cpcal.common.numbers import (
    about,
    at_least,
    at_most,
    bracket_text,
    nearest,
    rounded_down,
    rounded_up,
    stated,
)
from cpcal.models.frames import PlacedFrames, exact_study
from cpcal.models.hand_eye import HandEyeStudy
from cpcal.questions.hand_eye import PARAMETERS, HandEyeResult, WrongImages, exact_readings
from cpcal.report.figures import Bar, bars_svg, series
from cpcal.report.section import Drawing, Page, Section, Table, origin, verdict
from cpcal.report.svg import DASHES, DOT, GRID, INK, SUPPORT, Svg

HAND_EYE_PAGE = "handeye.html"
WRONG_PAGE = "handeye-wrong.html"
_MOST = 40  # rows of a table
_CHECKED = (
    "weights that exact rational arithmetic accepts, on rows that the checker forms from study.json. cpcal verify "
    "checks them again."
)
_FRAME_HEAD = ("frame", "x, y, z [mm]", "qw, qx, qy, qz")


def image_errors_svg(images: Sequence[tuple[str, float, bool]], full: float, dashed: float, label: str) -> Svg:
    """Name, largest error of a pixel and whether it is within the tolerance, of each image; two lines across, px."""
    heights = [min(value, 1e6) for _, value, _ in images]
    labels = "image, in the order of poses.csv", "largest error [px]"
    plot = series((620.0, 190.0), len(images), np.array([0.0, full, dashed, *heights]), labels, floor=0.0)
    points = [(k, height) for k, height in enumerate(heights, 1)]
    plot.line(GRID, *([(k, 0.0), (k, height)] for k, height in points), width=1.2)
    for within, colour in ((True, DOT), (False, SUPPORT)):
        some = [point for point, (_, _, ok) in zip(points, images, strict=True) if ok is within]
        plot.marks(some, "dot", colour, 5.0)
    plot.hover(points, [f"{name}: {at_most(exact, 4)} px" for name, exact, _ in images])
    plot.across((full,), INK, 1.0)
    plot.across((dashed,), INK, 1.0, DASHES)
    return plot.svg(label)


def write_hand_eye(found: HandEyeResult, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye.html` into the folder; its path. The same result gives the same bytes."""
    asked, first, *rest = sentences(found)
    proofs = f"Certificates (*.cert.jsonl): {_CHECKED} {found.programs:,} linear programs, {about(found.seconds)} s."
    note = (
        "Proved of the numbers in the study: camera and target's points are taken as exact, robot's poses too but for "
        "the half-widths that the study states. Errors are measured on undistorted pixels."
    )
    if found.tolerance is None:
        badge = verdict("bracket closed", "explained") if found.complete else verdict("bracket open", "undecided")
    elif found.passes is None:
        badge = verdict("undecided", "undecided")
    else:
        badge = verdict("tolerance met", "explained") if found.passes else verdict("tolerance refuted", "unexplained")
    points: dict[str, list[str]] = {}
    for image, point in found.support:
        points.setdefault(image, []).append(point)
    forced = (
        "The last step of the proof uses these points. Look at them first: a slipped board, a wrong pose, a badly "
        "found corner."
    )
    items = [f"{image}: {', '.join(names)}" for image, names in points.items()][:_MOST]
    support = [Section("What forces the lower end", [forced], items, style="few names")] if items else []
    said = [sentence for sentence in rest if not sentence.endswith(":")]  # the last one announces the ranges
    page = Page(
        f"Hand-eye calibration: {found.setup}",
        "hand-eye calibration",
        "How well do any frames explain the pixels?",
        [
            Section("Answer", [(badge, f" {first}"), *said], notes=[note]),
            _ranges(found),
            _classical(found),
            *support,
            origin({"Proofs": proofs}, f"Certified by cpcal {found.version}."),
        ],
        lead=asked,
    )
    return page.write(Path(folder) / HAND_EYE_PAGE)


def _ranges(found: HandEyeResult) -> Section:
    tolerance = at_least(found.ranges.eps, 4)
    cameras = [("best found", found.point), ("least squares", found.asked.center)]
    rows = [(name, *row) for name, point in cameras for row in _frame_rows(found.setup, point)]
    frames = Section(
        "Frames",
        tables=[Table(("", *_FRAME_HEAD), rows)],
        notes=["“Best found” attains the upper end of the bracket. Numbers in full are in handeye.json."],
    )
    title = "How well the frames are known"
    if found.ranges.empty:
        said = f"No frames in the box explain every pixel to within {tolerance} px. Proved."
        return Section(title, [said], parts=[frames])
    names, low, high = names_of(found.setup), np.array(found.ranges.low), np.array(found.ranges.high)
    known = [
        (name, rounded_down(lo, 4), rounded_up(hi, 4), at_most(hi - lo, 3), unit)
        for (name, unit), lo, hi in zip(names, low.tolist(), high.tolist(), strict=True)
    ]
    best, classical = ((*p.camera_position, *p.target_position) for p in (found.point, found.asked.center))
    bars = []
    for k, middle, fit in zip((0, 1, 2, 6, 7, 8), best, classical, strict=True):
        lo, hi = float(low[k]), float(high[k])
        bars.append(Bar(names[k][0], lo - middle, hi - middle, fit - middle, at_most(hi - lo, 2)))
    svg = bars_svg(bars, "position − best frames [mm]", "Ranges of the positions", words=(math.inf, "width [mm]"))
    caption = "Ranges of the positions about the best frames; the mark is the least-squares answer."
    return Section(
        title,
        [f"All frames in the box that explain every pixel to within {tolerance} px have these parameters. Proved."],
        tables=[Table(("parameter", "at least", "at most", "width", "unit"), known)],
        notes=["Turns are the rotation vector, in degrees, from the rotation of the best frames below."],
        parts=[Section(figures=[Drawing([svg], caption=caption, style="scroll narrow")]), frames],
    )


def _frame_rows(setup: str, point: PlacedFrames) -> list[tuple[str, ...]]:
    places = (point.camera_position, point.camera_quaternion), (point.target_position, point.target_quaternion)
    return [
        (name, ", ".join(nearest(v, 4) for v in position), ", ".join(nearest(v, 7) for v in quaternion))
        for name, (position, quaternion) in zip(frames_of(setup), places, strict=True)
    ]


def _classical(found: HandEyeResult) -> Section:
    """The largest error of the least-squares answer in each image, with the bracket and the tolerance."""
    images, tolerance = found.classical.images, at_least(found.ranges.eps, 4)
    drawn, label = [(v.image, v.largest, v.ok) for v in images], "Largest error of least squares in each image"
    svg = image_errors_svg(drawn, found.eps_hi, found.ranges.eps, label)
    readings = ", at the fit's readings of the poses" * found.uncertain
    caption = (
        f"Largest error in each image, in exact arithmetic{readings}. Full line: upper end of the bracket; dashed: "
        f"{tolerance} px."
    )
    worst = sorted(images, key=lambda v: -v.largest)
    rows = [(v.image, at_most(v.largest, 4), "within" if v.ok else "beyond") for v in worst]
    table = Table(("image", "largest error [px]", f"{tolerance} px"), rows, most=_MOST, where="handeye.json")
    return Section(
        "The least-squares answer, image by image",
        figures=[Drawing([svg], caption=caption)],
        parts=[Section("Images, worst first", tables=[table], folded=True)],
    )


# ------------------------------------------------------------------------------------------------------------------
# The page of wrong images.


def write_wrong_images(study: HandEyeStudy, found: WrongImages, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye-wrong.html` into the folder; its path. The same result gives the same bytes."""
    proofs = f"wrong-*.cert.jsonl: {_CHECKED} {about(found.seconds)} s."
    page = Page(
        "Hand-eye calibration: wrong images",
        "hand-eye calibration",
        "Which images are wrong?",
        [
            _wrong(study, found),
            *_blamed(found),
            Section(
                "Frames without the wrong images", tables=[Table(_FRAME_HEAD, _frame_rows(study.setup, found.point))]
            ),
            origin({"Proofs": proofs}, f"Found by cpcal {found.version}."),
        ],
        lead=(
            f"Of {len(study.images)} images at most {found.outliers} may be wrong: a slipped board, a wrong robot "
            "pose, a wrong name."
        ),
    )
    return page.write(Path(folder) / WRONG_PAGE)


def _wrong(study: HandEyeStudy, found: WrongImages) -> Section:
    """With the errors of the frames that explain all images but those left out; in these at the stated poses."""
    kept = [k for k, name in enumerate(study.images) if name not in found.left_out]
    readings: list[tuple[float, ...]] = []
    if found.readings:
        readings = [(0.0,) * 6] * len(study.images)
        for k, reading in zip(kept, found.readings, strict=True):
            readings[k] = reading
    excess = errors(exact_study(study), found.point.numbers, exact_readings(readings))
    drawn = []
    for k, name in enumerate(study.images):
        worst = largest(excess[n] for n in np.flatnonzero(study.image == k))
        drawn.append((name, math.inf if worst is None else up(worst), k in kept))
    svg = image_errors_svg(drawn, found.eps_hi, found.asked_tolerance, "Largest error of the best frames in each image")
    caption = (
        "Largest error of the best frames in each image, in exact arithmetic; those left out are marked. Full line: "
        f"what all others are explained to; dashed: {at_most(found.asked_tolerance, 5)} px."
    )
    first, *rest = wrong_sentences(found)
    proved = len(dict(found.blamed)) == len(found.left_out)
    badge = verdict("proved", "explained") if proved else verdict("not all proved", "undecided")
    return Section("Answer", [(badge, f" {first}"), *rest], figures=[Drawing([svg], caption=caption)])


def _blamed(found: WrongImages) -> Iterator[Section]:
    if found.blamed:
        said = (
            "Each group below has no image in common with another, and no frames explain it together with the image "
            f"to {at_most(found.asked_tolerance, 5)} px. Were the image right, each group would hold a wrong one: one "
            "more than there may be."
        )
        parts = [
            Section(
                f"{image}: {len(why)} groups",
                items=[", ".join(name for name in reason.images if name != image) for reason in why],
                folded=True,
            )
            for image, why in found.blamed
        ]
        yield Section("Why they are wrong", [said], parts=parts, style="names")
    if found.groups:
        one = found.outliers == 1
        which, none = (
            ("image is", "does not hold it") if one else (f"{found.outliers} images are", "holds none of them")
        )
        said = (
            f"Whichever {which} wrong, one of these groups {none}, and no frames explain it to "
            f"{at_least(found.eps_lo, 5)} px."
        )
        yield Section("What forces the lower end", [said], [", ".join(g.images) for g in found.groups], style="names")


# ------------------------------------------------------------------------------------------------------------------
# What is proved of a hand-eye study, in sentences; numbers rounded to the safe side.


def frames_of(setup: str) -> tuple[str, str]:
    """The names of X and F."""
    return ("camera in hand", "target in base") if setup == "eye-in-hand" else ("camera in base", "target in hand")


def names_of(setup: str) -> list[tuple[str, str]]:
    """Name and unit of each of PARAMETERS."""
    camera, target = frames_of(setup)
    named = {"camera": camera, "target": target}
    found = []
    for parameter in PARAMETERS:
        frame, axis = parameter.split()
        turned = axis.startswith("r")
        found.append((f"{named[frame]}: {'turn about ' + axis[1] if turned else axis}", "deg" if turned else "mm"))
    return found


def sentences(found: HandEyeResult) -> list[str]:
    """The answer in a few lines."""
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    turned = "any rotation" if found.asked.angle is None else f"rotations within {stated(found.asked.angle)} degrees"
    said = [
        f"{found.setup}: {found.images} images, {found.points:,} points. "
        f"Searched: {turned}, positions within {stated(found.asked.reach)} mm of the least-squares answer.",
    ]
    if found.uncertain:
        said.append("Robot poses are uncertain: a pixel is explained at some reading of its image's pose.")
    if found.eps_lo > 0.0:
        said.append(f"No frames explain every pixel to within {low} px (proved); some explain every one to {high} px.")
    else:
        said.append(f"Some frames explain every pixel to within {high} px (proved); nothing is proved from below.")
    if not found.complete:
        more = "more time (--time-limit)" if found.timed else "a smaller --within"
        said.append(f"The bracket is open: {more} may close it.")
    if found.tolerance is not None:
        word = {True: "met", False: "refuted: no frames in the box meet it", None: "undecided"}[found.passes]
        said.append(f"Tolerance {stated(found.tolerance)} px: {word}.")
    classical = found.classical
    failing = [verdict.image for verdict in classical.images if not verdict.ok]
    fit = "Least squares, at its own readings of the poses" if found.uncertain else "Least squares"
    said.append(
        f"{fit}: rms {nearest(found.rms, 3)} px, largest error {at_most(classical.largest, 4)} px; "
        f"over {at_least(found.ranges.eps, 4)} px in {len(failing)} of {found.images} images"
        + (f" ({listed(failing, 5)})." if failing else ".")
    )
    said += found.remarks
    if found.support:
        named = dict.fromkeys(image for image, _ in found.support)
        said.append(f"{len(found.support)} points of {len(named)} images force the lower end: {listed(named, 6)}.")
    if not found.ranges.empty:
        at = at_least(found.ranges.eps, 4)
        said.append(f"Every pair of frames that explains all pixels to {at} px lies here (proved):")
    return said


def wrong_sentences(found: WrongImages) -> list[str]:
    """What is proved when some images may be wrong, in a few lines."""
    low, high = at_least(found.eps_lo, 5), at_most(found.eps_hi, 5)
    left = ", ".join(found.left_out)
    said = [f"All images but {left} are explained to within {high} px by some frames (proved)."]
    if found.eps_lo > 0.0:
        which = "Whichever one is" if found.outliers == 1 else f"Whichever {found.outliers} are"
        said.append(f"{which} left out, no frames explain all others to {low} px (proved).")
    tolerance = at_most(found.asked_tolerance, 5)
    most = "one is" if found.outliers == 1 else f"{found.outliers} are"
    for image, _ in found.blamed:
        said.append(f"{image} is wrong, if at most {most} and right ones fit to {tolerance} px (proved).")
    proved = {image for image, _ in found.blamed}
    open_ = [image for image in found.left_out if image not in proved]
    if open_:
        said.append(f"Not proved to be wrong, though the others fit best without: {', '.join(open_)}.")
    return said
