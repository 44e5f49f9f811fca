"""Poses that nobody measured: how large the model error is there, and which of them to measure next.

Estimates, in floating point. Nothing of it is proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpcal.common.values import Floats
from cpcal.models import PLAIN, ModelResiduals, leg_box, leg_network, reading_sensitivities
from cpcal.models.leg_set import CertifiedSet
from cpcal.questions.bracket import of_measurements
from cpcal.robot import (
    Campaign,
    KinematicsError,
    Pose,
    Robot,
    central_pose,
    forward_poses,
    leg_vectors,
    pose_jacobian,
    rotation_vector,
)
from cpcal.robot.campaign import ARRAYS
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.linear import Dense, LinearStatus
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.local import fit

# ------------------------------------------------------------------------------------------------------------------
# How large the model error of each leg is over the workspace.
#
# The certificate of accuracy ASSUMES one number a leg: some parameters satisfy the leg's equation to within eps at the
# calibration poses and at every pose of the workspace. eps* of the calibration poses alone is too small for that: the
# parameters were chosen for these poses. So the least error is computed for more and more of all poses known, drawn at
# random, and its growth is carried on: see `Growth.suggested`.

SHARES = (0.25, 0.5, 1.0)  # of the poses
_DRAWS = 4  # of each share
_FEWEST = 9  # poses: with fewer eight unknowns explain them whatever they are


@dataclass(frozen=True)
class Growth:
    """Least errors of one leg in mm, each the mean over draws of `poses` poses, the last of all of them.

    `least`: with the readings in their sets that suit best. `centered`: with the readings as they are, so that the
    noise counts as model error too.
    """

    leg: int
    poses: tuple[int, ...]
    least: tuple[float, ...]
    centered: tuple[float, ...]

    @property
    def suggested(self) -> float:
        """mm: the least error of the readings as they are with all poses, and twice what the last doubling added.

        Readings as they are, for sets that are wide hide model errors of their own size.
        """
        added = self.centered[-1] - self.centered[-2] if len(self.centered) > 1 else self.centered[-1]
        return self.centered[-1] + 2.0 * max(added, 0.0)


def growth(campaigns: Sequence[Campaign], leg: int, *, center: Sequence[float], delta: float, seed: int = 1) -> Growth:
    """Of the poses of several campaigns of one robot, all in the same frames: calibration and validation."""
    whole = joined_campaign(campaigns)
    count, rng = len(whole), np.random.default_rng(seed)
    networks = [_network(part, leg, center, delta) for part in (whole, exactly(whole))]
    sizes = sorted({min(max(round(share * count), _FEWEST), count) for share in SHARES})
    found = np.empty((len(sizes), 2))
    for k, size in enumerate(sizes):
        rows = [sorted(rng.permutation(count)[:size].tolist()) for _ in range(1 if size == count else _DRAWS)]
        for i, network in enumerate(networks):
            found[k, i] = np.mean([_least(of_measurements(network, some), center)[1] for some in rows])
    least, centered = found.T.tolist()
    return Growth(leg, tuple(sizes), tuple(least), tuple(centered))


def joined_campaign(campaigns: Sequence[Campaign]) -> Campaign:
    """All measurements as one campaign, named by the number of their campaign and their own names."""
    pose = [f"{k}.{name}" for k, c in enumerate(campaigns) for name in c.pose]
    run = [name for c in campaigns for name in c.run]
    arrays = [np.concatenate([getattr(c, name) for c in campaigns]) for name in ARRAYS]
    first, *readings = campaigns[0].robot, *arrays[:3]
    radii: dict[str, Any] = dict(zip(ARRAYS[3:], arrays[3:], strict=True))
    return Campaign.of(first, *readings, pose=pose, run=run, **radii)


def exactly(campaign: Campaign) -> Campaign:
    """The same readings, without sets around them."""
    c = campaign
    return Campaign.of(c.robot, c.position, c.quaternion, c.length, pose=c.pose, run=c.run, exact=True)


def chebyshev(campaign: Campaign, leg: int, start: Sequence[float], delta: float) -> tuple[Floats, float]:
    """Parameters (7,) near `start` whose largest error over the campaign is (locally) least, and that error in mm.

    The readings are those in their sets that suit best.
    """
    return _least(_network(campaign, leg, start, delta), start)


def _network(campaign: Campaign, leg: int, center: Sequence[float], delta: float) -> ConstraintNetwork:
    box = leg_box(np.asarray(center, np.float64), delta)
    return leg_network(campaign, leg, box, engine=get_arithmetic("float64"), eps=(0.0, np.inf))


def _least(network: ConstraintNetwork, start: Sequence[float]) -> tuple[Floats, float]:
    point = fit(Rows(network), network.names.index("eps"), network.domain, np.append(start, 0.0))
    return point[:-1], max(float(point[-1]), 0.0)


# ------------------------------------------------------------------------------------------------------------------
# Which poses to measure next: those where the certified sets leave a length open most. To first order.
#
# Near the controller's parameters a leg's set is a polytope, one slab for each measurement. The pose whose own length
# ranges widest over it, in units of what a new measurement would leave open, is chosen; its slab is added (about the
# middle of the range, where the reading is expected), and so on. Beside it the greedy start of DETMAX: the pose that
# adds most to the determinant of the information. What is expected of both is the worst bound to first order.

_CANDIDATES = 40
_LOOSER = 1.0 + 1e-9  # of the slabs, so that rounding leaves a point in them
CERTIFIED, DETERMINANT = "certified width", "DETMAX"


@dataclass(frozen=True)
class NextPose:
    """A pose that would narrow what is not known most, and the worst bound expected then, mm: an estimate."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    by: str
    expected: float


@dataclass
class _Polytope:
    """{y in [-1, 1]^7 : |rows @ y - middle| <= room} for one leg; parameters are controller + to_x @ y + offset."""

    rows: Floats
    middle: Floats
    room: Floats
    to_x: Floats
    offset: Floats

    def ranges(self, forms: Floats) -> tuple[Floats, Floats]:
        """Middles and half-widths (m,) of linear forms (m, 7) in the parameters, over the polytope."""
        objective = forms @ self.to_x
        engine = Dense()
        matrix = np.concatenate([self.rows, -self.rows])
        rhs = np.concatenate([self.middle + self.room * _LOOSER, -self.middle + self.room * _LOOSER])
        engine.load(matrix, rhs, -np.ones(7), np.ones(7))
        ends = np.empty((2, len(forms)))
        for k, one in enumerate(objective):
            for side, sign in enumerate((1.0, -1.0)):
                found = engine.minimize(sign * one)
                good = found.status is LinearStatus.OPTIMAL
                ends[side, k] = one @ found.point if good else -sign * np.abs(one).sum()
        shift = forms @ self.offset
        return 0.5 * (ends[0] + ends[1]) + shift, 0.5 * np.abs(ends[1] - ends[0])

    def with_slab(self, form: Floats, middle: float, room: float) -> _Polytope:
        """With one measurement more."""
        return replace(
            self,
            rows=np.concatenate([self.rows, (form @ self.to_x)[None]]),
            middle=np.append(self.middle, middle - form @ self.offset),
            room=np.append(self.room, room),
        )


def next_poses(
    campaign: Campaign, sets: Sequence[CertifiedSet], worst: Pose, count: int, *, seed: int = 1
) -> tuple[NextPose, ...]:
    """`count` poses by certified width, then as many by the determinant; `worst` (K) are poses whose bound matters.

    Candidates are drawn within the readings that the campaign has. () where none can be reached.
    """
    robot = Robot.from_parameters("controller", np.stack([one.controller for one in sets]))
    low, high = campaign.length.min(axis=0), campaign.length.max(axis=0)
    drawn = np.random.default_rng(seed).uniform(low, high, (_CANDIDATES, robot.legs))
    try:
        found, converged = forward_poses(robot, drawn, central_pose(robot, 0.5 * (low + high)))
    except KinematicsError:
        return ()
    candidates = found.rows(converged)
    polytopes = [_polytope(campaign, one) for one in sets]
    rooms = np.array([np.median(p.room) for p in polytopes])
    forms = leg_changes(robot, candidates)
    out: list[NextPose] = []
    for by, order in (
        (CERTIFIED, _by_width(polytopes, forms, rooms, count)),
        (DETERMINANT, _by_determinant(polytopes, forms, rooms, count)),
    ):
        now = list(polytopes)
        for k in order:
            now = _added(now, forms[k], rooms)
            expected = _expected(robot, now, sets, worst)
            x, y, z = map(float, candidates.position[k])
            a, b, c = map(float, rotation_vector(candidates.quaternion[k]))
            out.append(NextPose((x, y, z), (a, b, c), by, expected))
    return tuple(out)


def _polytope(campaign: Campaign, one: CertifiedSet) -> _Polytope:
    model = ModelResiduals(campaign, one.leg, PLAIN)
    reach = np.maximum(one.along.rad, 1e-12)
    to_x, offset = one.basis * reach, one.basis @ one.along.mid
    jacobian = model.jacobian(one.controller)
    room = one.eps + reading_sensitivities(campaign, one.leg, one.controller, PLAIN)
    middle = -model.values(one.controller) - jacobian @ offset
    return _Polytope(jacobian @ to_x, middle, np.maximum(room, 1e-9), to_x, offset)


def leg_changes(robot: Robot, poses: Pose) -> Floats:
    """(K, n, 7): how a leg's predicted reading changes with its parameters."""
    vector = leg_vectors(robot, poses)
    unit = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    back = np.einsum("kji,knj->kni", poses.rotation, unit)
    return np.concatenate([-unit, back, -np.ones((*unit.shape[:2], 1))], axis=-1)


def _by_width(polytopes: Sequence[_Polytope], forms: Floats, rooms: Floats, count: int) -> list[int]:
    now, order = list(polytopes), list[int]()
    for _ in range(min(count, len(forms))):
        widths = np.stack([p.ranges(forms[:, i])[1] for i, p in enumerate(now)], axis=1)
        gain = (widths / rooms).max(axis=1)
        gain[order] = -np.inf
        order.append(int(np.argmax(gain)))
        now = _added(now, forms[order[-1]], rooms)
    return order


def _by_determinant(polytopes: Sequence[_Polytope], forms: Floats, rooms: Floats, count: int) -> list[int]:
    information = np.stack([(p.rows / p.room[:, None]).T @ (p.rows / p.room[:, None]) for p in polytopes])
    scaled = np.stack([forms[:, i] @ p.to_x / rooms[i] for i, p in enumerate(polytopes)], axis=1)  # (K, n, 7)
    outer = scaled[..., :, None] * scaled[..., None, :]
    order: list[int] = []
    for _ in range(min(count, len(forms))):
        gain = np.linalg.slogdet(information + outer)[1].sum(axis=1)
        gain[order] = -np.inf
        order.append(int(np.argmax(gain)))
        information = information + outer[order[-1]]
    return order


def _added(polytopes: Sequence[_Polytope], form: Floats, rooms: Floats) -> list[_Polytope]:
    out = []
    for i, one in enumerate(polytopes):
        middle, _ = one.ranges(form[i : i + 1])
        out.append(one.with_slab(form[i], float(middle[0]), float(rooms[i])))
    return out


def _expected(robot: Robot, polytopes: Sequence[_Polytope], sets: Sequence[CertifiedSet], worst: Pose) -> float:
    """The largest bound of the position over some poses, to first order, mm."""
    forms, inverse = leg_changes(robot, worst), np.linalg.pinv(pose_jacobian(robot, worst))
    ranges = [p.ranges(forms[:, i]) for i, p in enumerate(polytopes)]
    middle = np.stack([r[0] for r in ranges], axis=1)
    half = np.stack([r[1] + one.eps for r, one in zip(ranges, sets, strict=True)], axis=1)
    signs = np.where(np.arange(64)[:, None] >> np.arange(6) & 1, 1.0, -1.0)
    corners = middle[:, None] + signs[None] * half[:, None]  # (K, 64, 6)
    moves = np.einsum("kij,kcj->kci", inverse[:, :3], corners)
    return float(np.linalg.norm(moves, axis=-1).max())
