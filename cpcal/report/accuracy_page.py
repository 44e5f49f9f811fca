"""The page of an accuracy certificate."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from cpcal.common.files import listed
from cpcal.common.numbers import about, at_least, at_most, nearest, stated
from cpcal.questions.accuracy import Accuracy, CellAccuracy, PoseAccuracy, WorkspaceAccuracy
from cpcal.report.section import Drawing, Mark, Page, Section, Table, Words, origin, verdict
from cpcal.report.svg import DASHES, EDGE, INK, SUPPORT, Axes, Figure, Svg, ticks

# ------------------------------------------------------------------------------------------------------------------
# Sentences: what is assumed, what is proved under it, what is only estimated.

BRANCH = "In a workspace the platform stays on the assembly branch that the controller means."


def degrees_up(angle: float) -> str:
    """An angle in degrees, never less than it is."""
    return at_most(math.nextafter(math.degrees(angle), math.inf), 3)


def assumption(found: Accuracy) -> str:
    """The first line of every page and print."""
    each = [error.eps for error in found.assumed]
    size = stated(each[0]) if len(set(each)) == 1 else f"{about(min(each))} to {about(max(each))}"
    whence = "stated by the user" if found.assumed[0].stated else "suggested by the growth of the least error"
    return (
        f"ASSUMED: some parameters of each leg, within {stated(found.delta)} mm of the center of the run, satisfy its "
        f"equation to within {size} mm, at the calibration poses and at every pose spoken of here ({whence}). At a "
        f"pose the platform is within {stated(found.within[0])} mm and {stated(found.within[1])} rad of it, along each "
        "axis. "
        f"{BRANCH if found.workspace is not None else ''}".rstrip()
    )


def sentences(found: Accuracy) -> list[str]:
    """What follows."""
    if found.refuted:
        legs = ", ".join(map(str, found.refuted))
        box = f"within {stated(found.delta)} mm of the center of the run"
        said = f"REFUTED: the campaign allows no parameters of leg {legs} {box} with so small an error."
        return [f"{said} Nothing is proved."]
    out = []
    if found.workspace is not None:
        out += _of_workspace(found.workspace)
    worst = found.worst_pose
    if worst is not None:
        count = len(found.proved_poses)
        out.append(
            f"PROVED under the assumption: at {count} of {len(found.poses)} poses the platform is within "
            f"{at_most(worst.position_bound)} mm and {degrees_up(max(p.rotation_bound for p in found.proved_poses))} "
            f"degrees of where the controller says; the worst is {worst.name}."
        )
    lost = [pose.name for pose in found.poses if not pose.proved]
    if lost:
        out.append(
            f"Nothing is proved at {len(lost)} poses (near a singularity, or the set is too wide): {listed(lost)}."
        )
    beyond = [pose.name for pose in found.poses if pose.beyond]
    if beyond:
        out.append(f"{len(beyond)} poses need leg readings beyond those that were measured: {listed(beyond)}.")
    out += _of_truth(found)
    return out


def _of_workspace(found: WorkspaceAccuracy) -> list[str]:
    out = []
    if len(found.left_out) < len(found.cells):
        end = "" if found.complete else " The search stopped at its limit of cells: more would narrow this bound."
        out.append(
            f"PROVED under the assumption: anywhere in the workspace{' but the cells left out' * bool(found.left_out)} "
            f"the platform is within {at_most(found.position_bound)} mm and {degrees_up(found.rotation_bound)} degrees "
            f"of where the controller says. At the worst pose met the bound is {at_least(found.worst_pose_bound)} mm."
            f"{end}"
        )
    if found.left_out:
        out.append(
            f"LEFT OUT: {len(found.left_out)} of {len(found.cells)} cells, of which nothing is proved; the platform is "
            "singular or nearly so there, or the cells are still too large. They are listed below."
        )
    return out


def _of_truth(found: Accuracy) -> list[str]:
    if not found.truth_known:
        return []
    if found.violated:
        names = listed([pose.name for pose in found.violated])
        return [
            f"THE ASSUMPTION FAILS: the simulator's truth violates the bound at {len(found.violated)} poses: {names}."
        ]
    true = max(p.estimated.true_position or 0.0 for p in found.poses)
    return [f"The simulator's truth is inside at every pose; its largest error is {about(true)} mm."]


# ------------------------------------------------------------------------------------------------------------------
# The map of an accuracy certificate: slices of the workspace, each cell shaded by its proved bound.

_SIDE, _LEFT, _TOP, _GAP, _BOTTOM = 150.0, 44.0, 18.0, 22.0, 36.0  # points
_STEPS = 5  # shades


def _shades(found: WorkspaceAccuracy) -> list[tuple[float, str]]:
    """Their upper ends, mm, and how opaque they are."""
    bounds = [cell.position_bound for cell in found.cells if cell.proved]
    if not bounds:
        return []
    low, step = min(bounds), (max(bounds) - min(bounds)) / _STEPS
    return [(low + step * (k + 1), nearest(0.1 + 0.75 * k / (_STEPS - 1), 2)) for k in range(_STEPS)]


def map_svg(found: WorkspaceAccuracy) -> Svg:
    """Slices side by side, seen from above."""
    (*_, lo), (*_, hi) = found.lo[:3], found.hi[:3]
    heights = [lo] if lo == hi else [lo + share * (hi - lo) for share in (1 / 6, 0.5, 5 / 6)]
    figure = Figure(_LEFT + len(heights) * (_SIDE + _GAP), _TOP + _SIDE + _BOTTOM)
    sides = zip(found.lo[:2], found.hi[:2], strict=True)
    span = [(low - 0.5 * (low == high), high + 0.5 * (low == high)) for low, high in sides]
    shades, thickness = _shades(found), (hi - lo) / len(heights) or np.inf
    for n, height in enumerate(heights):
        left = _LEFT + n * (_SIDE + _GAP)
        axes = Axes(figure, (left, _TOP, left + _SIDE, _TOP + _SIDE), span[0], span[1])
        figure.text(left + 0.5 * _SIDE, 7.0, f"z = {nearest(height, 0)} mm", anchor="middle")
        met = [cell for cell in found.cells if cell.lo[2] <= height <= cell.hi[2]]
        # of several rotations the worst last
        for cell in sorted(met, key=lambda cell: (not cell.proved, cell.position_bound if cell.proved else 0.0)):
            (x0, y0), (x1, y1) = cell.lo[:2], cell.hi[:2]
            square = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
            if not cell.proved:
                axes.area("none", square, edge=SUPPORT, width=1.0, dash=DASHES)
                continue
            opacity = next((shade for end, shade in shades if cell.position_bound <= end), shades[-1][1])
            axes.area("var(--paper)", square)
            axes.area(f"{EDGE}; fill-opacity: {opacity}", square)
        if n == 0:
            axes.y_axis(ticks(*span[1], 5), "y [mm]")
        axes.x_axis(ticks(*span[0], 5), "x [mm]")
        if abs(found.worst_pose[2] - height) <= 0.5 * thickness:
            axes.marks([found.worst_pose[:2]], "x", INK, 7.0, width=1.4)
    return figure.svg("Slices of the workspace, each cell shaded by the proved bound of the position")


def _dominating(found: WorkspaceAccuracy) -> list[tuple[str, str]]:
    """Pairs of legs whose uncertainty moves the platform most, and the share of the proved volume where they do."""
    volume: dict[str, float] = {}
    for cell in found.cells:
        if cell.proved:
            sides = [hi - lo for lo, hi in zip(cell.lo, cell.hi, strict=True) if hi > lo]
            pair = _two_legs(cell.shares)
            volume[pair] = volume.get(pair, 0.0) + float(np.prod(sides))
    total, largest = sum(volume.values()), sorted(volume.items(), key=lambda pair: -pair[1])
    return [(pair, f"{nearest(100.0 * size / total, 0)} %") for pair, size in largest]


def _two_legs(shares: Sequence[float]) -> str:
    return " and ".join(str(k + 1) for k in sorted(np.argsort(-np.array(shares))[:2].tolist()))


# ------------------------------------------------------------------------------------------------------------------
# The page.

ACCURACY_PAGE = "accuracy.html"
_MOST = 20  # rows of a table
_KINDS = {"PROVED": "explained", "REFUTED": "unexplained", "THE ASSUMPTION": "unexplained", "LEFT OUT": "undecided"}


def write_accuracy(found: Accuracy, folder: str | os.PathLike[str]) -> Path:
    """Write `accuracy.html` into the folder; its path. The same certificate gives the same bytes."""
    robot = found.campaign.robot
    page = Page(
        f"Accuracy: {robot}",
        "accuracy certificate",
        robot,
        [answer(found), *_where(found.workspace), *_at_poses(found), _assumption(found), *_next(found), _origin(found)],
        [assumption(found)],
        "How far from where its controller says can the platform be?",
    )
    return page.write(Path(folder) / ACCURACY_PAGE)


def answer(found: Accuracy) -> Section:
    note = (
        f"Controller: {found.controller} parameters. Its own readings are taken to be reached; what the servo leaves "
        "counts as model error. Poses are of the mobile frame in the campaign's base frame."
    )
    said: list[Words] = []
    for sentence in sentences(found):
        word, _, rest = sentence.partition(":")
        kind = next((kind for begin, kind in _KINDS.items() if sentence.startswith(begin)), None)
        said.append(sentence if kind is None else (verdict(word, kind), f":{rest}"))
    return Section("Answer", said, notes=[note])


def _where(over: WorkspaceAccuracy | None) -> Iterator[Section]:
    if over is None or not over.cells:
        return
    swatch = Markup('<i class="key" style="background: {}; opacity: {}"></i>')
    legend: dict[str, Words] = {
        swatch.format(EDGE, opacity): f"up to {at_most(end)} mm" for end, opacity in _shades(over)
    }
    caption = (
        "Proved bounds of the position for all poses of each cell, seen from above at three heights. Cells of several "
        "rotations lie over one another; the worst is seen. Cells that are not near the worst are not divided further, "
        f"so their bounds are looser than they could be. Worst pose met: {_pose_text(over.worst_pose)}."
    )
    legend |= {"dashed": "left out", "": "× worst pose met"}
    legs = _dominating(over)[:6]
    dominates = Section(
        "Legs that dominate",
        tables=[Table(("the two legs that move the platform most", "share of the workspace"), legs)],
        notes=[
            "To first order, at the cells' centers: what is not known of a leg's length, and how far that moves the "
            "platform."
        ],
    )
    cells = Table(("cell",), [(_cell_text(cell),) for cell in over.left_out], ("word",), "", _MOST, "accuracy.json")
    left = Section("Cells left out", ["Nothing is proved of the poses in these cells."], tables=[cells])
    parts = [dominates] * bool(legs) + [left] * bool(over.left_out)
    yield Section("Where in the workspace", figures=[Drawing([map_svg(over)], legend, caption)], parts=parts)


def _at_poses(found: Accuracy) -> Iterator[Section]:
    poses = sorted(found.proved_poses, key=lambda pose: -pose.position_bound)
    if not poses:
        return
    truth = found.truth_known
    axes = [max(max(abs(p.lo[k]), abs(p.hi[k])) for p in poses) for k in range(6)]
    widest = [f"{at_most(v)} mm" for v in axes[:3]] + [f"{degrees_up(v)}°" for v in axes[3:]]
    by_axis = ", ".join(f"{n} {v}" for n, v in zip(("x", "y", "z", "rx", "ry", "rz"), widest, strict=True))
    head = ("pose", "bound [mm]", "[°]", "x", "y", "z [mm]", "U [mm]", "legs", *(["truth [mm]"] * truth))
    worst = Table(head, [_pose_row(pose, truth) for pose in poses], most=_MOST, where="accuracy.json")
    yield Section(
        "At the poses asked for",
        tables=[Table(("", "mean [mm]", "largest [mm]", "mean [°]", "largest [°]"), list(_summary(poses, truth)))],
        notes=[
            f"Largest by axis: {by_axis}.",
            "Only the first row is proved (under the assumption). U and the truth are estimates: U takes what the "
            "residuals scatter for noise, and speaks of 95 % of cases, not of all.",
        ],
        parts=[Section("Worst first", tables=[worst])],
    )


def _summary(poses: Sequence[PoseAccuracy], truth: bool) -> Iterator[tuple[str, ...]]:
    """Mean and largest over the poses, as position accuracy is stated; a row a quantity."""
    estimates = [pose.estimated for pose in poses]
    bounds = [(pose.position_bound, pose.rotation_bound) for pose in poses]
    quantities = [
        ("proved bound", at_most, bounds),
        ("U of least squares, k = 2", about, [(e.u_position, e.u_rotation) for e in estimates]),
        ("simulator's truth", about, [(e.true_position or 0.0, e.true_rotation or 0.0) for e in estimates]),
    ]
    for name, text, values in quantities[: 3 if truth else 2]:
        position, rotation = np.array(values).T
        sizes = (size(of) for of in (position, np.degrees(rotation)) for size in (np.mean, np.max))
        yield name, *(text(float(v)) for v in sizes)


def _assumption(found: Accuracy) -> Section:
    head = ("leg", *(f"{n} poses [mm]" for n in found.assumed[0].poses), "refuted below [mm]", "assumed [mm]")
    rows = [
        (str(e.leg), *map(about, e.growth), at_least(e.refuted_below), stated(e.eps) if e.stated else about(e.eps))
        for e in found.assumed
    ]
    return Section(
        "The assumption",
        [
            "A certificate speaks of poses that nobody measured, so it must assume how well the model holds there. The "
            "least error of the poses that were measured grows with their number:"
        ],
        tables=[Table(head, rows)],
        notes=[
            "Least errors are estimates: of readings as they are (noise included), the mean over draws of so many "
            "poses. “Refuted below” is proved by the run's certificates. No finite number of poses proves the "
            "assumption."
        ],
    )


def _next(found: Accuracy) -> Iterator[Section]:
    rows = [(_pose_text((*n.position, *n.rotation)), n.by, about(n.expected)) for n in found.next_poses]
    if rows:
        said = ["Measuring these would narrow the bound most; estimates, to first order."]
        yield Section("Next poses", said, tables=[Table(("pose", "chosen by", "worst bound then [mm]"), rows)])


def _origin(found: Accuracy) -> Section:
    proofs = (
        "Certificates hold what the legs allow; cpcal verify checks them and computes the bounds of poses again. The "
        "bounds of a workspace come from linear programs and interval Newton in outward-rounded arithmetic, which no "
        f"certificate holds. {about(found.seconds)} s."
    )
    campaign = (Mark(found.campaign.sha256, "code"), f", {found.campaign.measurements} measurements")
    return origin({"Campaign, SHA-256": campaign, "Proofs": proofs})


def _pose_row(pose: PoseAccuracy, truth: bool) -> tuple[str, ...]:
    e = pose.estimated
    box = [at_most(max(abs(a), abs(b)), 2) for a, b in zip(pose.lo[:3], pose.hi[:3], strict=True)]
    row = (
        pose.name,
        at_most(pose.position_bound),
        degrees_up(pose.rotation_bound),
        *box,
        about(e.u_position),
        _two_legs(pose.shares),
    )
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
