"""The page of an accuracy certificate."""

import math
from collections.abc import Iterator
from pathlib import Path

from markupsafe import Markup

from cpcal.common.files import StrPath, listed
from cpcal.common.numbers import about, at_least, at_most, nearest, stated
from cpcal.models.platform import AXES
from cpcal.questions.accuracy import FAR, Accuracy, WorkspaceAccuracy
from cpcal.report.figures import DASHES, EDGE, INK, SUPPORT, Plot, Svg, rectangle
from cpcal.report.section import Drawing, Mark, Page, Section, Table, Words, origin, verdict

# ------------------------------------------------------------------------------------------------------------------
# Sentences: what is assumed, what is proved under it, what is only estimated.

BRANCH = "In a workspace the platform stays on the assembly branch that the controller means."


def degrees_up(angle: float) -> str:
    """An angle in degrees, never less than it is."""
    return at_most(math.nextafter(math.degrees(angle), math.inf), 3)


def headline(found: Accuracy) -> str:
    """The first line: mm at the tool."""
    if found.refuted:
        return "Nothing is known of the tool's position: the campaign refutes what is assumed."
    said, over, proved = [], found.workspace, found.proved_poses
    if proved:
        u = about(max(pose.u_position for pose in found.poses))
        said.append(f"{at_most(proved[0].position_bound)} mm proved and {u} expected at {len(proved)} poses")
    if over is not None and len(over.left_out) < len(over.cells):
        but = " but the cells left out" * bool(over.left_out)
        mm = f"{at_most(over.position_bound)} mm proved and {about(over.u_position)} expected"
        said.append(f"{mm} anywhere in the workspace{but}")
    eps = about(max(leg.eps for leg in found.legs))
    return (
        f"{'Simulated: the' if found.simulated else 'The'} tool (origin of the mobile frame) is off by at most: "
        f"{'; '.join(said) or 'nothing is proved'}. Proved: if the model error is at most {eps} mm. Expected: at 95 % "
        "of poses."
    )


def assumption(found: Accuracy) -> str:
    """What all else rests on."""
    each = [error.eps for error in found.legs]
    size = stated(each[0]) if len(set(each)) == 1 else f"{about(min(each))} to {about(max(each))}"
    whence = "stated by the user" if found.legs[0].stated else "suggested by the residuals of least squares"
    out = sorted({name for leg in found.legs for name in leg.left_out})
    where = f"at the calibration poses{f' but {listed(out)}' * bool(out)} and at every pose spoken of here ({whence})"
    axes = ", ".join(AXES[k] for k in found.held)
    return (
        f"ASSUMED: some parameters of each leg, within {stated(found.delta)} mm of the center of the run, satisfy its "
        f"equation to within {size} mm, {where}. At a pose the platform is within {stated(found.within[0])} mm and "
        f"{stated(found.within[1])} rad of it, along each axis.{f' The mechanism holds {axes}.' * bool(axes)} "
        f"{BRANCH if found.workspace is not None else ''}".rstrip()
    )


def sentences(found: Accuracy) -> list[str]:
    """What follows: what is far from measured, proved, estimated."""
    if found.refuted:
        legs = ", ".join(map(str, found.refuted))
        box = f"within {stated(found.delta)} mm of the center of the run"
        said = f"REFUTED: the campaign allows no parameters of leg {legs} {box} with so small an error."
        return [f"{said} Nothing is proved."]
    out, over, proved = [], found.workspace, found.proved_poses
    far = [error for error in found.legs if error.far > FAR]
    if far:
        poses = sorted((pose for pose in found.poses if pose.far > FAR), key=lambda pose: -pose.far)
        at = f", at {len(poses)} of {len(found.poses)} poses, farthest first: {listed([p.name for p in poses])}"
        rise = "" if far[0].stated else " What is assumed of them was raised: a precaution, no estimate."
        out.append(
            f"FAR FROM MEASURED: leg {', '.join(str(error.leg) for error in far)} must reach lengths that are "
            f"{nearest(100.0 * max(e.far for e in far), 0)} % of the measured stroke away from every measured one"
            f"{at * bool(poses)}. No measurement shows the model error there.{rise} Measure poses in between."
        )
    if proved:
        turn = degrees_up(max(pose.rotation_bound for pose in proved))
        out.append(
            f"PROVED under the assumption: at {len(proved)} of {len(found.poses)} poses the platform is "
            f"within {at_most(proved[0].position_bound)} mm and {turn} degrees of where the controller says; the worst "
            f"is {proved[0].name}. cpcal verify checks it again."
        )
    if over is not None and len(over.left_out) < len(over.cells):
        turn = degrees_up(max(cell.rotation_bound for cell in over.cells if cell.proved))
        end = "" if over.complete else " The search stopped at its limit of cells: more would narrow this bound."
        out.append(
            "PROVED, not checked again: under the assumption, by rounded arithmetic which no certificate holds, "
            "anywhere in the workspace"
            f"{' but the cells left out' * bool(over.left_out)} the platform is within {at_most(over.position_bound)} "
            f"mm and {turn} degrees of where the controller says. At the worst pose met the "
            f"bound is {at_least(over.worst_pose_bound)} mm.{end}"
        )
    if over is not None and over.left_out:
        out.append(
            f"LEFT OUT: {len(over.left_out)} of {len(over.cells)} cells, of which nothing is proved; the platform is "
            "singular or nearly so there, or the cells are still too large. accuracy.json lists them."
        )
    lost = [pose.name for pose in found.poses if not pose.proved]
    if lost:
        why = "near a singularity, or the set is too wide"
        out.append(f"LEFT OUT: nothing is proved at {len(lost)} poses ({why}): {listed(lost)}.")
    ratios = [(pose.position_bound, pose.attained, "at the worst pose") for pose in proved[:1]]
    ratios += [] if over is None else [(over.position_bound, over.attained, "in the workspace")]
    times = " and ".join(f"{about(a / b)} {at}" for a, b, at in ratios if b > 0.0 and math.isfinite(a))
    if times:
        us = [p.u_position for p in found.poses] + ([] if over is None else [over.u_position])
        out.append(
            f"ESTIMATED: 95 % of poses are off by no more than {about(max(us))} mm, if the model is off there as it is "
            f"at the measured ones. Bounds are {times} times what parameters that the measurements allow attain, to "
            "first order."
        )
    return out


# ------------------------------------------------------------------------------------------------------------------
# The map of an accuracy certificate: slices of the workspace, each cell shaded by its proved bound.

_LIGHT, _DARK = 0.1, 0.85  # how opaque the least and the largest bound are


def _ends(found: WorkspaceAccuracy) -> tuple[float, float]:
    """The least and the largest proved bound of a cell, mm."""
    bounds = [cell.position_bound for cell in found.cells if cell.proved]
    return min(bounds, default=0.0), max(bounds, default=0.0)


def map_svgs(found: WorkspaceAccuracy) -> list[Svg]:
    """Slices, seen from above."""
    sides = zip(found.lo[:3], found.hi[:3], strict=True)
    x, y, (lo, hi) = ((a - 0.5 * (a == b), b + 0.5 * (a == b)) for a, b in sides)
    heights = [found.lo[2]] if found.lo[2] == found.hi[2] else [lo + share * (hi - lo) for share in (1 / 6, 0.5, 5 / 6)]
    (least, most), out = _ends(found), []
    for height in heights:
        plot = Plot((190.0, 185.0), x, y, (f"x [mm], at z = {nearest(height, 0)} mm", "y [mm]"))
        met = [cell for cell in found.cells if cell.lo[2] <= height <= cell.hi[2]]
        # of several rotations the worst last
        for cell in sorted(met, key=lambda cell: (not cell.proved, cell.position_bound if cell.proved else 0.0)):
            square = rectangle(*cell.lo[:2], *cell.hi[:2])
            if cell.proved:
                share = (cell.position_bound - least) / (most - least or 1.0)
                plot.area("var(--paper)", square)
                plot.area(f"{EDGE}; fill-opacity: {nearest(_LIGHT + (_DARK - _LIGHT) * share, 2)}", square)
            else:
                plot.area("none", square, edge=SUPPORT, width=1.0, dash=DASHES)
        if abs(found.worst_pose[2] - height) <= 0.5 * (hi - lo) / len(heights):
            plot.marks([found.worst_pose[:2]], "x", INK, 7.0)
        out.append(plot.svg("A slice of the workspace, each cell shaded by the proved bound of the position"))
    return out


# ------------------------------------------------------------------------------------------------------------------
# The page.

ACCURACY_PAGE = "accuracy.html"
_MOST = 20  # rows of a table
_KINDS = {
    "ASSUMED": "undecided",
    "PROVED": "explained",
    "ESTIMATED": "bounded",
    "REFUTED": "unexplained",
    "FAR": "undetermined",
    "LEFT OUT": "undetermined",
}


def write_accuracy(found: Accuracy, folder: StrPath, name: str = ACCURACY_PAGE) -> Path:
    """Write the page into the folder; its path. The same certificate gives the same bytes."""
    robot = f"{'Simulated: ' * found.simulated}{found.campaign.robot}"
    page = Page(
        f"{robot}, accuracy",
        "accuracy certificate",
        robot,
        [answer(found), *_where(found.workspace), *_at_poses(found), _assumption(found), *_next(found), _origin(found)],
        lead=headline(found),
    )
    return page.write(Path(folder) / name)


def answer(found: Accuracy) -> Section:
    note = (
        "Controller: recommended parameters. Its own readings are taken to be reached; what the servo leaves counts as "
        "model error. Poses are of the mobile frame in the campaign's base frame."
    )
    said = []
    for sentence in (assumption(found), *sentences(found)):
        word, _, rest = sentence.partition(":")
        kind = next(kind for begin, kind in _KINDS.items() if sentence.startswith(begin))
        said.append((verdict(word, kind), f":{rest}"))
    return Section("Answer", said, notes=[note])


def _where(over: WorkspaceAccuracy | None) -> Iterator[Section]:
    if over is None or not over.cells:
        return
    swatch = Markup('<i class="key" style="background: {}; opacity: {}"></i>')
    ends = zip(_ends(over), (_LIGHT, _DARK), strict=True)
    legend: dict[str, Words] = {swatch.format(EDGE, shade): f"{at_most(bound)} mm" for bound, shade in ends}
    caption = (
        "Proved bounds of the position for all poses of each cell, seen from above at three heights. Cells of several "
        "rotations lie over one another; the worst is seen. Cells that are not near the worst are not divided further, "
        f"so their bounds are looser than they could be. Worst pose met: {_pose_text(over.worst_pose)}."
        f"{f' The workspace was proposed: {over.proposal}.' * bool(over.proposal)}"
    )
    legend |= {"dashed": "left out", "": "× worst pose met"}
    yield Section("Where in the workspace", figures=[Drawing(map_svgs(over), legend, caption)])


def _at_poses(found: Accuracy) -> Iterator[Section]:
    poses = found.proved_poses
    if not poses:
        return
    head = ["pose", "bound [mm]", "[°]", "x", "y", "z [mm]", "far [%]", "attained", "U [mm]"]
    rows = []
    for pose in poses:
        box = [at_most(max(abs(a), abs(b)), 2) for a, b in zip(pose.lo[:3], pose.hi[:3], strict=True)]
        estimates = pose.attained, pose.u_position
        bounds = at_most(pose.position_bound), degrees_up(pose.rotation_bound)
        rows.append((pose.name, *bounds, *box, str(round(100 * pose.far)), *map(about, estimates)))
    yield Section(
        "At the poses asked for, worst first",
        tables=[Table(head, rows, most=_MOST, where="accuracy.json")],
        notes=[
            "The bounds, and the box x, y, z, are proved (under the assumption). What some parameters that the "
            "measurements allow attain is estimated to first order. U is estimated: the parameters' uncertainty, and a "
            "model error like that of the residuals; it speaks of 95 % of poses, not of all. Far: the largest distance "
            "of a leg's length from every measured one, of the measured stroke."
        ],
    )


def _assumption(found: Accuracy) -> Section:
    head = ("leg", "largest residual [mm]", "refuted below [mm]", "far", "assumed [mm]")
    rows = [
        (
            str(e.leg),
            about(e.residual),
            at_least(e.refuted_below),
            f"{about(100 * e.far, 2)} %",
            stated(e.eps) if e.stated else about(e.eps),
        )
        for e in found.legs
    ]
    return Section(
        "The assumption",
        [
            "A certificate speaks of poses that nobody measured, so it must assume how well the model holds there: as "
            "the residuals of least squares suggest, which are estimates, of readings as they are (noise included)."
        ],
        tables=[Table(head, rows)],
        notes=[
            "“Refuted below” is proved by the run's certificates. “Far”: the largest "
            "distance of a length spoken of here from every measured one, as a share of the measured stroke; beyond "
            f"{about(100 * FAR)} % the suggestion is raised. No finite number of poses proves the "
            "assumption."
        ],
    )


def _next(found: Accuracy) -> Iterator[Section]:
    rows = [(_pose_text((*n.position, *n.rotation)), about(n.expected)) for n in found.next_poses]
    if rows:
        said = ["Measuring these would narrow the bound most; estimates, to first order."]
        yield Section("Next poses", said, tables=[Table(("pose", "worst bound then [mm]"), rows)])


def _origin(found: Accuracy) -> Section:
    proofs = (
        "Certificates hold what the legs allow; cpcal verify checks them and computes the bounds of poses again. The "
        "bounds of a workspace come from linear programs and the legs' equations in outward-rounded arithmetic: no "
        f"certificate holds them. {about(found.seconds)} s."
    )
    campaign = (Mark(found.campaign.sha256, "code"), f", {found.campaign.measurements} measurements")
    return origin({"Campaign, SHA-256": campaign, "Proofs": proofs})


def _pose_text(pose: tuple[float, ...]) -> str:
    size = math.hypot(*pose[3:])  # twice the tangent of half the angle
    turns = [math.degrees(2.0 * math.atan(0.5 * size) * v / size) if size else 0.0 for v in pose[3:]]
    text = f"({', '.join(nearest(v, 1) for v in pose[:3])}) mm"
    return text if not any(turns) else f"{text}, turned by ({', '.join(nearest(v, 2) for v in turns)})°"
