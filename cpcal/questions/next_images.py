"""Which poses to measure next: those of a list that shrink the widest range most.

First-order estimates, not proofs: about the best frames a pixel moves linearly with the frames (and the readings of
uncertain poses), so the ranges of the parameters at a tolerance are linear programs. A pose that is not measured yet is
taken to show the target where the best frames put it, with errors that are drawn as large as those of the study; what
counts is the mean over a few draws, the same for all poses. The poses are chosen one after another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import about, at_most, stated
from cpcal.common.values import Floats
from cpcal.models.hand_eye import PARAMETERS, HandEyeFrames, HandEyeStudy, ReadFrames, ReadingModel, cross, read_study
from cpcal.models.hand_eye_fit import classical_answer, excess
from cpcal.questions.hand_eye import best_frames
from cpcal.robot import Pose
from cpcal.solver.linear import Dense, LinearStatus

_BEYOND = 1.1  # of the least largest error: the tolerance of the ranges, unless one is given
_DRAWS = 3
_LOOSEST = np.array([0.3] * 3 + [300.0] * 3)  # rad and mm: ranges beyond it count as unknown

Tell = Callable[[str], None]
_Image = tuple[HandEyeStudy, ReadFrames]  # of a pose that is not measured yet


@dataclass(frozen=True)
class ChosenPose:
    """A pose, and the widths (12) that ranges have with it and all chosen before: mm, then degrees, of both frames.

    `widest`: mm, the largest of them, a turn counted as what it moves at the target's distance.
    """

    name: str
    widths: tuple[float, ...]
    widest: float


@dataclass(frozen=True)
class NextPoses:
    """First-order estimates. `unseen`: poses from which the camera does not see the whole target, or sees its back."""

    tolerance: float
    reach: float
    before: ChosenPose
    chosen: tuple[ChosenPose, ...]
    unseen: tuple[str, ...]


def next_poses(
    study: HandEyeStudy,
    candidates: Mapping[str, Sequence[float]],
    count: int,
    *,
    tolerance: float | None = None,
    tell: Tell = lambda text: None,
) -> NextPoses:
    """Choose `count` of the candidates (x, y, z in mm, then a quaternion, of the hand in the base).

    tolerance  px, of the ranges; default 1.1 times the least largest error

    Raises InputError for a count that is not from 1 to the number of poses that see the target, a tolerance below the
    least largest error, and studies without a classical answer.
    """
    best = best_frames(study, classical_answer(study))
    least = excess(ReadingModel(study), best)
    at = _BEYOND * least if tolerance is None else tolerance
    if not at > least:
        what = f"is {stated(at)} px, and no frames were found that explain the pixels to it"
        raise InputError([Problem("tolerance", what, f"give more than {at_most(least, 4)} px")])
    ranges = _Ranges(study, best, at)
    shown = {name: _drawn(study, best, pose, least) for name, pose in candidates.items()}
    unseen = tuple(name for name, images in shown.items() if not images)
    shown = {name: images for name, images in shown.items() if images}
    if not 1 <= count <= len(shown):
        what = f"is {count}, and the target is seen from {len(shown)} of {len(candidates)} poses"
        raise InputError([Problem("option --count", what, "give fewer, or more poses")])
    before = ranges.chosen("", [[]])
    found: list[ChosenPose] = []
    taken: list[list[_Image]] = [[] for _ in range(_DRAWS)]
    for _ in range(count):
        left = [name for name in shown if name not in {one.name for one in found}]
        with_it = {name: [[*had, new] for had, new in zip(taken, shown[name], strict=True)] for name in left}
        tried = [ranges.chosen(name, draws) for name, draws in with_it.items()]
        one = min(tried, key=lambda pose: (pose.widest, sum(pose.widths)))
        tell(f"{one.name}: widest range {about(one.widest)} mm")
        found.append(one)
        taken = with_it[one.name]
    return NextPoses(at, ranges.reach, before, tuple(found), unseen)


def _drawn(study: HandEyeStudy, best: ReadFrames, pose: Sequence[float], error: float) -> list[_Image]:
    """Images from a pose, with drawn errors of pixels and pose; none where the target is not wholly seen."""
    one = _view(study, best.frames, pose)
    if one is None:
        return []
    random, found = np.random.default_rng(0), []
    for _ in range(_DRAWS):
        reading = random.uniform(-1.0, 1.0, (1, 6)) * one.pose_half_width
        x = best.frames.in_camera(read_study(one, reading))
        if not (x[:, 2] > 0.0).all():
            return []
        pixels = one.camera.project(x) + random.uniform(-error, error, one.pixels.shape)
        found.append((replace(one, pixels=pixels), ReadFrames(best.frames, reading)))
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
    x = frames.in_camera(one)
    camera = study.camera
    if not (x[:, 2] > 0.0).all():
        return None
    pixels = camera.project(x)
    inside = (pixels >= -0.5).all() and (pixels <= [camera.width - 0.5, camera.height - 0.5]).all()
    if not inside or (study.planar and _side(one, frames)[0] != np.sign(_side(study, frames).sum())):
        return None
    return one


def _side(study: HandEyeStudy, frames: HandEyeFrames) -> Floats:
    """(n,) 1 or -1: which side of a flat target each image shows."""
    turn, shift = study.motions
    normal = turn @ frames.f_rotation[:, 2] @ frames.e_rotation.T
    place = (turn @ frames.f_translation + shift) @ frames.e_rotation.T + frames.e_translation
    return np.asarray(np.sign(np.einsum("ni,ni->n", normal, place)))


class _Ranges:
    """The linear programs of a study about its best frames."""

    def __init__(self, study: HandEyeStudy, best: ReadFrames, tolerance: float) -> None:
        self.study, self.best, self.tolerance = study, best, tolerance
        self.uncertain = bool(study.pose_half_width.any())
        self.reach = float(np.linalg.norm(best.frames.in_camera(study), axis=1).mean())
        self.wanted = _as_stated(best.frames)  # (12, 12)
        self._kept = self._rows(study, best)

    def _rows(self, study: HandEyeStudy, at: ReadFrames) -> tuple[Floats, Floats, Floats, Floats]:
        """Rows `matrix d <= room` of the pixels, and bounds of the readings."""
        model = ReadingModel(study)
        slope, residuals = model.jacobian(at), model(at)
        low, high = model.room(at)
        if not self.uncertain:
            slope, low, high = slope[:, :PARAMETERS], low[:PARAMETERS], high[:PARAMETERS]
        room = self.tolerance + np.tile(study.half_width, 2)
        rows = np.concatenate([slope, -slope]), np.concatenate([room - residuals, room + residuals])
        return *rows, low[PARAMETERS:], high[PARAMETERS:]

    def chosen(self, name: str, draws: Sequence[Sequence[_Image]]) -> ChosenPose:
        """The mean widths over draws of some more images."""
        widths = np.mean([self._with(more) for more in draws], axis=0)  # turn and place of X, then of F
        counted = widths * np.tile(np.repeat([self.reach, 1.0], 3), 2)
        stated = np.concatenate([widths[3:6], np.degrees(widths[:3]), widths[9:], np.degrees(widths[6:9])])
        return ChosenPose(name, tuple(stated.tolist()), float(counted.max()))

    def _with(self, more: Sequence[_Image]) -> Floats:
        parts = [self._kept, *(self._rows(*one) for one in more)]
        readings = sum(len(part[2]) for part in parts)
        matrix = np.zeros((sum(len(part[0]) for part in parts), PARAMETERS + readings))
        row, column = 0, PARAMETERS
        for slope, *_ in parts:
            own = slope.shape[1] - PARAMETERS
            matrix[row : row + len(slope), :PARAMETERS] = slope[:, :PARAMETERS]
            matrix[row : row + len(slope), column : column + own] = slope[:, PARAMETERS:]
            row, column = row + len(slope), column + own
        return self._widths(matrix, *(np.concatenate([part[k] for part in parts]) for k in (1, 2, 3)))

    def _widths(self, matrix: Floats, room: Floats, low: Floats, high: Floats) -> Floats:
        loosest = np.tile(_LOOSEST, 2)
        scale = np.concatenate([loosest, np.maximum(high - low, 1e-9)])
        matrix = matrix * scale
        size = np.abs(matrix).max(axis=1)
        engine = Dense()
        ends = np.ones(PARAMETERS)
        engine.load(
            matrix / size[:, None],
            room / size,
            np.concatenate([-ends, low / scale[PARAMETERS:]]),
            np.concatenate([ends, high / scale[PARAMETERS:]]),
        )
        widths = np.zeros(PARAMETERS)
        for k, wanted in enumerate(self.wanted):
            for sign in (1.0, -1.0):
                objective = np.zeros(len(scale))
                objective[:PARAMETERS] = sign * wanted * loosest
                solution = engine.minimize(objective / np.abs(objective).max())
                if solution.status is not LinearStatus.OPTIMAL:
                    return np.full(PARAMETERS, np.inf)
                widths[k] -= float(objective @ solution.point)
        return widths


def _as_stated(frames: HandEyeFrames) -> Floats:
    """(12, 12): turn and place of X and F, as they are stated, by the motions of `cpcal.models.hand_eye.moved`."""
    back = frames.e_rotation.T
    found = np.zeros((12, 12))
    found[:3, :3] = -back
    found[3:6, :3] = -back @ cross(frames.e_translation[None])[0]
    found[3:6, 3:6] = -back
    found[6:, 6:] = np.eye(6)
    return found
