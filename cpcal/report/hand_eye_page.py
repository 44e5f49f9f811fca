"""The pages of hand-eye runs, and the camera's frame as other programs take it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
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
    gap_text,
    nearest,
    rounded_down,
    rounded_up,
    stated,
)
from cpcal.models.frames import PlacedFrames, exact_study
from cpcal.models.hand_eye import HandEyeStudy
from cpcal.questions.hand_eye import PARAMETERS, HandEyeResult, WrongImages, exact_readings
from cpcal.report.figures import Enclosure, enclosure_svg
from cpcal.report.section import Drawing, Page, Section, Table, origin, verdict
from cpcal.report.svg import DASHES, DOT, GRID, INK, SUPPORT, Figure, Svg, chart, counted
from cpcal.robot import normalised, rotation_matrix

# ------------------------------------------------------------------------------------------------------------------
# A figure: the largest error of a pixel in each image.

_SIZE = (620.0, 190.0)  # points


def image_errors_svg(images: Sequence[tuple[str, float, bool]], full: float, dashed: float, label: str) -> Svg:
    """Name, px and whether it is within the tolerance, of each image; two lines across, px."""
    heights = [min(value, 1e6) for _, value, _ in images]
    figure, count = Figure(*_SIZE), len(images)
    x, y = (0.0, count + 1.0), (0.0, 1.08 * max([*heights, dashed, full, 1e-9]))
    labels = "image, in the order of poses.csv", "largest error [px]"
    axes = chart(figure, x, y, labels, across=counted(count, 12), grid=True, most=5)
    for (name, exact, ok), height, k in zip(images, heights, range(1, count + 1), strict=True):
        axes.line(GRID, [(k, 0.0), (k, height)], width=1.2)
        axes.dots([(k, height)], DOT if ok else SUPPORT, 5.0)
        axes.hover([(k, height)], [f"{name}: {at_most(exact, 4)} px"])
    axes.across((full,), INK, 1.0)
    axes.across((dashed,), INK, 1.0, DASHES)
    return figure.svg(label)


HAND_EYE_PAGE = "handeye.html"
WRONG_PAGE = "handeye-wrong.html"
_MOST = 40  # rows of a table
_CHECKED = (
    "weights that exact rational arithmetic accepts, on rows that the checker forms from study.json. cpcal verify "
    "checks them again."
)


def write_hand_eye(found: HandEyeResult, folder: str | os.PathLike[str]) -> Path:
    """Write `handeye.html` into the folder; its path. The same result gives the same bytes."""
    asked, *rest = sentences(found)
    proofs = f"Certificates (*.cert.jsonl): {_CHECKED} {found.programs:,} linear programs, {about(found.seconds)} s."
    page = Page(
        f"Hand-eye calibration: {found.setup}",
        "hand-eye calibration",
        "How well do any frames explain the pixels?",
        [
            _answer(found, rest[:-1] if rest and rest[-1].endswith(":") else rest),
            _ranges(found),
            _classical(found),
            *_support(found),
            origin({"Proofs": proofs}, f"Certified by cpcal {found.version}."),
        ],
        lead=asked,
    )
    return page.write(Path(folder) / HAND_EYE_PAGE)


def _answer(found: HandEyeResult, rest: Sequence[str]) -> Section:
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    first = (
        f" The smallest possible largest error eps* lies in [{low}, {high}] px (width "
        f"{gap_text(found.eps_lo, found.eps_hi)})."
    )
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
    return Section("Answer", [(badge, first), *rest], notes=[note])


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
    places = [0, 1, 2, 6, 7, 8]
    best, classical = (
        np.array([*point.camera_position, *point.target_position]) for point in (found.point, found.asked.center)
    )
    data = Enclosure([names[k][0] for k in places], best, low[places], high[places], classical)
    svg = enclosure_svg(data, label="Ranges of the positions", origin="best frames")
    caption = "Ranges of the positions about the best frames; the mark is the least-squares answer."
    positions = Section(figures=[Drawing([svg], caption=caption, style="scroll narrow")])
    return Section(
        title,
        [f"All frames in the box that explain every pixel to within {tolerance} px have these parameters. Proved."],
        tables=[Table(("parameter", "at least", "at most", "width", "unit"), known)],
        notes=["Turns are the rotation vector, in degrees, from the rotation of the best frames below."],
        parts=[positions, frames],
    )


_FRAME_HEAD = ("frame", "x, y, z [mm]", "qw, qx, qy, qz")


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


def _support(found: HandEyeResult) -> Iterator[Section]:
    points: dict[str, list[str]] = {}
    for image, point in found.support:
        points.setdefault(image, []).append(point)
    if points:
        said = (
            "The last step of the proof uses these points. Look at them first: a slipped board, a wrong pose, a "
            "badly found corner."
        )
        items = [f"{image}: {', '.join(names)}" for image, names in points.items()][:_MOST]
        yield Section("What forces the lower end", [said], items, style="few names")


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
# The camera's frame of a hand-eye run, as other programs take it, with the proved ranges beside each number.
#
# What is written are the best frames found: those that attain the upper end of the bracket. Lengths are in m where the
# format has them in m.


def _parent(found: HandEyeResult) -> str:
    return "tool0" if found.setup == "eye-in-hand" else "base_link"


def _told(found: HandEyeResult, mark: str) -> list[str]:
    """What is proved, as comments."""
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    said = [f"cpcal {found.version}, {found.setup}: camera in {_parent(found)}; eps* in [{low}, {high}] px"]
    if found.ranges.empty:
        return [f"{mark} {said[0]}"]
    said.append(f"proved of all frames that explain every pixel to {at_least(found.ranges.eps, 4)} px:")
    names = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
    for k, name in enumerate(names):
        unit = "mm" if k < 3 else "deg from the rotation below"
        said.append(f"  {name}: {rounded_down(found.ranges.low[k], 4)} to {rounded_up(found.ranges.high[k], 4)} {unit}")
    return [f"{mark} {line}" for line in said]


def _metres(found: HandEyeResult) -> list[tuple[str, str]]:
    """Position in m and quaternion, by the names that ROS has for them."""
    (w, i, j, k), position = found.point.camera_quaternion, (v / 1000.0 for v in found.point.camera_position)
    return list(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), map(repr, (*position, i, j, k, w)), strict=True))


def _ros2(found: HandEyeResult) -> str:
    """A node of a ROS 2 launch file in Python."""
    given = [*_metres(found), ("frame-id", _parent(found)), ("child-frame-id", "camera_optical_frame")]
    head = ["from launch_ros.actions import Node", "", *_told(found, "#"), "Node("]
    head += ['    package="tf2_ros",', '    executable="static_transform_publisher",', "    arguments=["]
    return "\n".join([*head, *(f'        "--{name}", "{value}",' for name, value in given), "    ],", ")"]) + "\n"


def _easy_handeye(found: HandEyeResult) -> str:
    """A calibration file of easy_handeye."""
    in_hand = found.setup == "eye-in-hand"
    base = "robot_effector_frame: tool0" if in_hand else "robot_base_frame: base_link"
    lines = [*_told(found, "#"), "parameters:", f"  eye_on_hand: {str(in_hand).lower()}", f"  {base}"]
    lines += ["  tracking_base_frame: camera_optical_frame", "transformation:"]
    return "\n".join([*lines, *(f"  {name}: {value}" for name, value in _metres(found))]) + "\n"


def _urdf(found: HandEyeResult) -> str:
    """A fixed joint; rpy are turns about fixed axes x, y, z in that order, rad."""
    r = rotation_matrix(normalised(found.point.camera_quaternion)).tolist()
    roll, yaw = math.atan2(r[2][1], r[2][2]), math.atan2(r[1][0], r[0][0])
    pitch, xyz = math.asin(max(-1.0, min(1.0, -r[2][0]))), " ".join(value for _, value in _metres(found)[:3])
    lines = ["<!--", *(f"  {line}" for line in _told(found, "")), "-->"]
    lines += ['<joint name="camera_optical_joint" type="fixed">', f'  <parent link="{_parent(found)}"/>']
    lines += ['  <child link="camera_optical_frame"/>']
    lines += [f'  <origin xyz="{xyz}" rpy="{roll!r} {pitch!r} {yaw!r}"/>', "</joint>"]
    return "\n".join(lines) + "\n"


def _opencv(found: HandEyeResult) -> str:
    """Matrices of both frames for cv::FileStorage, translations in mm, named as OpenCV's functions name them."""
    point, in_hand = found.point, found.setup == "eye-in-hand"
    camera, target = ("cam2gripper", "target2base") if in_hand else ("cam2base", "target2gripper")
    lines = ["%YAML:1.0", "---", *_told(found, "#")]
    for name, position, quaternion in (
        (camera, point.camera_position, point.camera_quaternion),
        (target, point.target_position, point.target_quaternion),
    ):
        turn = rotation_matrix(normalised(quaternion)).ravel().tolist()
        for letter, columns, values in (("R", 3, turn), ("t", 1, position)):
            lines += [f"{letter}_{name}: !!opencv-matrix", "  rows: 3", f"  cols: {columns}", "  dt: d"]
            lines += [f"  data: [ {', '.join(map(repr, values))} ]"]
    return "\n".join(lines) + "\n"


HAND_EYE_FORMS: dict[str, Callable[[HandEyeResult], str]] = {
    "ros2": _ros2,
    "easy-handeye": _easy_handeye,
    "urdf": _urdf,
    "opencv": _opencv,
}


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
