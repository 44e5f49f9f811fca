"""Which poses to measure next: those where the certified sets leave a length open most. Floating point, first order.

Near the controller's parameters a leg's set is a polytope, one slab for each measurement. The pose whose own length
ranges widest over it, in units of what a new measurement would leave open, is chosen; its slab is added (about the
middle of the range, where the reading is expected), and so on. Beside it the greedy start of DETMAX: the pose that adds
most to the determinant of the information. What is expected of both is the worst bound to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.accuracy.findings import NextPose
from cpcal.common.values import Floats
from cpcal.models import PLAIN, ModelResiduals, reading_sensitivities
from cpcal.models.leg_set import CertifiedSet
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
from cpcal.solver.linear import Dense, LinearStatus

_CANDIDATES = 40
_LOOSER = 1.0 + 1e-9  # of the slabs, so that rounding leaves a point in them
CERTIFIED, DETERMINANT = "certified width", "DETMAX"


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
        return _Polytope(
            np.concatenate([self.rows, (form @ self.to_x)[None]]),
            np.append(self.middle, middle - form @ self.offset),
            np.append(self.room, room),
            self.to_x,
            self.offset,
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
        found = forward_poses(robot, drawn, central_pose(robot, 0.5 * (low + high)))
    except KinematicsError:
        return ()
    rows = np.flatnonzero(found.converged)
    candidates = Pose(found.pose.position[rows], found.pose.quaternion[rows])
    polytopes = [_polytope(campaign, one) for one in sets]
    rooms = np.array([np.median(p.room) for p in polytopes])
    forms = _forms(robot, candidates)
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


def _forms(robot: Robot, poses: Pose) -> Floats:
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
    forms, inverse = _forms(robot, worst), np.linalg.pinv(pose_jacobian(robot, worst))
    ranges = [p.ranges(forms[:, i]) for i, p in enumerate(polytopes)]
    middle = np.stack([r[0] for r in ranges], axis=1)
    half = np.stack([r[1] + one.eps for r, one in zip(ranges, sets, strict=True)], axis=1)
    signs = np.where(np.arange(64)[:, None] >> np.arange(6) & 1, 1.0, -1.0)
    corners = middle[:, None] + signs[None] * half[:, None]  # (K, 64, 6)
    moves = np.einsum("kij,kcj->kci", inverse[:, :3], corners)
    return float(np.linalg.norm(moves, axis=-1).max())
