"""How far from where the controller says the platform can be: the certificate of accuracy of a certified run."""

from __future__ import annotations

import json
import math
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from cpcal.calibration import fit
from cpcal.checker.platform import LEGS, Commanded, Leg, pose_bounds, stated
from cpcal.common.errors import CpcalError, InputError, Problem
from cpcal.common.numbers import bracket_text
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.files.codec import Informed, checked, load, save
from cpcal.models import PLAIN, beyond_legs, fit_model, leg_box, leg_network
from cpcal.models.leg_set import AskedSet, CertifiedSet, EnclosedLeg, certified_set, enclosed_leg
from cpcal.models.platform import Workspace, cover
from cpcal.questions.bracket import of_measurements
from cpcal.questions.next_measurement import NextPose, leg_changes
from cpcal.questions.next_measurement import next_poses as chosen_next
from cpcal.questions.result import CampaignNote, Result
from cpcal.robot import (
    Campaign,
    Mechanisms,
    Pose,
    Robot,
    inverse_kinematics,
    normalised,
    pose_jacobian,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
)
from cpcal.robot.campaign import ARRAYS
from cpcal.simulate.campaigns import streams, true_robot
from cpcal.simulate.studies import assembled_with
from cpcal.solver.certificate.exact_network import free
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit as minimax_fit

# ------------------------------------------------------------------------------------------------------------------
# The answer as plain values: what is assumed, what is proved, what is estimated, apart.
#
# What an `AssumedLeg` says is assumed, `PoseAccuracy` and `CellAccuracy` are proved under it, `Estimated` is neither.
# Lengths in mm, angles in rad.

FORMAT = "cpcal-accuracy/6"
ACCURACY_NAME = "accuracy.json"


@dataclass(frozen=True)
class AssumedLeg:
    """ASSUMED: some parameters of the leg satisfy its equation to within `eps` at the calibration poses, each for some
    reading in its set, and at every pose that is spoken of.

    PROVED, by the `certificate`: all such parameters (a, b, l) lie from `lo` to `hi`, mm; both are empty where there
    are none, and the campaign refutes what is assumed.

    `stated`: the user gave eps; else it was suggested by `growth`: least errors, readings as they are, of so many
    `poses`. `refuted_below`: proved in the run, the campaign allows no smaller eps.
    """

    leg: Annotated[int, checked("the certificate: each leg once")]
    eps: Annotated[float, checked("the cap of the certificate")]
    lo: Annotated[tuple[float, ...], checked("the enclosure of the certificate")]
    hi: Annotated[tuple[float, ...], checked("the enclosure of the certificate")]
    certificate: Annotated[str, checked("a file of the folder, which is accepted")]
    stated: Informed[bool]
    refuted_below: Informed[float]
    poses: Informed[tuple[int, ...]]
    growth: Informed[tuple[float, ...]]


@dataclass(frozen=True)
class Estimated:
    """Estimates for one pose, which prove nothing. `u_position`, `u_rotation`: expanded uncertainty with k = 2 of the
    least-squares fit. `true_position`, `true_rotation`: the simulator's own error; None where the truth is not known.
    """

    u_position: float
    u_rotation: float
    true_position: float | None = None
    true_rotation: float | None = None


_AGAIN = "computed again from the claims of the certificates"


@dataclass(frozen=True)
class PoseAccuracy:
    """One pose (P, R) that the controller commands.

    PROVED under the assumption, where `proved`: every pose `within` the box that was asked for which the legs allow is
    P + p, R(1, s) R with (p, 2 s) in `lo`, `hi` (6 each), ||p|| <= `position_bound` and the angle at most
    `rotation_bound`; infinite where nothing is proved. `shares`: to first order, by how much what is not known of each
    leg can move the platform. `beyond`: a leg's length at this pose lies outside of those that were measured.
    """

    name: Informed[str]
    position: Annotated[tuple[float, float, float], checked("the form of this pose in each certificate")]
    quaternion: Annotated[tuple[float, float, float, float], checked("the form in each certificate")]
    proved: Annotated[bool, checked("`lo` to `rotation_bound` are proved")]
    lo: Annotated[tuple[float, ...], checked(_AGAIN, "proved")]
    hi: Annotated[tuple[float, ...], checked(_AGAIN, "proved")]
    position_bound: Annotated[float, checked(_AGAIN, "proved")]
    rotation_bound: Annotated[float, checked(_AGAIN, "proved")]
    shares: Informed[tuple[float, ...]]
    beyond: Informed[bool]
    estimated: Informed[Estimated]

    @property
    def rotation(self) -> tuple[float, float, float]:
        """As a rotation vector."""
        x, y, z = rotation_vector(np.array(self.quaternion)).tolist()
        return x, y, z

    @property
    def violated(self) -> bool:
        """Whether the simulator's truth lies outside of what is proved: then the assumption does not hold."""
        e = self.estimated
        if e.true_position is None or e.true_rotation is None or not self.proved:
            return False
        return e.true_position > self.position_bound or e.true_rotation > self.rotation_bound


@dataclass(frozen=True)
class CellAccuracy:
    """All poses P, R(1, S) with (P, 2 S) between `lo` and `hi`. PROVED as in PoseAccuracy, where `proved`."""

    lo: tuple[float, ...]
    hi: tuple[float, ...]
    proved: bool
    position_bound: float
    rotation_bound: float
    shares: tuple[float, ...]


@dataclass(frozen=True)
class WorkspaceAccuracy:
    """Cells that cover a workspace. `worst_pose` (6,) is one whose own bound is `worst_pose_bound`, the largest met;
    `complete`: the bound of all cells is within the gap asked for of it."""

    lo: tuple[float, ...]
    hi: tuple[float, ...]
    cells: tuple[CellAccuracy, ...]
    worst_pose: tuple[float, ...]
    worst_pose_bound: float
    complete: bool

    @property
    def left_out(self) -> tuple[CellAccuracy, ...]:
        """Cells of which nothing is proved."""
        return tuple(cell for cell in self.cells if not cell.proved)

    @property
    def position_bound(self) -> float:
        """PROVED under the assumption for every pose in the cells that are not left out."""
        return max((cell.position_bound for cell in self.cells if cell.proved), default=math.inf)

    @property
    def rotation_bound(self) -> float:
        """Likewise."""
        return max((cell.rotation_bound for cell in self.cells if cell.proved), default=math.inf)


@dataclass(frozen=True)
class Accuracy:
    """The answer: of which campaign and controller (a name, and (n, 7) parameters), under which assumptions.

    The parameters that are spoken of lie within `delta` mm of the center of the run, the poses `within` so many mm and
    rad (each component of a rotation vector) of those that are commanded."""

    campaign: CampaignNote
    version: Informed[str]
    controller: Informed[str]
    parameters: Annotated[tuple[tuple[float, ...], ...], checked("the forms of the certificates")]
    delta: Annotated[float, checked("the box of each certificate")]
    within: Annotated[tuple[float, float], checked("what is computed again begins with it")]
    legs: tuple[AssumedLeg, ...]
    poses: tuple[PoseAccuracy, ...]
    workspace: Informed[WorkspaceAccuracy | None]
    next_poses: Informed[tuple[NextPose, ...]]
    truth_known: Informed[bool]
    seconds: Informed[float]

    @property
    def refuted(self) -> tuple[int, ...]:
        """Legs for which the campaign refutes what is assumed: nothing else is said then."""
        return tuple(leg.leg for leg in self.legs if not leg.lo)

    @property
    def proved_poses(self) -> tuple[PoseAccuracy, ...]:
        return tuple(pose for pose in self.poses if pose.proved)

    @property
    def worst_pose(self) -> PoseAccuracy | None:
        """Of the poses, that with the largest proved bound."""
        return max(self.proved_poses, key=lambda pose: pose.position_bound, default=None)

    @property
    def violated(self) -> tuple[PoseAccuracy, ...]:
        return tuple(pose for pose in self.poses if pose.violated)


def save_accuracy(found: Accuracy, folder: str | os.PathLike[str]) -> Path:
    """Write `accuracy.json` into the folder, all or nothing; its path. Raises InputError."""
    return save(found, Path(folder) / ACCURACY_NAME, FORMAT)


def load_accuracy(folder: str | os.PathLike[str]) -> Accuracy:
    """Read `accuracy.json` from the folder. Raises InputError."""
    return load(Accuracy, Path(folder) / ACCURACY_NAME, FORMAT, remedy="run cpcal accuracy again")


# ------------------------------------------------------------------------------------------------------------------
# The question.

PREFIX = "set-"  # of the certificates' names
WITHIN = 20.0, 0.1  # mm, rad: of the poses that are commanded; about others nothing is said
MOST_POSES = 1000  # which a certificate can hold
CONTROLLERS = ("nominal", "fit", "proved")
_WORST = 4  # poses, for which next poses are chosen
Told = Callable[[str], None]


@dataclass(frozen=True)
class NamedPoses:
    """K poses with names."""

    names: tuple[str, ...]
    poses: Pose


def certify_accuracy(
    campaign: Campaign,
    result: Result,
    *,
    poses: NamedPoses | None = None,
    workspace: Workspace | None = None,
    model_error: float | Sequence[float] | None = None,
    controller: str = "fit",
    validation: Campaign | None = None,
    gap: float = 0.2,
    cells: int = 600,
    next_poses: int = 4,
    certificates: str | os.PathLike[str] | None = None,
    tell: Told | None = None,
) -> Accuracy:
    """For each pose that the controller commands, and for all of a workspace: how far off the platform can be.

    PROVED under what is ASSUMED: for each leg some parameters, within `delta` mm of the center as in the result,
    satisfy its equation to within `model_error` mm at the calibration poses (each for SOME reading in its set) and at
    every pose spoken of; and the platform is within 20 mm and 0.1 rad (each component) of the pose commanded, or for a
    workspace stays on the controller's assembly branch. `model_error` is one number, or
    one for each leg; left out, it is suggested by how the least error grows over the poses of the campaign and of
    `validation`, a campaign in the same frames.

    `controller` is what computes readings from poses: "nominal" (the drawing), "fit" (least squares) or "proved" (the
    points of the result). `gap` and `cells`: the search for the worst of the workspace ends when the bound of all cells
    is within the gap of what a pose attains, or at so many cells. `next_poses`: so many to measure next are chosen by
    each of two rules (estimates). `certificates`: a folder for `set-legN.cert.jsonl`, which prove for each
    leg that its parameters lie in a box, and how far they let it deviate at each pose; from these the checker computes
    the bounds of poses again. The bounds of a workspace are proved in interval arithmetic, without certificates.

    Raises InputError for a run that this cannot be asked of: of another campaign or model, without all six legs.
    """
    began, say = time.monotonic(), tell or (lambda _: None)
    problems = _problems(campaign, result, controller, model_error)
    if poses is not None and len(poses.names) > MOST_POSES:
        what = f"are {len(poses.names)}, and certificates hold {MOST_POSES} at most"
        problems.append(Problem("poses", what, "ask for some of them at a time"))
    if problems:
        raise InputError(problems)
    if controller == "nominal":
        known = campaign.robot.parameters
    elif controller == "fit":
        known = np.stack([fit_model(campaign, leg) for leg in range(1, LEGS + 1)])
    else:
        known = np.array([leg.bracket.point for leg in result.legs])
    robot = Robot.from_parameters("controller", known)
    commanded = []
    if poses is not None:
        pairs = zip(poses.poses.position, poses.poses.quaternion, strict=True)
        commanded = [Commanded(_exact(position), _exact(quaternion)) for position, quaternion in pairs]
    errors = None if model_error is None else np.broadcast_to(np.asarray(model_error, np.float64), (LEGS,)).tolist()
    seen = [campaign] if validation is None else [campaign, validation]
    asked, assumed, enclosed = list[AskedSet](), list[AssumedLeg](), list[EnclosedLeg]()
    with tempfile.TemporaryDirectory() as draft:
        for leg, row in zip(result.legs, known, strict=True):
            center, delta, name = leg.bracket.center, result.options.delta, f"{PREFIX}leg{leg.leg}.cert.jsonl"
            say(f"growth of the model error of leg {leg.leg}")
            drawn, least = growth(seen, leg.leg, center=center, delta=delta)
            eps = suggested_error(least) if errors is None else errors[leg.leg - 1]
            say(f"certificate of the set of leg {leg.leg}")
            asked.append(
                AskedSet(
                    campaign,
                    leg.leg,
                    eps,
                    center=center,
                    delta=delta,
                    controller=row,
                    contractors=result.options.contractors,
                )
            )
            path = Path(draft if certificates is None else certificates) / name
            one = enclosed_leg(asked[-1], poses=commanded, certificate=path)
            enclosed += [] if one is None else [one]
            lo, hi = ((), ()) if one is None else (tuple(map(float, one.lo)), tuple(map(float, one.hi)))
            below = leg.bracket.lo if result.options.eps is None else 0.0
            assumed.append(AssumedLeg(leg.leg, eps, lo, hi, name, errors is not None, below, drawn, least))
    refuted = len(enclosed) < LEGS
    wanted = not refuted and (workspace is not None or (poses is not None and next_poses > 0))
    sets = _certified_sets(asked, say) if wanted else []
    at: tuple[PoseAccuracy, ...] = ()
    if not refuted and poses is not None:
        say(f"{len(poses.names)} poses")
        really = true_poses(campaign, robot, poses.poses)
        at = _at_poses(campaign, robot, enclosed, assumed, poses, commanded, really)
    over = _over(workspace, sets, gap, cells, say) if sets and workspace is not None else None
    return Accuracy(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        version=__version__,
        controller=controller,
        parameters=tuple(tuple(map(float, row)) for row in known),
        delta=result.options.delta,
        within=WITHIN,
        legs=tuple(assumed),
        poses=at,
        workspace=over,
        next_poses=_next(campaign, sets, at, over, next_poses) if sets else (),
        truth_known=any(pose.estimated.true_position is not None for pose in at),
        seconds=time.monotonic() - began,
    )


def _certified_sets(asked: Sequence[AskedSet], say: Told) -> list[CertifiedSet]:
    """The sets for cells and next poses; none at all where one is empty."""
    sets: list[CertifiedSet] = []
    for which in asked:
        say(f"certified set of leg {which.leg}")
        found = certified_set(which)
        if found is None:
            return []
        sets.append(found)
    return sets


def _exact(values: Floats) -> tuple[F, ...]:
    return tuple(map(F, values.tolist()))


def _problems(
    campaign: Campaign, result: Result, controller: str, error: float | Sequence[float] | None
) -> list[Problem]:
    found = []
    if campaign_sha256(campaign) != result.campaign.sha256:
        found.append(Problem("run", "is of another campaign", "name the run's own"))
    if result.model.name != PLAIN.name:
        what = f"has the leg model {result.model.name!r}"
        found.append(Problem("run", what, "certify with the plain model: others have no accuracy certificate yet"))
    if campaign.legs != LEGS:
        remedy = "a pose has six unknowns, and its bounds are proved from as many legs: other robots have none yet"
        found.append(Problem("robot", f"has {campaign.legs} legs", remedy))
    elif [leg.leg for leg in result.legs] != list(range(1, LEGS + 1)):
        held = ", ".join(str(leg.leg) for leg in result.legs) or "none"
        found.append(Problem("run", f"holds these legs only: {held}", "certify all six"))
    if controller not in CONTROLLERS:
        found.append(Problem("controller", f"{controller!r} is not known", f"use one of {', '.join(CONTROLLERS)}"))
    elif controller == "proved" and any(leg.bracket.point is None for leg in result.legs):
        found.append(Problem("controller", "has no proved point for each leg", "use fit or nominal"))
    if error is not None:
        values = np.atleast_1d(np.asarray(error, np.float64))
        if values.shape not in ((1,), (LEGS,)) or not (np.isfinite(values) & (values >= 0.0)).all():
            found.append(Problem("model_error", "is no number of mm, 0 or more, nor one for each leg", "give 0.2, say"))
        elif not found:
            for leg, eps in zip(result.legs, np.broadcast_to(values, (LEGS,)).tolist(), strict=True):
                found += beyond_legs(
                    campaign, leg.leg, leg.bracket.center[6] - result.options.delta, eps, "model_error"
                )
    return found


def _at_poses(
    campaign: Campaign,
    robot: Robot,
    legs: Sequence[EnclosedLeg],
    assumed: Sequence[AssumedLeg],
    named: NamedPoses,
    commanded: Sequence[Commanded],
    really: Pose | None,
) -> tuple[PoseAccuracy, ...]:
    poses, length = named.poses, inverse_kinematics(robot, named.poses)
    known = [_exact(row) for row in robot.parameters]
    u_position, u_rotation = expanded_uncertainty(campaign, poses)
    true = [(None, None)] * len(commanded)
    if really is not None:
        true = list(zip(*(of.tolist() for of in distances(really, poses)), strict=True))
    beyond = ((length < campaign.length.min(axis=0)) | (length > campaign.length.max(axis=0))).any(axis=1)
    inverse = np.linalg.norm(np.linalg.pinv(pose_jacobian(robot, poses))[:, :3], axis=1)
    out = []
    for k, (name, pose) in enumerate(zip(named.names, commanded, strict=True)):
        at = [
            Leg(row, one.lo, one.hi, F(error.eps), one.forms[k])
            for row, one, error in zip(known, legs, assumed, strict=True)
        ]
        bounds = pose_bounds(pose, at, F(WITHIN[0]), F(WITHIN[1]) / 2, free)
        lo, hi, *sizes = ((), (), np.inf, np.inf) if bounds is None else stated(bounds)
        # what is not known of each leg's length, to first order
        widths = [float(one.forms[k][1] - one.forms[k][0]) for one in legs]
        open_ = [0.5 * w * pose.millimetres(row) + e.eps for w, row, e in zip(widths, known, assumed, strict=True)]
        x, y, z = map(float, poses.position[k])
        q0, q1, q2, q3 = map(float, poses.quaternion[k])
        out.append(
            PoseAccuracy(
                name=name,
                position=(x, y, z),
                quaternion=(q0, q1, q2, q3),
                proved=bounds is not None,
                lo=lo,
                hi=hi,
                position_bound=sizes[0],
                rotation_bound=sizes[1],
                shares=tuple(map(float, inverse[k] * np.array(open_, np.float64))),
                beyond=bool(beyond[k]),
                estimated=Estimated(float(u_position[k]), float(u_rotation[k]), *true[k]),
            )
        )
    return tuple(out)


def _next(
    campaign: Campaign,
    sets: Sequence[CertifiedSet],
    at: Sequence[PoseAccuracy],
    over: WorkspaceAccuracy | None,
    count: int,
) -> tuple[NextPose, ...]:
    """For the worst poses that were met."""
    worst = sorted((pose for pose in at if pose.proved), key=lambda pose: -pose.position_bound)[:_WORST]
    rows: list[tuple[float, ...]] = [(*pose.position, *pose.rotation) for pose in worst]
    rows += [] if over is None or not over.worst_pose_bound else [over.worst_pose]
    if not rows:
        return ()
    poses = np.array(rows)
    there = Pose(poses[:, :3], normalised(quaternion_from_rotation_vector(poses[:, 3:])))
    return chosen_next(campaign, sets, there, count)


def _over(workspace: Workspace, sets: Sequence[CertifiedSet], gap: float, cells: int, say: Told) -> WorkspaceAccuracy:
    def tell(lo: float, hi: float) -> None:
        least, most = bracket_text(lo, hi, 4)
        say(f"the worst of the workspace is between {least} and {most} mm")

    found = cover(workspace, sets, gap=gap, most=cells, tell=tell)
    factor = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    sides = ((factor * side).tolist() for side in (found.boxes.lo, found.boxes.hi))
    values = (of.tolist() for of in (found.proved, found.position, found.rotation, found.share))
    each = tuple(
        CellAccuracy(tuple(lo), tuple(hi), proved, position, rotation, tuple(share))
        for lo, hi, proved, position, rotation, share in zip(*sides, *values, strict=True)
    )
    at = tuple(map(float, factor * found.at))
    return WorkspaceAccuracy(workspace.lo, workspace.hi, each, at, found.at_position, found.complete)


# ------------------------------------------------------------------------------------------------------------------
# How large the model error of each leg is over the workspace. Estimates.
#
# The certificate ASSUMES one number a leg: some parameters satisfy the leg's equation to within eps at the calibration
# poses and at every pose of the workspace. eps* of the calibration poses alone is too small for that: the parameters
# were chosen for these poses. So the least error is computed for more and more of all poses known, drawn at random, and
# its growth is carried on. The readings are taken as they are, so that the noise counts as model error: sets that are
# wide hide model errors of their own size.

SHARES = (0.25, 0.5, 1.0)  # of the poses
_DRAWS = 4  # of each share
_FEWEST = 9  # poses: with fewer eight unknowns explain them whatever they are


def suggested_error(errors: Sequence[float]) -> float:
    """mm: the least error with all poses, and twice what the last doubling added."""
    added = errors[-1] - errors[-2] if len(errors) > 1 else errors[-1]
    return errors[-1] + 2.0 * max(added, 0.0)


def growth(
    campaigns: Sequence[Campaign], leg: int, *, center: Sequence[float], delta: float, seed: int = 1
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Numbers of poses, and the least errors in mm of a leg at so many, each the mean over draws.

    Of the poses of several campaigns of one robot, all in the same frames: calibration and validation.
    """
    whole = exactly(joined_campaign(campaigns))
    network, count, rng = error_network(whole, leg, center, delta), len(whole), np.random.default_rng(seed)
    sizes = sorted({min(max(round(share * count), _FEWEST), count) for share in SHARES})
    found = []
    for size in sizes:
        rows = [sorted(rng.permutation(count)[:size].tolist()) for _ in range(1 if size == count else _DRAWS)]
        found.append(float(np.mean([least_error(of_measurements(network, some), center)[1] for some in rows])))
    return tuple(sizes), tuple(found)


def joined_campaign(campaigns: Sequence[Campaign]) -> Campaign:
    """All measurements as one campaign, named by the number of their campaign and their own names."""
    pose = [f"{k}.{name}" for k, c in enumerate(campaigns) for name in c.pose]
    run = [name for c in campaigns for name in c.run]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(c, name) for c in campaigns]) for name in ARRAYS}
    return Campaign.of(campaigns[0].robot, *map(arrays.pop, ARRAYS[:3]), pose=pose, run=run, **arrays)


def exactly(campaign: Campaign) -> Campaign:
    """The same readings, without sets around them."""
    c = campaign
    return Campaign.of(c.robot, c.position, c.quaternion, c.length, pose=c.pose, run=c.run, exact=True)


def error_network(campaign: Campaign, leg: int, center: Sequence[float], delta: float) -> ConstraintNetwork:
    """A leg's equations to within any eps."""
    box = leg_box(np.asarray(center, np.float64), delta)
    return leg_network(campaign, leg, box, engine=get_arithmetic("float64"), eps=(0.0, np.inf))


def least_error(network: ConstraintNetwork, start: Sequence[float]) -> tuple[Floats, float]:
    """Parameters (7,) near `start` whose largest error is (locally) least, and that error in mm, at the readings in
    their sets that suit best."""
    point = minimax_fit(Rows(network), network.names.index("eps"), network.domain, np.append(start, 0.0))
    return point[:-1], max(float(point[-1]), 0.0)


# ------------------------------------------------------------------------------------------------------------------
# Beside what is proved: the expanded uncertainty of least squares, and the simulator's truth. Floating point.

COVERAGE = 2.0  # k


def expanded_uncertainty(campaign: Campaign, poses: Pose) -> tuple[Floats, Floats]:
    """U of position, mm, and of rotation, rad, (K,) both: k = 2 times the root of the covariance's trace.

    From the residuals of the plain fit: what they scatter is taken for noise, model error too. nan where the data do
    not determine the parameters.
    """
    found = fit(campaign, covariance="residuals")
    robot = Robot.from_parameters(campaign.robot.name, found.parameters)
    form = leg_changes(robot, poses)
    inverse = np.linalg.pinv(pose_jacobian(robot, poses))  # (K, 6, n)
    count, legs = form.shape[:2]
    moves = (inverse[..., None] * form[:, None]).reshape(count, 6, 7 * legs)
    variance = np.einsum("kiu,uv,kiv->ki", moves, found.covariance, moves)
    out = COVERAGE * np.sqrt(np.stack([variance[:, :3].sum(axis=1), variance[:, 3:].sum(axis=1)]))
    return out[0], out[1]


def true_poses(campaign: Campaign, controller: Robot, poses: Pose) -> Pose | None:
    """Where a simulated platform really is when the controller commands K poses; None where the truth is not known."""
    robot = true_robot(campaign)
    if robot is None:
        return None
    try:
        options = json.loads(campaign.provenance["options"])
        reference = 0.5 * sum(options["stroke"])
        stream = streams(int(options["seed"]))[1]
        error = float(options["joint_error"])
        mechanisms = Mechanisms.sampled(
            robot.legs, np.random.default_rng(0), stream, joint_error=error, reference=reference
        )
    except (KeyError, TypeError, ValueError, CpcalError):
        return None
    return assembled_with(robot, mechanisms, inverse_kinematics(controller, poses), poses)


def distances(one: Pose, other: Pose) -> tuple[Floats, Floats]:
    """Between K poses: mm, and the angle in rad."""
    turn = quaternion_product(one.quaternion, quaternion_conjugate(other.quaternion))
    return np.linalg.norm(one.position - other.position, axis=-1), np.linalg.norm(rotation_vector(turn), axis=-1)
