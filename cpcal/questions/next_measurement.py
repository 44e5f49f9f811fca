"""Which poses to measure next: for a certified platform, and for a hand-eye study.

First-order estimates in floating point, not proofs. The candidates are chosen one after another: each time the one that
helps most beside those that were chosen before.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.errors import unusable
from cpcal.common.numbers import about, at_most, stated
from cpcal.common.values import ArrayPair, Floats, Names, Numbers, Vector, norms
from cpcal.models import PLAIN, ModelResiduals, reading_moves
from cpcal.models.frames import Tell
from cpcal.models.hand_eye import HandEyeFrames, HandEyeStudy
from cpcal.models.hand_eye_fit import PARAMETERS, PixelModel, best_frames, classical_answer, excess
from cpcal.models.leg_set import CertifiedSet
from cpcal.models.platform import pose_inverse
from cpcal.robot import (
    Campaign,
    LegEquations,
    Pose,
    Robot,
    inverse_kinematics,
    normalised,
    pose_jacobian,
    rotation_vector,
)
from cpcal.robot.kinematics import cross_matrix
from cpcal.solver.linear import Dense, LinearStatus


def greedy(candidates: Sequence[int], count: int, gain: Callable[[list[int]], Callable[[int], Any]]) -> list[int]:
    """`count` of the candidates; `gain(chosen)` gives what each other one would bring beside those chosen."""
    chosen: list[int] = []
    for _ in range(min(count, len(candidates))):
        chosen.append(max((k for k in candidates if k not in chosen), key=gain(chosen)))
    return chosen


@dataclass
class Polytope:
    """{x = to_x @ y + offset : y in [-1, 1]^n, |rows @ y - middle| <= slack}: what measurements allow, to first order.

    x are parameters less those thought best. The first unknowns y stand for them, others for readings.
    """

    rows: Floats
    middle: Floats
    slack: Floats
    to_x: Floats
    offset: Floats

    @staticmethod
    def about(campaign: Campaign, one: CertifiedSet) -> "Polytope":
        """A leg's parameters about the controller's, by the measurements that the set holds."""
        model = ModelResiduals(campaign, one.leg, PLAIN)
        to_x, offset = one.basis * np.maximum(one.along.rad, 1e-12), one.basis @ one.along.mid
        jacobian = model.jacobian(one.controller)
        slack = one.eps + reading_moves(campaign, one.leg, one.controller).sum(axis=1)
        middle = -model.values(one.controller) - jacobian @ offset
        return Polytope(jacobian @ to_x, middle, np.maximum(slack, 1e-9), to_x, offset)

    def ranges(self, forms: Floats) -> ArrayPair:
        """Middles and half-widths (m,) of linear forms (m, size of x) in the parameters."""
        size, slack = np.abs(self.rows).max(axis=1), self.slack * _LOOSER
        matrix = self.rows / size[:, None]
        rhs = np.concatenate([(self.middle + slack) / size, (slack - self.middle) / size])
        side, objectives = np.ones(matrix.shape[1]), forms @ self.to_x
        engine = Dense(np.concatenate([matrix, -matrix]), rhs, -side, side)
        ends = np.abs(objectives).sum(axis=1) * np.array([[-1.0], [1.0]])  # where a program fails
        for k, objective in enumerate(objectives):
            for which, sign in enumerate((1.0, -1.0)):
                found = engine.minimize(sign * objective / (np.abs(objective).max() or 1.0))
                if found.status is LinearStatus.OPTIMAL:
                    ends[which, k] = objective @ found.point
        return 0.5 * (ends[0] + ends[1]) + forms @ self.offset, 0.5 * np.abs(ends[1] - ends[0])

    def measured(self, forms: Floats, slack: Floats, own: Floats | None = None) -> "Polytope":
        """With measurements more, which read what the best parameters have them; `own` (m, p): how they change with
        numbers of their own, each from -1 to 1."""
        more = np.zeros((len(forms), 0)) if own is None else own
        old, new = len(self.rows), forms @ self.to_x
        return Polytope(
            np.block([[self.rows, np.zeros((old, more.shape[1]))], [new, more]]),
            np.concatenate([self.middle, -forms @ self.offset]),
            np.concatenate([self.slack, slack]),
            np.pad(self.to_x, ((0, 0), (0, more.shape[1]))),
            self.offset,
        )


# ------------------------------------------------------------------------------------------------------------------
# Poses of a platform: those where the certified sets leave a length open most.
#
# Near the controller's parameters a leg's set is a polytope, one slab for each measurement. The pose whose own length
# ranges widest over it, in units of what a new measurement would leave open, is chosen; its slab is added, and so on.
# What is expected is the worst bound to first order.

_CANDIDATES, _DRAWN = 40, 400  # of so many drawn
_LOOSER = 1.0 + 1e-9  # of the slabs, so that rounding leaves a point in them


@dataclass(frozen=True)
class NextPose:
    """A pose that would narrow what is not known most, and the worst bound expected then, mm: an estimate."""

    position: Vector
    rotation: Vector
    expected: float


def poses_to_measure(
    campaign: Campaign,
    sets: Sequence[CertifiedSet],
    polytopes: Sequence[Polytope],
    worst: Pose,
    count: int,
    *,
    held: Sequence[int] = (),
) -> tuple[NextPose, ...]:
    """`count` poses by certified width; `worst` (K) are poses whose bound matters.

    Candidates lie between two measured poses each, within the readings that the campaign has. () where none do.
    """
    robot = Robot.from_parameters("controller", np.stack([one.controller for one in sets]))
    random = np.random.default_rng(1)
    some = random.integers(0, len(campaign), (2, _DRAWN))
    share, quaternion = random.uniform(size=(_DRAWN, 1)), campaign.quaternion[some]
    quaternion[1] *= np.where(np.sum(quaternion[0] * quaternion[1], axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    (p, q), (a, b) = campaign.position[some], quaternion
    drawn = Pose(p + share * (q - p), normalised(a + share * (b - a)))
    length = inverse_kinematics(robot, drawn)
    inside = (campaign.length.min(axis=0) <= length) & (length <= campaign.length.max(axis=0))
    candidates = drawn.rows(np.flatnonzero(inside.all(axis=1))[:_CANDIDATES])
    slacks = np.array([np.median(one.slack) for one in polytopes])
    forms = leg_changes(robot, candidates)

    @cache
    def after(*chosen: int) -> Sequence[Polytope]:
        if not chosen:
            return polytopes
        before, form = after(*chosen[:-1]), forms[chosen[-1]]
        return [one.measured(form[[i]], slacks[[i]]) for i, one in enumerate(before)]

    def width(chosen: list[int]) -> Callable[[int], Any]:
        widths = np.stack([one.ranges(forms[:, i])[1] for i, one in enumerate(after(*chosen))], axis=1)
        gain: list[float] = (widths / slacks).max(axis=1).tolist()
        return gain.__getitem__

    out, order = [], greedy(range(len(forms)), count, width)
    for n, k in enumerate(order, 1):
        expected = float(attained(robot, after(*order[:n]), sets, worst, held).max())
        place, turn = candidates.position[k], rotation_vector(candidates.quaternion[k])
        out.append(NextPose(tuple(place.tolist()), tuple(turn.tolist()), expected))
    return tuple(out)


def leg_changes(robot: Robot, poses: Pose) -> Floats:
    """(K, n, 7): how a leg's predicted reading changes with its parameters."""
    return LegEquations(poses.position, poses.rotation, inverse_kinematics(robot, poses)).by_parameters(
        robot.parameters
    )


def attained(
    robot: Robot, polytopes: Sequence[Polytope], sets: Sequence[CertifiedSet], poses: Pose, held: Sequence[int] = ()
) -> Floats:
    """(K,) mm: how far, to first order, some parameters of the sets and errors up to eps move the platform."""
    forms, inverse = leg_changes(robot, poses), pose_inverse(pose_jacobian(robot, poses), held)
    middle, half = np.stack([p.ranges(forms[:, i]) for i, p in enumerate(polytopes)], axis=-1)  # (K, n) each
    half = half + [one.eps for one in sets]
    legs = robot.legs
    signs = np.where(np.arange(1 << legs)[:, None] >> np.arange(legs) & 1, 1.0, -1.0)
    corners = middle[:, None] + signs[None] * half[:, None]  # (K, 2^n, n)
    moves = np.einsum("kij,kcj->kci", inverse[:, :3], corners)
    return np.asarray(norms(moves).max(axis=1))


# ------------------------------------------------------------------------------------------------------------------
# Poses of a hand-eye study, of a list: those that shrink the widest range most.
#
# About the best frames a pixel moves linearly with the frames (and the readings of uncertain poses): what a tolerance
# allows is a polytope. A pose that is not measured yet is taken to show the target where the best frames put it.

_BEYOND = 1.1  # of the least largest error: the tolerance of the ranges, unless one is given
_LOOSEST = np.tile([0.3] * 3 + [300.0] * 3, 2)  # rad and mm, of both frames: nothing beyond it is spoken of


class ChosenPose(NamedTuple):
    """A pose, and the widths (12) that ranges have with it and all chosen before: mm, then degrees, of both frames.

    `widest`: mm, the largest of them, a turn counted as what it moves at the target's distance.
    """

    name: str
    widths: Numbers
    widest: float


class NextImages(NamedTuple):
    """First-order estimates. `unseen`: poses from which the camera does not see the whole target, or sees its back."""

    tolerance: float
    reach: float
    before: ChosenPose
    chosen: tuple[ChosenPose, ...]
    unseen: Names


def next_images(
    study: HandEyeStudy,
    candidates: Mapping[str, Sequence[float]],
    count: int,
    *,
    tolerance: float | None = None,
    tell: Tell = lambda text: None,
) -> NextImages:
    """Choose `count` of the candidates (x, y, z in mm, then a quaternion, of the hand in the base).

    tolerance  px, of the ranges; default 1.1 times the least largest error

    Raises InputError for a count that is not from 1 to the number of poses that see the target, a tolerance below the
    least largest error, and studies without a classical answer.
    """
    best, whole = best_frames(study, classical_answer(study)), PixelModel(study)
    least = excess(whole, best)
    at = _BEYOND * least if tolerance is None else tolerance
    if not at > least:
        what = f"is {stated(at)} px, and no frames were found that explain the pixels to it"
        raise unusable("tolerance", what, f"give more than {at_most(least, 4)} px")
    views = {name: _view(study, best.frames, pose) for name, pose in candidates.items()}
    unseen = tuple(name for name, one in views.items() if one is None)
    shown = [(name, one, PixelModel(one)) for name, one in views.items() if one is not None]
    if not 1 <= count <= len(shown):
        what = f"is {count}, and the target is seen from {len(shown)} of {len(candidates)} poses"
        raise unusable("option --count", what, "give fewer, or more poses")
    blocks = [model.blocks(model.stated(best.frames)) for _, _, model in shown]
    # turn and place of X and F, as they are stated, by the motions of `PixelModel.moved`
    wanted, back = np.eye(PARAMETERS), best.frames.e_rotation.T
    wanted[:3, :3] = wanted[3:6, 3:6] = -back
    wanted[3:6, :3] = -back @ cross_matrix(best.frames.e_translation)
    # what the study allows, about the best frames
    slope, (low, high) = whole.jacobian(best), (side[PARAMETERS:] for side in whole.room(best))
    half = np.concatenate([_LOOSEST, 0.5 * (high - low)])
    middle = -whole(best) - slope @ np.concatenate([np.zeros(PARAMETERS), 0.5 * (high + low)])
    slack, to_x = at + np.tile(study.half_width, 2), np.eye(PARAMETERS, len(half)) * half
    allowed, reach = Polytope(slope * half, middle, slack, to_x, np.zeros(PARAMETERS)), float(whole.reach(best)[3])

    @cache
    def after(*chosen: int) -> tuple[Polytope, ChosenPose]:
        if not chosen:
            name, polytope = "", allowed
        else:
            name, one, _ = shown[chosen[-1]]
            frames, own = blocks[chosen[-1]]
            own = own * one.pose_half_width[0, : own.shape[1]]
            polytope = after(*chosen[:-1])[0].measured(frames, at + np.tile(one.half_width, 2), own)
        widths = 2.0 * polytope.ranges(wanted)[1]  # turn and place of X, F
        widest = float((widths * np.tile(np.repeat([reach, 1.0], 3), 2)).max())
        stated = np.concatenate([widths[3:6], np.degrees(widths[:3]), widths[9:], np.degrees(widths[6:9])])
        return polytope, ChosenPose(name, tuple(stated.tolist()), widest)

    def narrowed(chosen: list[int]) -> Callable[[int], Any]:
        if chosen:
            last = after(*chosen)[1]
            tell(f"{last.name}: widest range {about(last.widest)} mm")
        return lambda k: (-after(*chosen, k)[1].widest, -sum(after(*chosen, k)[1].widths))

    order = greedy(range(len(shown)), count, narrowed)
    return NextImages(at, reach, after()[1], tuple(after(*order[: n + 1])[1] for n in range(count)), unseen)


def _view(study: HandEyeStudy, frames: HandEyeFrames, pose: Sequence[float]) -> HandEyeStudy | None:
    """What the camera sees from a pose, without error; None where the target is not wholly in the image."""
    points, first = np.unique(study.points, axis=0, return_index=True)
    values = np.array(pose)
    one = replace(
        study,
        images=("next",),
        poses=Pose(values[None, :3], values[None, 3:]),
        image=np.zeros(len(points), np.intp),
        names=tuple(study.names[k] for k in first),
        pixels=np.zeros((len(points), 2)),
        points=points,
        half_width=np.full(len(points), float(study.half_width.max())),
        pose_half_width=study.pose_half_width.max(axis=0)[None],
    )
    model = PixelModel(one)
    x = model.in_camera(model.stated(frames))
    camera = study.camera
    if not (x[:, 2] > 0.0).all():
        return None
    one = replace(one, pixels=camera.project(x))
    inside = (one.pixels >= -0.5).all() and (one.pixels <= [camera.width - 0.5, camera.height - 0.5]).all()
    flat = not study.points[:, 2].any()
    if not inside or (flat and _side(one, frames)[0] != np.sign(_side(study, frames).sum())):
        return None
    return one


def _side(study: HandEyeStudy, frames: HandEyeFrames) -> Floats:
    """(n,) 1 or -1: which side of a flat target each image shows."""
    turn, shift = study.motions()
    normal = turn @ frames.f_rotation[:, 2] @ frames.e_rotation.T
    place = (turn @ frames.f_translation + shift) @ frames.e_rotation.T + frames.e_translation
    return np.asarray(np.sign(np.einsum("ni,ni->n", normal, place)))
