"""Which poses to measure next: for a certified platform, and for a hand-eye study.

First-order estimates in floating point, not proofs. The candidates are chosen one after another: each time the one that
helps most beside those that were chosen before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from cpcal.calibration import LegEquations
from cpcal.calibration.frames import cross_matrix
from cpcal.common.errors import unusable
from cpcal.common.numbers import about, at_most, stated
from cpcal.common.values import Floats
from cpcal.models import PLAIN, ModelResiduals, reading_moves
from cpcal.models.hand_eye import HandEyeFrames, HandEyeStudy
from cpcal.models.hand_eye_fit import PARAMETERS, READING, PixelModel, ReadFrames, classical_answer, excess
from cpcal.models.leg_set import CertifiedSet
from cpcal.models.platform import pose_inverse
from cpcal.questions.hand_eye import best_frames
from cpcal.robot import (
    Campaign,
    Pose,
    Robot,
    inverse_kinematics,
    normalised,
    pose_jacobian,
    rotation_vector,
)
from cpcal.solver.linear import Dense, LinearStatus


def greedy(candidates: Sequence[int], count: int, gain: Callable[[list[int]], Callable[[int], Any]]) -> list[int]:
    """`count` of the candidates; `gain(chosen)` gives what each other one would bring beside those chosen."""
    chosen: list[int] = []
    for _ in range(min(count, len(candidates))):
        chosen.append(max((k for k in candidates if k not in chosen), key=gain(chosen)))
    return chosen


def extremes(rows: Floats, rhs: Floats, low: Floats, high: Floats, objectives: Floats) -> Floats:
    """(2, K): the least and the largest value of each objective over {low <= y <= high : rows @ y <= rhs}; nan where
    the linear program fails."""
    engine = Dense()
    engine.load(rows, rhs, low, high)
    ends = np.full((2, len(objectives)), np.nan)
    for k, objective in enumerate(objectives):
        size = np.abs(objective).max() or 1.0
        for side, sign in enumerate((1.0, -1.0)):
            found = engine.minimize(sign * objective / size)
            if found.status is LinearStatus.OPTIMAL:
                ends[side, k] = objective @ found.point
    return ends


# ------------------------------------------------------------------------------------------------------------------
# Poses of a platform: those where the certified sets leave a length open most.
#
# Near the controller's parameters a leg's set is a polytope, one slab for each measurement. The pose whose own length
# ranges widest over it, in units of what a new measurement would leave open, is chosen; its slab is added (about the
# middle of the range, where the reading is expected), and so on. What is expected is the worst bound to first order.

_CANDIDATES, _DRAWN = 40, 400  # of so many drawn
_LOOSER = 1.0 + 1e-9  # of the slabs, so that rounding leaves a point in them


@dataclass(frozen=True)
class NextPose:
    """A pose that would narrow what is not known most, and the worst bound expected then, mm: an estimate."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    expected: float


@dataclass
class Polytope:
    """{y in [-1, 1]^7 : |rows @ y - middle| <= slack} for one leg; parameters are controller + to_x @ y + offset."""

    rows: Floats
    middle: Floats
    slack: Floats
    to_x: Floats
    offset: Floats

    @staticmethod
    def about(campaign: Campaign, one: CertifiedSet) -> Polytope:
        """The controller's parameters."""
        model = ModelResiduals(campaign, one.leg, PLAIN)  # of the measurements that the set holds
        to_x, offset = one.basis * np.maximum(one.along.rad, 1e-12), one.basis @ one.along.mid
        jacobian = model.jacobian(one.controller)
        slack = one.eps + reading_moves(campaign, one.leg, one.controller).sum(axis=1)
        middle = -model.values(one.controller) - jacobian @ offset
        return Polytope(jacobian @ to_x, middle, np.maximum(slack, 1e-9), to_x, offset)

    def ranges(self, forms: Floats) -> tuple[Floats, Floats]:
        """Middles and half-widths (m,) of linear forms (m, 7) in the parameters."""
        matrix, slack = np.concatenate([self.rows, -self.rows]), self.slack * _LOOSER
        rhs, objectives = np.concatenate([self.middle + slack, slack - self.middle]), forms @ self.to_x
        low, high = extremes(matrix, rhs, -np.ones(7), np.ones(7), objectives)
        widest = np.abs(objectives).sum(axis=1)
        low, high = np.where(np.isnan(low), -widest, low), np.where(np.isnan(high), widest, high)
        return 0.5 * (low + high) + forms @ self.offset, 0.5 * np.abs(high - low)

    def measured(self, form: Floats, slack: float) -> Polytope:
        """With one measurement more, whose reading is in the middle of what is expected."""
        middle = float(self.ranges(form[None])[0][0]) - form @ self.offset
        return replace(
            self,
            rows=np.concatenate([self.rows, (form @ self.to_x)[None]]),
            middle=np.append(self.middle, middle),
            slack=np.append(self.slack, slack),
        )


def next_poses(
    campaign: Campaign,
    sets: Sequence[CertifiedSet],
    polytopes: Sequence[Polytope],
    worst: Pose,
    count: int,
    *,
    held: Sequence[int] = (),
    seed: int = 1,
) -> tuple[NextPose, ...]:
    """`count` poses by certified width; `worst` (K) are poses whose bound matters.

    Candidates lie between two measured poses each, within the readings that the campaign has. () where none do.
    """
    robot = Robot.from_parameters("controller", np.stack([one.controller for one in sets]))
    random = np.random.default_rng(seed)
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
        return [one.measured(form[i], float(slacks[i])) for i, one in enumerate(before)]

    def width(chosen: list[int]) -> Callable[[int], Any]:
        widths = np.stack([one.ranges(forms[:, i])[1] for i, one in enumerate(after(*chosen))], axis=1)
        gain: list[float] = (widths / slacks).max(axis=1).tolist()
        return gain.__getitem__

    out, order = list[NextPose](), greedy(range(len(forms)), count, width)
    for n, k in enumerate(order, 1):
        expected = float(attained(robot, after(*order[:n]), sets, worst, held).max())
        x, y, z = candidates.position[k].tolist()
        a, b, c = rotation_vector(candidates.quaternion[k]).tolist()
        out.append(NextPose((x, y, z), (a, b, c), expected))
    return tuple(out)


def leg_changes(robot: Robot, poses: Pose) -> Floats:
    """(K, n, 7): how a leg's predicted reading changes with its parameters."""
    return LegEquations(poses.position, poses.rotation, inverse_kinematics(robot, poses)).by_parameters(
        robot.parameters
    )


def attained(
    robot: Robot,
    polytopes: Sequence[Polytope],
    sets: Sequence[CertifiedSet],
    poses: Pose,
    held: Sequence[int] = (),
) -> Floats:
    """(K,) mm: how far, to first order, some parameters of the sets and errors up to eps move the platform."""
    forms, inverse = leg_changes(robot, poses), pose_inverse(pose_jacobian(robot, poses), held)
    ranges = [p.ranges(forms[:, i]) for i, p in enumerate(polytopes)]
    middle = np.stack([r[0] for r in ranges], axis=1)
    half = np.stack([r[1] + one.eps for r, one in zip(ranges, sets, strict=True)], axis=1)
    legs = robot.legs
    signs = np.where(np.arange(1 << legs)[:, None] >> np.arange(legs) & 1, 1.0, -1.0)
    corners = middle[:, None] + signs[None] * half[:, None]  # (K, 2^n, n)
    moves = np.einsum("kij,kcj->kci", inverse[:, :3], corners)
    return np.asarray(np.linalg.norm(moves, axis=-1).max(axis=1))


# ------------------------------------------------------------------------------------------------------------------
# Poses of a hand-eye study, of a list: those that shrink the widest range most.
#
# About the best frames a pixel moves linearly with the frames (and the readings of uncertain poses), so the ranges of
# the parameters at a tolerance are linear programs. A pose that is not measured yet is taken to show the target where
# the best frames put it, with errors that are drawn as large as those of the study; what counts is the mean over a few
# draws, the same for all poses.

_BEYOND = 1.1  # of the least largest error: the tolerance of the ranges, unless one is given
_DRAWS = 3
_LOOSEST = np.array([0.3] * 3 + [300.0] * 3)  # rad and mm: ranges beyond it count as unknown

Tell = Callable[[str], None]
_Image = tuple[HandEyeStudy, Floats]  # of a pose that is not measured yet, and the reading (1, 6) of it


@dataclass(frozen=True)
class ChosenPose:
    """A pose, and the widths (12) that ranges have with it and all chosen before: mm, then degrees, of both frames.

    `widest`: mm, the largest of them, a turn counted as what it moves at the target's distance.
    """

    name: str
    widths: tuple[float, ...]
    widest: float


@dataclass(frozen=True)
class NextImages:
    """First-order estimates. `unseen`: poses from which the camera does not see the whole target, or sees its back."""

    tolerance: float
    reach: float
    before: ChosenPose
    chosen: tuple[ChosenPose, ...]
    unseen: tuple[str, ...]


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
    best = best_frames(study, classical_answer(study))
    least = excess(PixelModel(study), best)
    at = _BEYOND * least if tolerance is None else tolerance
    if not at > least:
        what = f"is {stated(at)} px, and no frames were found that explain the pixels to it"
        raise unusable("tolerance", what, f"give more than {at_most(least, 4)} px")
    shown = {name: _drawn(study, best.frames, pose, least) for name, pose in candidates.items()}
    unseen = tuple(name for name, images in shown.items() if not images)
    shown = {name: images for name, images in shown.items() if images}
    if not 1 <= count <= len(shown):
        what = f"is {count}, and the target is seen from {len(shown)} of {len(candidates)} poses"
        raise unusable("option --count", what, "give fewer, or more poses")
    ranges = _Ranges(study, best, [image for images in shown.values() for image in images], at)
    names, first = list(shown), range(len(study.images), len(study.images) + _DRAWS * len(shown), _DRAWS)
    after = cache(lambda *chosen: ranges.chosen(names[chosen[-1]] if chosen else "", [first[k] for k in chosen]))

    def narrowed(chosen: list[int]) -> Callable[[int], Any]:
        if chosen:
            tell(f"{after(*chosen).name}: widest range {about(after(*chosen).widest)} mm")
        return lambda k: (-after(*chosen, k).widest, -sum(after(*chosen, k).widths))

    order = greedy(range(len(names)), count, narrowed)
    found = [after(*order[: n + 1]) for n in range(count)]
    return NextImages(at, ranges.reach, after(), tuple(found), unseen)


def _drawn(study: HandEyeStudy, frames: HandEyeFrames, pose: Sequence[float], error: float) -> list[_Image]:
    """Images from a pose, with drawn errors of pixels and pose; none where the target is not wholly seen."""
    one = _view(study, frames, pose)
    if one is None:
        return []
    random, model, found = np.random.default_rng(0), PixelModel(one), list[_Image]()
    for _ in range(_DRAWS):
        reading = random.uniform(-1.0, 1.0, (1, 6)) * one.pose_half_width
        x = model.in_camera(ReadFrames(frames, reading))
        if not (x[:, 2] > 0.0).all():
            return []
        pixels = one.camera.project(x) + random.uniform(-error, error, one.pixels.shape)
        found.append((replace(one, pixels=pixels), reading))
    return found


def _view(study: HandEyeStudy, frames: HandEyeFrames, pose: Sequence[float]) -> HandEyeStudy | None:
    """What the camera sees from a pose, without error; None where the target is not wholly in the image."""
    points, first = np.unique(study.points, axis=0, return_index=True)
    values = np.array(pose)
    one = replace(
        study,
        images=("next",),
        poses=Pose(values[None, :3], values[None, 3:]),
        image=np.zeros(len(points), dtype=np.intp),
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
    pixels = camera.project(x)
    inside = (pixels >= -0.5).all() and (pixels <= [camera.width - 0.5, camera.height - 0.5]).all()
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


class _Ranges:
    """The linear programs of a study, and of images that may come to it, about its best frames."""

    def __init__(self, study: HandEyeStudy, best: ReadFrames, more: Sequence[_Image], tolerance: float) -> None:
        whole = _joined([study, *(one for one, _ in more)])
        at = ReadFrames(best.frames, np.concatenate([best.readings, *(reading for _, reading in more)]))
        model = PixelModel(whole)
        slope, residuals, room = model.jacobian(at), model(at), tolerance + np.tile(whole.half_width, 2)
        self._rows = np.concatenate([slope, -slope])
        self._room = np.concatenate([room - residuals, room + residuals])
        self._low, self._high = model.room(at)
        self._image, self._measured = np.tile(whole.image, 4), np.arange(len(study.images))
        self.reach = float(PixelModel(study).reach(best)[3])
        self._wanted = _as_stated(best.frames)  # (12, 12)

    def chosen(self, name: str, more: Sequence[int]) -> ChosenPose:
        """The mean widths over draws of some more images, each given by the number of its first draw."""
        draws = range(_DRAWS if more else 1)
        widths = np.mean([self._widths([k + draw for k in more]) for draw in draws], axis=0)  # turn and place of X, F
        counted = widths * np.tile(np.repeat([self.reach, 1.0], 3), 2)
        stated = np.concatenate([widths[3:6], np.degrees(widths[:3]), widths[9:], np.degrees(widths[6:9])])
        return ChosenPose(name, tuple(stated.tolist()), float(counted.max()))

    def _widths(self, more: Sequence[int]) -> Floats:
        images = np.append(self._measured, more).astype(np.intp)
        own = PARAMETERS + READING * images[:, None] + np.arange(READING)
        columns = np.append(np.arange(PARAMETERS), own[own < self._rows.shape[1]])
        rows = np.flatnonzero(np.isin(self._image, images))
        low, high = self._low[columns[PARAMETERS:]], self._high[columns[PARAMETERS:]]
        loosest, ends = np.tile(_LOOSEST, 2), np.ones(PARAMETERS)
        scale = np.concatenate([loosest, np.maximum(high - low, 1e-9)])
        matrix = self._rows[np.ix_(rows, columns)] * scale
        size = np.abs(matrix).max(axis=1)
        objectives = np.zeros((PARAMETERS, len(scale)))
        objectives[:, :PARAMETERS] = self._wanted * loosest
        least, most = extremes(
            matrix / size[:, None],
            self._room[rows] / size,
            np.concatenate([-ends, low / scale[PARAMETERS:]]),
            np.concatenate([ends, high / scale[PARAMETERS:]]),
            objectives,
        )
        widths = most - least
        return np.full(PARAMETERS, np.inf) if np.isnan(widths).any() else widths


def _joined(studies: Sequence[HandEyeStudy]) -> HandEyeStudy:
    """All their images as one study."""
    first = np.cumsum([0, *(len(one.images) for one in studies)])
    return replace(
        studies[0],
        images=tuple(name for one in studies for name in one.images),
        poses=Pose(
            np.concatenate([one.poses.position for one in studies]),
            np.concatenate([one.poses.quaternion for one in studies]),
        ),
        image=np.concatenate([one.image + k for one, k in zip(studies, first, strict=False)]),
        names=tuple(name for one in studies for name in one.names),
        pixels=np.concatenate([one.pixels for one in studies]),
        points=np.concatenate([one.points for one in studies]),
        half_width=np.concatenate([one.half_width for one in studies]),
        pose_half_width=np.concatenate([one.pose_half_width for one in studies]),
    )


def _as_stated(frames: HandEyeFrames) -> Floats:
    """(12, 12): turn and place of X and F, as they are stated, by the motions of `PixelModel.moved`."""
    back = frames.e_rotation.T
    found = np.zeros((12, 12))
    found[:3, :3] = -back
    found[3:6, :3] = -back @ cross_matrix(frames.e_translation)
    found[3:6, 3:6] = -back
    found[6:, 6:] = np.eye(6)
    return found
