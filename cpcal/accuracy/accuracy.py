"""How far from where the controller says the platform can be: the certificate of accuracy of a certified run."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from pathlib import Path

import numpy as np

from cpcal.accuracy.findings import (
    Accuracy,
    AssumedError,
    CellAccuracy,
    CertifiedBox,
    Estimated,
    NextPose,
    PoseAccuracy,
    WorkspaceAccuracy,
)
from cpcal.accuracy.model_error import Growth, growth
from cpcal.accuracy.next_poses import next_poses
from cpcal.calibration import fit
from cpcal.checker.platform import LEGS, Commanded, Leg, pose_bounds, stated
from cpcal.common.errors import CpcalError, InputError, Problem
from cpcal.common.numbers import bracket_text
from cpcal.common.values import Floats
from cpcal.common.version import __version__
from cpcal.files import campaign_sha256
from cpcal.models import PLAIN, beyond_legs, fit_model
from cpcal.models.leg_set import AskedSet, CertifiedSet, EnclosedLeg, certified_set, enclosed_leg
from cpcal.models.platform import Covered, Workspace, cover
from cpcal.questions import CampaignNote, Result
from cpcal.robot import (
    Campaign,
    Mechanisms,
    Pose,
    Robot,
    inverse_kinematics,
    leg_vectors,
    normalised,
    pose_jacobian,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_vector,
)
from cpcal.robot.robot import joint_phases
from cpcal.simulate.assembly import assembled_with
from cpcal.simulate.campaigns import streams, true_robot
from cpcal.solver.certificate.exact_network import free

PREFIX = "set-"  # of the certificates' names
WITHIN = 20.0, 0.1  # mm, rad: of the poses that are commanded; about others nothing is said
MOST_POSES = 1000  # which a certificate can hold
CONTROLLERS = ("nominal", "fit", "proved")
_WORST = 4  # poses, for which next poses are chosen
Told = Callable[[str], None]
Truth = Callable[[Robot, Pose], Pose | None]


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
    truth: Truth | None = None,
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
    each of two rules (estimates). `truth`: gives the true poses of a simulated robot
    (default: of what `cpcal simulate` wrote). `certificates`: a folder for `set-legN.cert.jsonl`, which prove for each
    leg that its parameters lie in a box, and how far they let it deviate at each pose; from these the checker computes
    the bounds of poses again. The bounds of a workspace are proved in interval arithmetic, without certificates.

    Raises InputError for a run that this cannot be asked of: of another campaign or model, without all six legs.
    """
    began = time.monotonic()
    problems = _problems(campaign, result, controller, model_error)
    if problems:
        raise InputError(problems)
    say = tell or (lambda _: None)
    if poses is not None and len(poses.names) > MOST_POSES:
        what = f"are {len(poses.names)}, and certificates hold {MOST_POSES} at most"
        raise InputError([Problem("poses", what, "ask for some of them at a time")])
    known = _controller(campaign, result, controller)
    robot = Robot.from_parameters("controller", known)
    assumed = _assumed(campaign, result, validation, model_error, say)
    commanded = [] if poses is None else list(map(_commanded, poses.poses.position, poses.poses.quaternion))
    asked = [
        AskedSet(
            campaign,
            leg.leg,
            error.eps,
            center=leg.bracket.center,
            delta=result.options.delta,
            controller=known[leg.leg - 1],
            contractors=result.options.contractors,
        )
        for leg, error in zip(result.legs, assumed, strict=True)
    ]
    enclosed: list[EnclosedLeg | None] = []
    with tempfile.TemporaryDirectory() as draft:
        folder = Path(draft if certificates is None else certificates)
        for which in asked:
            say(f"certificate of the set of leg {which.leg}")
            enclosed.append(enclosed_leg(which, poses=commanded, certificate=folder / _certificate(which.leg)))
    refuted = [which.leg for which, one in zip(asked, enclosed, strict=True) if one is None]
    legs = [one for one in enclosed if one is not None]
    wanted = not refuted and (workspace is not None or (poses is not None and next_poses > 0))
    sets = _certified_sets(asked, say) if wanted else []
    at: tuple[PoseAccuracy, ...] = ()
    over = None
    if not refuted and poses is not None:
        say(f"{len(poses.names)} poses")
        at = _at_poses(
            campaign, robot, legs, assumed, poses, commanded, truth or (lambda r, p: true_poses(campaign, r, p))
        )
    if sets and workspace is not None:

        def tell_cover(lo: float, hi: float) -> None:
            least, most = bracket_text(lo, hi, 4)
            say(f"the worst of the workspace is between {least} and {most} mm")

        over = _over(workspace, cover(workspace, sets, gap=gap, most=cells, tell=tell_cover))
    return Accuracy(
        campaign=CampaignNote(campaign_sha256(campaign), campaign.robot.name, len(campaign)),
        version=__version__,
        controller=controller,
        parameters=tuple(tuple(map(float, row)) for row in known),
        delta=result.options.delta,
        within=WITHIN,
        assumed=tuple(assumed),
        boxes=tuple(
            CertifiedBox(
                error.leg,
                error.eps,
                *(((), ()) if one is None else (tuple(map(float, one.lo)), tuple(map(float, one.hi)))),
                _certificate(error.leg),
            )
            for error, one in zip(assumed, enclosed, strict=True)
        ),
        refuted=tuple(refuted),
        poses=at,
        workspace=over,
        next_poses=_next(campaign, sets, at, over, next_poses) if sets else (),
        truth_known=any(pose.estimated.true_position is not None for pose in at),
        seconds=time.monotonic() - began,
    )


def _certificate(leg: int) -> str:
    return f"{PREFIX}leg{leg}.cert.jsonl"


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


def _commanded(position: Floats, quaternion: Floats) -> Commanded:
    return Commanded(_exact(position), _exact(quaternion))


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


def _controller(campaign: Campaign, result: Result, name: str) -> Floats:
    """(n, 7) mm."""
    if name == "nominal":
        return campaign.robot.parameters
    if name == "fit":
        return np.stack([fit_model(campaign, leg) for leg in range(1, LEGS + 1)])
    return np.array([leg.bracket.point for leg in result.legs])


def _assumed(
    campaign: Campaign,
    result: Result,
    validation: Campaign | None,
    error: float | Sequence[float] | None,
    say: Told,
) -> list[AssumedError]:
    known = [campaign] if validation is None else [campaign, validation]
    stated = None if error is None else np.broadcast_to(np.asarray(error, np.float64), (LEGS,))
    out = []
    for k, leg in enumerate(result.legs):
        say(f"growth of the model error of leg {leg.leg}")
        seen: Growth = growth(known, leg.leg, center=leg.bracket.center, delta=result.options.delta)
        eps = seen.suggested if stated is None else float(stated[k])
        lo = leg.bracket.lo if result.options.eps is None else 0.0
        out.append(AssumedError(leg.leg, eps, stated is not None, lo, seen.poses, seen.centered))
    return out


def _at_poses(
    campaign: Campaign,
    robot: Robot,
    legs: Sequence[EnclosedLeg],
    assumed: Sequence[AssumedError],
    named: NamedPoses,
    commanded: Sequence[Commanded],
    truth: Truth,
) -> tuple[PoseAccuracy, ...]:
    poses = named.poses
    known = [_exact(row) for row in robot.parameters]
    reach, turn = map(F, WITHIN)
    u_position, u_rotation = expanded_uncertainty(campaign, poses)
    really = truth(robot, poses)
    true = None if really is None else distances(really, poses)
    length = inverse_kinematics(robot, poses)
    beyond = ((length < campaign.length.min(axis=0)) | (length > campaign.length.max(axis=0))).any(axis=1)
    # of the leg's length, to first order
    open_ = np.array(
        [[float(one.forms[k][1] - one.forms[k][0]) for one in legs] for k in range(len(commanded))], np.float64
    ).reshape(-1, LEGS)
    for k, pose in enumerate(commanded):
        open_[k] *= [0.5 * pose.millimetres(row) for row in known]
    open_ += [error.eps for error in assumed]
    shares = np.linalg.norm(np.linalg.pinv(pose_jacobian(robot, poses))[:, :3], axis=1) * open_
    out = []
    for k, name in enumerate(named.names):
        at = [
            Leg(row, one.lo, one.hi, F(error.eps), one.forms[k])
            for row, one, error in zip(known, legs, assumed, strict=True)
        ]
        bounds = pose_bounds(commanded[k], at, reach, turn / 2, free)
        estimated = Estimated(
            float(u_position[k]),
            float(u_rotation[k]),
            None if true is None else float(true[0][k]),
            None if true is None else float(true[1][k]),
        )
        w, x, y, z = map(float, poses.quaternion[k])
        lo, hi, *sizes = ((), (), np.inf, np.inf) if bounds is None else stated(bounds)
        out.append(
            PoseAccuracy(
                name=name,
                position=_three(poses.position[k]),
                quaternion=(w, x, y, z),
                proved=bounds is not None,
                lo=lo,
                hi=hi,
                position_bound=sizes[0],
                rotation_bound=sizes[1],
                shares=tuple(map(float, shares[k])),
                beyond=bool(beyond[k]),
                estimated=estimated,
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
    return next_poses(campaign, sets, there, count)


def _over(workspace: Workspace, found: Covered) -> WorkspaceAccuracy:
    factor = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    cells = tuple(
        CellAccuracy(
            tuple(map(float, factor * found.boxes.lo[k])),
            tuple(map(float, factor * found.boxes.hi[k])),
            bool(found.proved[k]),
            float(found.position[k]),
            float(found.rotation[k]),
            tuple(map(float, found.share[k])),
        )
        for k in range(len(found.proved))
    )
    at = tuple(map(float, factor * found.at))
    return WorkspaceAccuracy(workspace.lo, workspace.hi, cells, at, found.at_position, found.complete)


def _three(values: Floats) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def grid(workspace: Workspace, per_axis: int = 7, heights: int = 3) -> NamedPoses:
    """Poses on `heights` slices of a workspace, `per_axis` squared on each, with its middle rotation."""
    lo, hi = np.array(workspace.lo), np.array(workspace.hi)
    middle = 0.5 * (lo + hi)
    axes = [
        np.linspace(lo[k], hi[k], n) if hi[k] > lo[k] else lo[k : k + 1]
        for k, n in ((2, heights), (1, per_axis), (0, per_axis))
    ]
    z, y, x = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    quaternion = normalised(np.concatenate([[1.0], 0.5 * middle[3:]]))
    names = tuple(f"g{k:03d}" for k in range(len(x)))
    return NamedPoses(names, Pose(np.stack([x, y, z], axis=1), np.tile(quaternion, (len(x), 1))))


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
    vector = leg_vectors(robot, poses)
    unit = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    back = np.einsum("kji,knj->kni", poses.rotation, unit)
    form = np.concatenate([-unit, back, -np.ones((*unit.shape[:2], 1))], axis=-1)  # (K, n, 7)
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
    assert np.array_equal(mechanisms.joint_phase, joint_phases(robot.legs, streams(int(options["seed"]))[1]))
    return assembled_with(robot, mechanisms, inverse_kinematics(controller, poses), poses)


def distances(one: Pose, other: Pose) -> tuple[Floats, Floats]:
    """Between K poses: mm, and the angle in rad."""
    turn = quaternion_product(one.quaternion, quaternion_conjugate(other.quaternion))
    return np.linalg.norm(one.position - other.position, axis=-1), np.linalg.norm(rotation_vector(turn), axis=-1)
