"""How far from where the controller says the platform can be: the certificate of accuracy of a certified run."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction as F
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from cpcal.calibration import fit, mean_rotations
from cpcal.checker.files import ACCURACY_NAME
from cpcal.checker.platform import COORDINATES, MOST_LEGS, Commanded, Leg, pose_bounds, stated
from cpcal.common.codec import Document, Informed, checked
from cpcal.common.errors import Problem, Problems, unusable
from cpcal.common.files import StrPath
from cpcal.common.numbers import about, bracket_text
from cpcal.common.values import (
    Floats,
    Indices,
    Names,
    Numbers,
    Pair,
    Places,
    Quaternion,
    Vector,
    all_finite,
    floats,
    norms,
)
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.models import PLAIN, beyond_legs
from cpcal.models.frames import Tell, exact
from cpcal.models.leg_set import AskedSet, CertifiedSet, certified_set, enclosed_leg
from cpcal.models.platform import Cells, Workspace, cell_bounds, centered, cover, first_grid, pose_inverse, rotated
from cpcal.questions.next_measurement import NextPose, Polytope, attained, leg_changes, poses_to_measure
from cpcal.questions.result import CampaignNote, Result
from cpcal.questions.verdict import verdict_of
from cpcal.robot import Campaign, Pose, Robot, inverse_kinematics, pose_jacobian, turn_between
from cpcal.solver.certificate.exact_network import free

# ------------------------------------------------------------------------------------------------------------------
# The answer as plain values: what is assumed, what is proved, what is estimated, apart.
#
# What an `AssumedLeg` says is assumed, `PoseAccuracy` and `CellAccuracy` are proved under it, estimates are neither.
# Lengths in mm, angles in rad.


_ENCLOSED = checked("the enclosure of the certificate")
_AGAIN = checked("computed again from the claims of the certificates", "proved")


@dataclass(frozen=True)
class AssumedLeg:
    """ASSUMED: some parameters of the leg satisfy its equation to within `eps` at the calibration poses but those
    `left_out`, each for some reading in its set, and at every pose that is spoken of.

    PROVED, by the `certificate`: all such parameters (a, b, l) lie from `lo` to `hi`, mm; both are empty where there
    are none, and the campaign refutes what is assumed. `directions`: seven, along which it encloses them, too.

    `stated`: the user gave eps; else it was suggested by the largest `residual` of least squares, mm, and raised if
    lengths that are spoken of lie `far` from every measured one (a share of the measured stroke).
    `refuted_below`: proved in the run, the campaign allows no smaller eps.
    """

    leg: Annotated[int, checked("the certificate: each leg once")]
    eps: Annotated[float, checked("the cap of the certificate")]
    lo: Annotated[Numbers, _ENCLOSED]
    hi: Annotated[Numbers, _ENCLOSED]
    directions: Annotated[tuple[Numbers, ...], checked("forms of the certificate")]
    left_out: Annotated[Names, checked("the measurements of the certificate")]
    certificate: Annotated[str, checked("a file of the folder, which is accepted")]
    stated: Informed[bool]
    refuted_below: Informed[float]
    residual: Informed[float]
    far: Informed[float]


@dataclass(frozen=True)
class PoseAccuracy:
    """One pose (P, R) that the controller commands.

    PROVED under the assumption, where `proved`: every pose `within` the box that was asked for which the legs allow is
    P + p, R(1, s) R with (p, 2 s) in `lo`, `hi` (6 each), ||p|| <= `position_bound` and the angle at most
    `rotation_bound`; infinite where nothing is proved. `far`: the largest distance of a leg's length here from every
    measured one, as a share of the measured stroke.

    Estimates, mm: 95 % of poses are off by no more than `u_position`, by the residuals of least squares; to first order
    some parameters that the measurements allow, and errors up to eps, move the platform by `attained`.

    `center` (6) of (p, s), and `inverse` (6, n): about what, and in which coordinates, bounds are computed; any serve.
    """

    name: Informed[str]
    position: Annotated[Vector, checked("the form of this pose in each certificate")]
    quaternion: Annotated[Quaternion, checked("the form in each certificate")]
    proved: Annotated[bool, checked("`lo` to `rotation_bound` are proved")]
    lo: Annotated[Numbers, _AGAIN]
    hi: Annotated[Numbers, _AGAIN]
    position_bound: Annotated[float, _AGAIN]
    rotation_bound: Annotated[float, _AGAIN]
    far: Informed[float]
    u_position: Informed[float]
    attained: Informed[float]
    center: Informed[Numbers]
    inverse: Informed[tuple[Numbers, ...]]


@dataclass(frozen=True)
class CellAccuracy:
    """All poses P, R(1, S) with (P, 2 S) between `lo` and `hi`. PROVED as in PoseAccuracy, where `proved`."""

    lo: Numbers
    hi: Numbers
    proved: bool
    position_bound: float
    rotation_bound: float


@dataclass(frozen=True)
class WorkspaceAccuracy:
    """Cells that cover a workspace. `worst_pose` (6,) is one whose own bound is `worst_pose_bound`, the largest met;
    `attained` is the estimate for it, `u_position` the largest met. `proposal`: how the workspace was chosen, if not by
    the user. `complete`: the bound of all cells is within the gap asked for of the worst pose's."""

    lo: Numbers
    hi: Numbers
    cells: tuple[CellAccuracy, ...]
    worst_pose: Numbers
    worst_pose_bound: float
    attained: float
    u_position: float
    proposal: str
    complete: bool

    @property
    def left_out(self) -> tuple[CellAccuracy, ...]:
        """Cells of which nothing is proved."""
        return tuple(cell for cell in self.cells if not cell.proved)

    @property
    def position_bound(self) -> float:
        """PROVED under the assumption for every pose in the cells that are not left out."""
        return max((cell.position_bound for cell in self.cells if cell.proved), default=math.inf)


@dataclass(frozen=True)
class Accuracy:
    """The answer: of which campaign, and a controller with these `parameters` (n, 7), under which assumptions.

    The parameters that are spoken of lie within `delta` mm of the center of the run, the poses `within` so many mm and
    rad (each component of a rotation vector) of those that are commanded. ASSUMED: of a robot with fewer than six legs
    the mechanism holds the coordinates `held` (numbers of x, y, z, rx, ry, rz), which no measured pose varies."""

    campaign: CampaignNote
    version: Informed[str]
    parameters: Annotated[tuple[Numbers, ...], checked("the forms of the certificates")]
    delta: Annotated[float, checked("the box of each certificate")]
    within: Annotated[Pair, checked("what is computed again begins with it")]
    held: Annotated[Places, checked("what is computed again holds them")]
    legs: tuple[AssumedLeg, ...]
    poses: tuple[PoseAccuracy, ...]
    workspace: Informed[WorkspaceAccuracy | None]
    next_poses: Informed[tuple[NextPose, ...]]
    simulated: Informed[bool]
    seconds: Informed[float]

    @property
    def refuted(self) -> Places:
        """Legs for which the campaign refutes what is assumed: nothing else is said then."""
        return tuple(leg.leg for leg in self.legs if not leg.lo)

    @property
    def proved_poses(self) -> list[PoseAccuracy]:
        """Those of which a bound is proved, worst first."""
        return sorted((pose for pose in self.poses if pose.proved), key=lambda pose: -pose.position_bound)


_DOCUMENT = Document(Accuracy, ACCURACY_NAME, "cpcal-accuracy/12", "run cpcal accuracy again")
save_accuracy, load_accuracy = _DOCUMENT.save, _DOCUMENT.load


# ------------------------------------------------------------------------------------------------------------------
# The question.

PREFIX = "set-"  # of the certificates' names
WITHIN = 20.0, 0.1  # mm, rad: of the poses that are commanded; about others nothing is said
MOST_POSES = 993  # which a certificate can hold, with the directions
_WORST = 4  # poses, for which next poses are chosen
_MEASURED = 64  # poses of the campaign, where none are asked about
_SHRINKS = 8  # by a quarter each, of a workspace that is proposed
_SAMPLE = 300  # poses of a workspace, for estimates


class NamedPoses(NamedTuple):
    """K poses with names."""

    names: Names
    poses: Pose


def certify_accuracy(
    campaign: Campaign,
    result: Result,
    *,
    poses: NamedPoses | None = None,
    workspace: Workspace | None = None,
    assume: float | Sequence[float] | None = None,
    gap: float = 0.2,
    cells: int = 600,
    next_poses: int = 4,
    certificates: StrPath | None = None,
    tell: Tell | None = None,
) -> Accuracy:
    """For each pose that the controller commands, and for all of a workspace: how far off the platform can be.

    Without `poses` and `workspace`: the measured poses, 64 at most, and a workspace proposed from their range.

    PROVED under what is ASSUMED: for each leg some parameters, within `delta` mm of the center as in the result,
    satisfy its equation to within `assume` mm at the calibration poses (each for SOME reading in its set; but those
    that a robust run left out) and at every pose spoken of; and the platform is within 20 mm and 0.1 rad (each
    component) of the pose commanded, or for a workspace stays on the controller's assembly branch. A robot of fewer
    than six legs holds the coordinates that no measured pose varies. `assume` is one number, or one for each leg; left
    out, it is suggested by the residuals of least squares, and raised where lengths are far from every measured one.

    The controller computes readings from poses by the run's recommended parameters. `gap` and `cells`: the search for
    the worst of the workspace ends when the bound of all cells is within the gap of what a pose attains, or at so many
    cells. `next_poses`: so many to measure next are chosen (estimates). `certificates`: a folder for
    `set-legN.cert.jsonl`, which prove for each leg that its parameters lie in a box, and how far they let it deviate at
    each pose; from these the checker computes the bounds of poses again. The bounds of a workspace are proved in
    interval arithmetic, without certificates.

    Raises InputError for a run that this cannot be asked of: of another campaign or model, without all legs, or with a
    leg that failed, unless `assume` says what to assume of it.
    """
    began, say = time.monotonic(), tell or (lambda _: None)
    held = held_coordinates(campaign)
    Problems(_problems(campaign, result, poses, assume, held)).raise_any()
    known = np.array([leg.recommended.point for leg in result.legs])
    robot, proposal = Robot.from_parameters("controller", known), ""
    if poses is None and workspace is None:
        poses = measured_poses(campaign)
        workspace, proposal = proposed_workspace(campaign, robot, held)
    named = poses or NamedPoses((), Pose(np.zeros((0, 3)), np.zeros((0, 4))))
    pairs = zip(named.poses.position, named.poses.quaternion, strict=True)
    commanded = [Commanded(*map(exact, pair)) for pair in pairs]
    places = [named.poses]
    if workspace is not None:
        places.append(rotated(np.random.default_rng(1).uniform(workspace.lo, workspace.hi, (_SAMPLE, 6))))
    away = [distance_from_measured(campaign, inverse_kinematics(robot, some)) for some in places]
    far = np.concatenate(away).max(axis=0, initial=0.0).tolist()
    rows = [_kept(campaign, leg.bracket.left_out) for leg in result.legs]
    parts = [campaign.rows(only) for only in rows]
    found = [suggested_error(part, k + 1, far[k]) for k, part in enumerate(parts)]
    errors = np.broadcast_to([eps for eps, _ in found] if assume is None else assume, (campaign.legs,)).tolist()
    if not all_finite(errors):
        what = "leaves no residuals that would suggest a model error"
        raise unusable("run", what, "say what model error to assume: --assume MM")
    asked, assumed, enclosed = [], [], []
    with tempfile.TemporaryDirectory() as draft:
        for k, (leg, only, eps) in enumerate(zip(result.legs, rows, errors, strict=True)):
            say(f"certificate of the set of leg {leg.leg}")
            out, name = leg.bracket.left_out, f"{PREFIX}leg{leg.leg}.cert.jsonl"
            center, delta, some = leg.bracket.center, result.options.delta, tuple(only.tolist()) if out else None
            asked.append(AskedSet(campaign, leg.leg, eps, center, delta, known[k], result.options.contractors, some))
            path = Path(draft if certificates is None else certificates) / name
            one = enclosed_leg(asked[-1], poses=commanded, certificate=path)
            enclosed += [] if one is None else [one]
            rows_of = ((), ()) if one is None else (one.lo, one.hi, *one.directions)
            lo, hi, *directions = (tuple(map(float, row)) for row in rows_of)
            below = leg.bracket.lo if result.options.eps is None else 0.0
            said = assume is not None, below, found[k][1], far[k]
            assumed.append(AssumedLeg(leg.leg, eps, lo, hi, tuple(directions), out, name, *said))
    at, over, following = [], None, tuple[NextPose, ...]()
    say("certified sets")
    sets = [] if len(enclosed) < campaign.legs else [one for one in map(certified_set, asked) if one is not None]
    if len(sets) == campaign.legs:
        polytopes = list(map(Polytope.about, parts, sets))
        fitted = campaign.rows(_kept(campaign, [name for leg in result.legs for name in leg.bracket.left_out]))
        say(f"{len(named.names)} poses")
        u = expanded_uncertainty(fitted, robot, named.poses, held)
        reached = attained(robot, polytopes, sets, named.poses, held)
        for k, name in enumerate(named.names):
            legs = zip(robot.parameters, enclosed, errors, strict=True)
            rest = [
                Leg(exact(row), one.lo, one.hi, one.directions, one.along, F(eps), one.forms[k])
                for row, one, eps in legs
            ]
            middle, inverse = centered(commanded[k], rest, held)
            coordinates = exact(middle), list(map(exact, inverse))
            bounds = pose_bounds(commanded[k], rest, F(WITHIN[0]), F(WITHIN[1]) / 2, *coordinates, free, held)
            lo, hi, *most = ((), (), np.inf, np.inf) if bounds is None else stated(bounds)
            at.append(
                PoseAccuracy(
                    name=name,
                    position=tuple(named.poses.position[k].tolist()),
                    quaternion=tuple(named.poses.quaternion[k].tolist()),
                    proved=bounds is not None,
                    lo=lo,
                    hi=hi,
                    position_bound=most[0],
                    rotation_bound=most[1],
                    far=float(away[0][k].max()),
                    u_position=float(u[k]),
                    attained=float(reached[k]),
                    center=tuple(middle.tolist()),
                    inverse=tuple(map(tuple, inverse.tolist())),
                )
            )
        worst = sorted((pose for pose in at if pose.proved), key=lambda pose: -pose.position_bound)[:_WORST]
        there = [(*pose.position, *pose.quaternion) for pose in worst]
        if workspace is not None:
            over = _over(workspace, sets, gap, cells, held, say, proposal)
            last = rotated(np.array([over.worst_pose]))
            largest = float(expanded_uncertainty(fitted, robot, places[-1], held).max())
            over = replace(over, u_position=largest, attained=float(attained(robot, polytopes, sets, last, held)[0]))
            if over.worst_pose_bound:
                there += [(*last.position[0], *last.quaternion[0])]
        if next_poses > 0 and there:
            values = np.array(there)
            worst_poses = Pose(values[:, :3], values[:, 3:])
            following = poses_to_measure(campaign, sets, polytopes, worst_poses, next_poses, held=held)
    return Accuracy(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        version=__version__,
        parameters=tuple(map(tuple, known.tolist())),
        delta=result.options.delta,
        within=WITHIN,
        held=held,
        legs=tuple(assumed),
        poses=tuple(at),
        workspace=over,
        next_poses=following,
        simulated=campaign.simulated,
        seconds=time.monotonic() - began,
    )


def _kept(campaign: Campaign, left_out: Collection[str]) -> Indices:
    """Numbers, from 0, of all measurements but some."""
    return np.flatnonzero(np.isin(campaign.measurement_ids, list(left_out), invert=True))


def _problems(
    campaign: Campaign,
    result: Result,
    poses: NamedPoses | None,
    assume: float | Sequence[float] | None,
    held: Places,
) -> Iterator[Problem]:
    n, legs = campaign.legs, [leg.leg for leg in result.legs]
    whole = legs == list(range(1, n + 1))
    if campaign_sha256(campaign) != result.campaign.sha256:
        yield Problem("run", "is of another campaign", "name the run's own")
    if result.model.name != PLAIN.name:
        what = f"has the leg model {result.model.name!r}"
        yield Problem("run", what, "certify with the plain model: others have no accuracy certificate yet")
    if not 6 - len(held) <= n <= MOST_LEGS:
        vary = ", ".join(name for k, name in enumerate(COORDINATES) if k not in held)
        remedy = f"ask for a robot of at most {MOST_LEGS} legs that determine its pose"
        yield Problem("robot", f"has {n} legs, and its measured poses vary in {vary}", remedy)
    elif not whole:
        yield Problem("run", f"holds these legs only: {', '.join(map(str, legs)) or 'none'}", f"certify all {n}")
    if poses is not None and len(poses.names) > MOST_POSES:
        what = f"are {len(poses.names)}, and certificates hold {MOST_POSES} at most"
        yield Problem("poses", what, "ask for some of them at a time")
    failed = [str(leg.leg) for leg in result.legs if verdict_of(result, leg).word == "fail"]
    if assume is None and failed:
        what = f"fails its tolerance: leg {', '.join(failed)}"
        yield Problem("run", what, "say what model error to assume: --assume MM")
    values = np.atleast_1d(floats(0.0 if assume is None else assume))
    if values.shape not in ((1,), (n,)) or not (np.isfinite(values) & (values >= 0.0)).all():
        yield Problem("assume", "is no number of mm, 0 or more, nor one for each leg", "give 0.2, say")
    elif whole:
        for leg, eps in zip(result.legs, np.broadcast_to(values, (n,)).tolist(), strict=True):
            yield from beyond_legs(campaign, leg.leg, leg.bracket.center[6] - result.options.delta, eps, "assume")


def _over(
    workspace: Workspace,
    sets: Sequence[CertifiedSet],
    gap: float,
    cells: int,
    held: Places,
    say: Tell,
    proposal: str,
) -> WorkspaceAccuracy:
    """One that is proposed is made smaller about its middle until the cells of the first grid can be bounded."""
    for _ in range(_SHRINKS if proposal else 0):
        if cell_bounds(Cells.of_boxes(first_grid(workspace.box)), sets, held)[0].proved.all():
            break
        lo, hi = np.array(workspace.lo), np.array(workspace.hi)
        middle, half = 0.5 * (lo + hi), 0.375 * (hi - lo)
        workspace = Workspace(tuple((middle - half).tolist()), tuple((middle + half).tolist()))

    def tell(lo: float, hi: float) -> None:
        least, most = bracket_text(lo, hi, 4)
        say(f"the worst of the workspace is between {least} and {most} mm")

    found = cover(workspace, sets, held=held, gap=gap, most=cells, tell=tell)
    stated = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    each = []
    for cell in found.cells:
        low, high = (tuple((stated * side).tolist()) for side in (cell.box.lo, cell.box.hi))
        each.append(CellAccuracy(low, high, *cell.state[:3]))
    at, bound = tuple((stated * found.at).tolist()), found.at_position
    return WorkspaceAccuracy(
        workspace.lo, workspace.hi, tuple(each), at, bound, np.inf, np.inf, proposal, found.complete
    )


# ------------------------------------------------------------------------------------------------------------------
# What is asked about, where the user says nothing.


def measured_poses(campaign: Campaign) -> NamedPoses:
    """The measured poses, one of each name and 64 at most, evenly chosen."""
    rows = np.sort(np.unique(campaign.pose, return_index=True)[1])
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MEASURED)).round()).astype(int)]
    return NamedPoses(tuple(campaign.pose[k] for k in rows), Pose(campaign.position[rows], campaign.quaternion[rows]))


def held_coordinates(campaign: Campaign) -> Places:
    """Numbers of x, y, z, rx, ry, rz that the mechanism of a robot with fewer than six legs holds: those that the
    measured poses vary by no more than their reading sets."""
    if campaign.legs >= 6:
        return ()
    mean = mean_rotations(campaign.quaternion, np.zeros(len(campaign), np.int64), 1)
    turned = turn_between(campaign.quaternion, mean)
    seen = np.hstack([campaign.position, turned])
    radius = np.hstack([campaign.position_radius, campaign.rotation_radius]).max(axis=0)
    return tuple(np.flatnonzero(np.ptp(seen, axis=0) <= 2.0 * radius + 1e-6).tolist())


def proposed_workspace(campaign: Campaign, robot: Robot, held: Sequence[int]) -> tuple[Workspace | None, str]:
    """A box of positions in one orientation, and a sentence on it.

    It has the center and the proportions of the measured positions' range and the measured poses' mean orientation, and
    is the largest in which no leg needs a reading beyond those measured. None where even its center does.
    """
    lo, hi = campaign.position.min(axis=0), campaign.position.max(axis=0)
    orientation = mean_rotations(campaign.quaternion, np.zeros(len(campaign), np.int64), 1)[0]
    middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo) * ~np.isin(np.arange(3), held)
    low, high = campaign.length.min(axis=0), campaign.length.max(axis=0)
    # R b - a + P is shortest where P is nearest to a - R b, longest at a corner
    foot = robot.base - Pose(middle, orientation).rotation.dot(robot.mobile.T).T
    corners = np.where(np.arange(8)[:, None] >> np.arange(3) & 1, 1.0, -1.0)

    def inside(share: float) -> bool:
        at = middle + share * half * corners
        near = np.clip(foot, middle - share * half, middle + share * half)
        longest = norms(at[:, None] - foot).max(axis=0) - robot.offset
        shortest = norms(near - foot) - robot.offset
        return bool(((low <= shortest) & (longest <= high)).all())

    shares = [share for share in np.linspace(0.01, 1.0, 100).tolist() if inside(share)]
    if not shares or abs(orientation[0]) < 0.1:
        return None, ""
    turn = 2.0 * orientation[1:] / orientation[0]
    box = (np.concatenate([middle + sign * shares[-1] * half, turn]).tolist() for sign in (-1.0, 1.0))
    said = (
        f"{about(100 * shares[-1], 2)} % of the measured positions' range about its middle, in the mean measured "
        "orientation, in which no leg needs a reading beyond those measured; smaller where its cells cannot be bounded"
    )
    return Workspace(*map(tuple, box)), said


# ------------------------------------------------------------------------------------------------------------------
# How large the model error of each leg is at all poses spoken of. Estimates.
#
# The certificate ASSUMES one number a leg: some parameters satisfy the leg's equation to within eps at the calibration
# poses and at every other. eps* of the calibration poses alone is too small for that: the parameters were chosen for
# these poses. The largest residual of least squares is larger, and is scaled by what the fit took of the residuals. The
# readings are taken as they are, so that the noise counts as model error: sets that are wide hide model errors of their
# own size. Where a leg's length is far from every measured one nothing that was measured tells of its error. The
# suggestion is raised in proportion to the distance, which is a precaution and no estimate: such legs are named.

FAR = 0.125  # of the measured stroke: a length is far from every measured one


def suggested_error(campaign: Campaign, leg: int, far: float = 0.0) -> Pair:
    """mm: what to assume of a leg, and the largest of the N residuals r of its fit of rank m.

    max |r| sqrt(N / (N - m)); 1 + far times that if a length is so far from every measured one, as a share of the
    measured stroke. Infinite where no residuals are left.
    """
    found = fit(campaign, legs=[leg])
    largest, count = float(np.abs(found.residuals).max()), len(campaign)
    if count <= found.rank:
        return math.inf, largest
    return largest * math.sqrt(count / (count - found.rank)) * (1.0 + far * (far > FAR)), largest


def distance_from_measured(campaign: Campaign, length: Floats) -> Floats:
    """(K, n): from readings (K, n) to the nearest that was measured, as a share of the leg's measured stroke."""
    known = np.sort(campaign.length, axis=0)
    above = np.stack([np.searchsorted(a, b) for a, b in zip(known.T, length.T, strict=True)], axis=1)
    near = [np.take_along_axis(known, np.clip(above - k, 0, len(known) - 1), axis=0) for k in (0, 1)]
    return np.asarray(np.abs(length - np.stack(near)).min(axis=0) / np.maximum(np.ptp(known, axis=0), 1e-9))


# ------------------------------------------------------------------------------------------------------------------
# Beside what is proved: the prediction uncertainty of least squares. Floating point.
#
# With C the covariance of the plain fit's residuals, leg by leg, G its pseudo-inverse and J+ that of the pose, a leg is
# off by what the parameters' errors do to its length, and by a model error like those of the residuals:
#
#     V = J+ (D G C G' D' + C) J+'          D: change of the lengths by the parameters
#
# ||p||^2 is taken for tr V times an F variable, whose degrees of freedom are (tr V)^2 / tr V^2 (Satterthwaite) and the
# residuals'; U^2 is its 95 % quantile. What least squares and the controller differ by is added.


def expanded_uncertainty(campaign: Campaign, controller: Robot, poses: Pose, held: Sequence[int] = ()) -> Floats:
    """U of position, mm, (K,): 95 % of unseen poses are expected to be off by no more.

    inf where the data do not determine what counts, or leave no residuals.
    """
    from scipy import special  # here: it takes a third of a second to load

    found = fit(campaign, covariance="residuals")
    fitted = Robot.from_parameters("fit", found.parameters)
    inverse = pose_inverse(pose_jacobian(controller, poses), held)[:, :3]
    offset = np.einsum("kin,kn->ki", inverse, inverse_kinematics(fitted, poses) - inverse_kinematics(controller, poses))
    if found.freedom <= 0.0:
        return np.full(len(offset), np.inf)
    scatter, seen = found.residuals.T @ found.residuals / found.freedom, found.svd[2][found.determined]
    moves = (inverse[..., None] * leg_changes(fitted, poses)[:, None]).reshape(-1, 3, found.parameters.size)
    variance = moves @ found.determined_covariance @ np.swapaxes(moves, 1, 2)
    variance += inverse @ scatter @ np.swapaxes(inverse, 1, 2)
    lost = norms(moves - moves @ seen.T @ seen) > 1e-6 * norms(moves)
    size = np.maximum(np.trace(variance, axis1=1, axis2=2), 1e-300)
    quantile = special.fdtri(size**2 / np.maximum(np.sum(variance**2, axis=(1, 2)), 1e-300), found.freedom, 0.95)
    return np.where(lost.any(axis=1), np.inf, norms(offset) + np.sqrt(size * quantile))
