"""The page of a hand-eye run, and its sentences."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cpcal.common.files import StrPath, listed
from cpcal.common.numbers import about, at_least, at_most, bracket_text, nearest, rounded_down, rounded_up, stated
from cpcal.questions.hand_eye import PARAMETERS, HandEyeResult, KnownPoint, load_hand_eye_result
from cpcal.report.figures import residuals_svg
from cpcal.report.section import Drawing, Mark, Page, Section, Table, origin, verdict
from cpcal.robot import Pose, distances, normalised, transformed
from cpcal.robot.campaign import titled

HAND_EYE_PAGE = "handeye.html"
BOTH = "exact", "uncertain"  # folders of the runs of one study: with exact poses, and with poses that may be off
_MOST = 40  # rows of a table
_CHECKED = (
    "weights that exact rational arithmetic accepts, on rows that the checker forms from study.json. cpcal verify "
    "checks them again."
)
_FRAMES = {
    "eye-in-hand": {"camera": "camera in hand", "target": "target in base"},
    "eye-to-hand": {"camera": "camera in base", "target": "target in hand"},
}


def write_hand_eye(found: HandEyeResult, folder: StrPath, name: str = HAND_EYE_PAGE) -> Path:
    """Write the page into the folder; its path. The same result gives the same bytes."""
    proofs = f"Certificates (*.cert.jsonl): {_CHECKED} {found.programs:,} linear programs, {about(found.seconds)} s."
    page = Page(
        titled(f"Hand-eye calibration: {found.setup}", found.provenance),
        "hand-eye calibration",
        "Which images are wrong?" if found.outliers else "How well do any frames explain the pixels?",
        [
            answered(found),
            *_blamed(found),
            *known_frames(found),
            _classical(found),
            *_others(found),
            *_forcing(found),
            origin({"Proofs": proofs}, f"Certified by cpcal {found.version}."),
        ],
        lead=searched(found),
    )
    return page.write(Path(folder) / name)


def write_both(run: Path, file: Path) -> Path:
    """Write the page of both questions about a study, from the runs in a folder; its path."""
    both = [load_hand_eye_result(run / name) for name in BOTH]
    exact = both[0]
    sections = [answered(found)._replace(title=question(found), parts=[*known_frames(found)]) for found in both]
    pages = {
        name: Mark(question(found), link=f"{name}/{HAND_EYE_PAGE}") for name, found in zip(BOTH, both, strict=True)
    }
    page = Page(
        titled(f"Hand-eye calibration: {exact.setup}, two questions", exact.provenance),
        "hand-eye calibration",
        "How well do any frames explain the pixels, and how far is the robot off?",
        [*sections, origin(pages, f"Certified by cpcal {exact.version}.")],
        lead=searched(exact),
    )
    return page.write(file)


def question(found: HandEyeResult) -> str:
    """What a run takes the robot's poses for, and what its eps* means."""
    if not found.readings:
        return "If the robot's poses are exact: eps* is the error of pixels and robot"
    told = found.provenance.get("half_widths", "as the study states")
    return f"If each pose may be off ({told}; assumed): eps* is the error of the pixels alone"


def answered(found: HandEyeResult) -> Section:
    """The answer: on the page and on a terminal."""
    first, *rest = sentences(found)
    word, kind = "undecided", "undecided"
    if found.outliers:
        proved = len(found.blamed) == len(found.left_out)
        word, kind = ("proved", "explained") if proved else ("not all proved", "undecided")
    elif found.tolerance is None:
        word, kind = ("bracket closed", "explained") if found.complete else ("bracket open", "undecided")
    elif found.passes is not None:
        word, kind = ("tolerance met", "explained") if found.passes else ("tolerance refuted", "unexplained")
    note = (
        "Proved of the numbers in the study: camera and target's points are taken as exact, robot's poses too but for "
        "the half-widths that the study states. Errors are measured on undistorted pixels."
    )
    return Section("Answer", [*known_sentence(found), (verdict(word, kind), f": {first}"), *rest], notes=[note])


def _blamed(found: HandEyeResult) -> Iterator[Section]:
    said = (
        "Each group below has no image in common with another, and no frames explain it together with the image to "
        f"{at_most(found.eps, 5)} px. Were the image right, each group would hold a wrong one: one more than there may "
        "be."
    )
    parts = [
        Section(
            f"{image}: {len(why)} groups",
            items=[", ".join(name for name in reason.images if name != image) for reason in why],
            folded=True,
        )
        for image, why in found.blamed
    ]
    if parts:
        yield Section("Why they are wrong", [said], parts=parts, style="names")


def _forcing(found: HandEyeResult) -> Iterator[Section]:
    """The groups that prove the lower end, where images may be wrong, and the points that the proofs use."""
    title = "What forces the lower end"
    if found.outliers and found.lower:
        which, none = ("image is", "does not hold it") if found.outliers == 1 else (
            f"{found.outliers} images are", "holds none of them")  # fmt: skip
        said = (
            f"Whichever {which} wrong, one of these groups {none}, and no frames explain it to "
            f"{at_least(found.eps_lo, 5)} px."
        )
        yield Section(title, [said], [", ".join(group.images) for group in found.lower], style="names")
        title = "Points that force it"
    points: dict[str, list[str]] = {}
    for image, point in found.support:
        points.setdefault(image, []).append(point)
    if points:
        forced = (
            "The last step of each proof uses these points. Look at them first: a slipped board, a wrong pose, a badly "
            "found corner."
        )
        items = [f"{image}: {', '.join(names)}" for image, names in points.items()]
        yield Section(title, [forced], items[:_MOST], style="few names")


def known_frames(found: HandEyeResult) -> Iterator[Section]:
    """How well the frames are known: on the page and on a terminal."""
    tolerance, ranges = at_least(found.eps, 4), found.ranges
    rows, called = [], _FRAMES[found.setup]
    for name, at in (("best found", found.point), ("least squares", found.asked.center)):
        for frame, position, quaternion in (
            ("camera", at.camera_position, at.camera_quaternion),
            ("target", at.target_position, at.target_quaternion),
        ):
            numbers = (nearest(v, 4) for v in position), (nearest(v, 7) for v in quaternion)
            rows.append((name, called[frame], *map(", ".join, numbers)))
    frames = Section(
        "Frames",
        tables=[Table(("", "frame", "x, y, z [mm]", "qw, qx, qy, qz"), rows, ("", "word"))],
        notes=["“Best found” attains the upper end of the bracket. Numbers in full are in handeye.json."],
    )
    title = "How well the frames are known"
    if ranges is None or ranges.empty:
        said = f"No frames in the box explain every pixel to within {tolerance} px. Proved."
        yield frames if ranges is None else Section(title, [said], parts=[frames])
        return
    known = []
    for parameter, lo, hi in zip(PARAMETERS, ranges.low, ranges.high, strict=True):
        frame, axis = parameter.split()
        axis, unit = (f"turn about {axis[1]}", "deg") if axis.startswith("r") else (axis, "mm")
        known.append((f"{called[frame]}: {axis}", rounded_down(lo, 4), rounded_up(hi, 4), at_most(hi - lo, 3), unit))
    yield Section(
        title,
        [
            f"All frames in the box that explain every pixel to within {tolerance} px have these parameters. Proved"
            f"{given_values(found)}."
        ],
        tables=[Table(("parameter", "at least", "at most", "width", "unit"), known, ("", "", "", "", "word"))],
        notes=["Turns are the rotation vector, in degrees, from the rotation of the best frames below."],
        parts=[frames],
    )


def _classical(found: HandEyeResult) -> Section:
    """The largest error of the least-squares answer in each image, and the tolerance."""
    images, tolerance = found.classical.images, at_least(found.eps, 4)
    largest = [math.inf if v.largest is None else v.largest for v in images]
    texts = [at_most(value, 4) for value in largest]
    svg = residuals_svg(
        np.minimum(largest, 1e6),
        np.zeros(len(images)),
        np.full(len(images), np.nan),
        (0.0, found.eps),
        np.array([not v.ok for v in images]),
        [f"{v.image}: {text} px" for v, text in zip(images, texts, strict=True)],
        "Largest error of least squares in each image",
        ("image, in the order of poses.csv", "largest error [px]"),
    )
    readings = ", at the fit's readings of the poses" if found.readings else ""
    caption = f"Largest error in each image, in exact arithmetic{readings}; the band: {tolerance} px."
    rows = [
        (v.image + " (left out)" * (v.image in found.left_out), text, "within" if v.ok else "beyond")
        for _, v, text in sorted(zip(largest, images, texts, strict=True), key=lambda row: -row[0])
    ]
    table = Table(("image", "largest error [px]", f"{tolerance} px"), rows, most=_MOST, where="handeye.json")
    return Section(
        "The least-squares answer, image by image",
        figures=[Drawing([svg], caption=caption)],
        parts=[Section("Images, worst first", tables=[table], folded=True)],
    )


# ------------------------------------------------------------------------------------------------------------------
# What is proved of a hand-eye study, in sentences; numbers rounded to the safe side.


def known_sentence(found: HandEyeResult) -> list[str]:
    """How accurate the calibration is, in mm at a point before the camera; nothing where no ranges are proved."""
    if found.ranges is None or found.ranges.known is None:
        return []
    known = found.ranges.known
    ahead = not any(known.at[:2]) and known.at[2] > 0.0
    where = (
        f"A point {stated(known.at[2])} mm in front of the camera"
        if ahead
        else f"The point ({', '.join(map(stated, known.at))}) mm in the camera frame"
    )
    (apart, *others), (turned, *_) = _apart(found, known)
    proved = "proved, if what you gave is true" if found.asked.known else "proved"
    unturned = "any turn" if known.turn >= 180.0 else f"{at_most(known.turn, 2)} degrees"
    said = [
        f"{where} is known in the {'hand' if found.setup == 'eye-in-hand' else 'base'} frame to within "
        f"{at_most(known.place, 2)} mm and {unturned} ({proved}); least squares puts it "
        f"{about(apart, 2)} mm and {about(turned, 2)} degrees from the best frames."
    ]
    if found.others:
        away = [(mm, one.method) for mm, one in zip(others, found.others, strict=True)]
        (least, best), (most, worst) = min(away), max(away)
        beyond = [one.method for one in found.others if not found.ranges.hold(one)]
        said.append(
            f"OpenCV's methods put it {about(least, 2)} mm ({best}) to {about(most, 2)} mm ({worst}) from there; "
            f"outside of the proved ranges: {', '.join(beyond) or 'none'}."
        )
    return said


def _apart(found: HandEyeResult, known: KnownPoint) -> tuple[list[float], list[float]]:
    """How far the cameras of least squares, then of OpenCV's methods, put the known point from where that of the best
    frames does, mm, and their turns, degrees."""
    cameras = [(of.camera_position, of.camera_quaternion) for of in (found.point, found.asked.center)]
    cameras += [(one.position, one.quaternion) for one in found.others]
    place, turn = map(np.array, zip(*cameras, strict=True))
    pose = Pose(transformed(Pose(place, normalised(turn)), [known.at])[:, 0], normalised(turn))
    apart, turned = distances(pose.rows(slice(1, None)), pose.rows([0]))
    return apart.tolist(), np.degrees(turned).tolist()


def _others(found: HandEyeResult) -> Iterator[Section]:
    """OpenCV's answers at the known point."""
    ranges = found.ranges
    if ranges is None or ranges.known is None or not found.others:
        return
    each = zip(found.others, *(values[1:] for values in _apart(found, ranges.known)), strict=True)
    rows = [
        (one.method, about(apart, 2), about(turned, 2), "not excluded" if ranges.hold(one) else "outside")
        for one, apart, turned in each
    ]
    said = (
        "Each from the poses that single images give. The point is that of the first sentence; its distance and turn "
        f"are from the best frames. No frames with a camera outside of the proved ranges explain every pixel to within "
        f"{at_least(found.eps, 4)} px (proved)."
    )
    yield Section("OpenCV's methods", [said], tables=[Table(("method", "mm", "degrees", "proved ranges"), rows)])


def searched(found: HandEyeResult) -> str:
    turned = "any rotation" if found.asked.angle is None else f"rotations within {stated(found.asked.angle)} degrees"
    return (
        f"{titled(found.setup, found.provenance)}: {found.images} images, {found.points:,} points. "
        f"Searched: {turned}, positions within {stated(found.asked.reach)} mm of the least-squares answer"
        f"{given_values(found)}."
    )


def given_values(found: HandEyeResult) -> str:
    """What the user knows."""
    ends = []
    for name, low, high in found.asked.known:
        frame, what = name.split(".")
        unit = "degrees" if what == "tilt" else "mm"
        ends.append(f"{_FRAMES[found.setup][frame]}, {what} from {stated(low)} to {stated(high)} {unit}")
    return f". Given by you, not proved: {'; '.join(ends)}" if ends else ""


def sentences(found: HandEyeResult) -> list[str]:
    """The answer in a few lines."""
    low, high = bracket_text(found.eps_lo, found.eps_hi)
    said = []
    one, eps, values = found.outliers == 1, at_least(found.eps, 4), " within the given values" * bool(found.asked.known)
    if found.outliers:
        left, which = ", ".join(found.left_out), "one is" if one else f"{found.outliers} are"
        said.append(f"Some frames explain every pixel of all images but {left} to within {high} px (proved).")
        if found.eps_lo > 0.0:
            said.append(f"Whichever {which} left out, no frames{values} explain all others to {low} px (proved).")
        proved = [image for image, _ in found.blamed]
        fits = f"if at most {which} and right ones fit to {at_most(found.eps, 5)} px (proved)."
        said += [f"{image} is wrong, {fits}" for image in proved]
        undecided = [image for image in found.left_out if image not in proved]
        if undecided:
            said.append(f"Not proved to be wrong, though the others fit best without: {', '.join(undecided)}.")
    elif found.eps_lo > 0.0:
        said.append(
            f"No frames{values} explain every pixel to within {low} px (proved); some explain every one to {high} px."
        )
    else:
        said.append(
            f"Some frames{values} explain every pixel to within {high} px (proved); nothing is proved from below."
        )
    if found.readings:
        told = found.provenance.get("half_widths", "as the study states")
        said.append(f"Robot poses are uncertain ({told}): a pixel is explained at some reading of its image's pose.")
    if not found.complete and not found.outliers:
        more = "more time (--time-limit)" if found.timed else "a smaller --within, or a value that you know (--known),"
        said.append(f"The bracket is open: {more} may close it.")
    if found.tolerance is not None and not found.outliers:
        word = {True: "met", False: "refuted: no frames in the box meet it", None: "undecided"}[found.passes]
        said.append(f"Tolerance {stated(found.tolerance)} px: {word}.")
    kept = [verdict for verdict in found.classical.images if verdict.image not in found.left_out]
    failing = [verdict.image for verdict in kept if not verdict.ok]
    fit = "Least squares" + ", at its own readings of the poses" * bool(found.readings)
    said.append(
        f"{fit}: rms {nearest(found.rms, 3)} px, largest error {at_most(found.classical.largest, 4)} px; "
        f"over {eps} px in {len(failing)} of {len(kept)} images" + (f" ({listed(failing, 5)})." if failing else ".")
    )
    said += found.remarks
    if found.support:
        named = dict.fromkeys(image for image, _ in found.support)
        said.append(
            f"{len(found.support)} point{'s' * (len(found.support) > 1)} of {len(named)} image{'s' * (len(named) > 1)} "
            f"force{'s' * (len(found.support) == 1)} the lower end: {listed(named, 6)}."
        )
    return said
