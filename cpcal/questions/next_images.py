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

from cpcal.calibration.frames import cross_matrix
from cpcal.common.errors import InputError, Problem
from cpcal.common.numbers import about, at_most, stated
from cpcal.common.values import Floats
from cpcal.models.hand_eye import HandEyeFrames, HandEyeStudy
from cpcal.models.hand_eye_fit import PARAMETERS, READING, PixelModel, ReadFrames, classical_answer, excess
from cpcal.questions.hand_eye import best_frames
from cpcal.robot import Pose
from cpcal.solver.linear import Dense, LinearStatus

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
    least = excess(PixelModel(study), best)
    at = _BEYOND * least if tolerance is None else tolerance
    if not at > least:
        what = f"is {stated(at)} px, and no frames were found that explain the pixels to it"
        raise InputError([Problem("tolerance", what, f"give more than {at_most(least, 4)} px")])
    shown = {name: _drawn(study, best.frames, pose, least) for name, pose in candidates.items()}
    unseen = tuple(name for name, images in shown.items() if not images)
    shown = {name: images for name, images in shown.items() if images}
    if not 1 <= count <= len(shown):
        what = f"is {count}, and the target is seen from {len(shown)} of {len(candidates)} poses"
        raise InputError([Problem("option --count", what, "give fewer, or more poses")])
    ranges = _Ranges(study, best, [image for images in shown.values() for image in images], at)
    first = {name: len(study.images) + _DRAWS * k for k, name in enumerate(shown)}  # of its images
    before = ranges.chosen("", [])
    found: list[ChosenPose] = []
    for _ in range(count):
        taken = [first[one.name] for one in found]
        tried = [ranges.chosen(name, [*taken, k]) for name, k in first.items() if k not in taken]
        found.append(min(tried, key=lambda pose: (pose.widest, sum(pose.widths))))
        tell(f"{found[-1].name}: widest range {about(found[-1].widest)} mm")
    return NextPoses(at, ranges.reach, before, tuple(found), unseen)


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
        loosest = np.tile(_LOOSEST, 2)
        scale = np.concatenate([loosest, np.maximum(high - low, 1e-9)])
        matrix, room = self._rows[np.ix_(rows, columns)] * scale, self._room[rows]
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
        for k, wanted in enumerate(self._wanted):
            for sign in (1.0, -1.0):
                objective = np.zeros(len(scale))
                objective[:PARAMETERS] = sign * wanted * loosest
                solution = engine.minimize(objective / np.abs(objective).max())
                if solution.status is not LinearStatus.OPTIMAL:
                    return np.full(PARAMETERS, np.inf)
                widths[k] -= float(objective @ solution.point)
        return widths


def _joined(studies: Sequence[HandEyeStudy]) -> HandEyeStudy:
    """All their images as one study."""
    first = np.cumsum([0, *(len(one.images) for one in studies)])
    return HandEyeStudy(
        setup=studies[0].setup,
        camera=studies[0].camera,
        images=tuple(name for one in studies for name in one.images),
        poses=Pose(
            np.concatenate([one.poses.position for one in studies]),
            np.concatenate([one.poses.quaternion for one in studies]),
        ),
        image=np.concatenate([one.image + k for one, k in zip(studies, first, strict=False)]),
        names=tuple(name for one in studies for name in one.names),
        **{name: np.concatenate([getattr(one, name) for one in studies]) for name in _ARRAYS},
    )


_ARRAYS = ("pixels", "points", "half_width", "pose_half_width")


def _as_stated(frames: HandEyeFrames) -> Floats:
    """(12, 12): turn and place of X and F, as they are stated, by the motions of `PixelModel.moved`."""
    back = frames.e_rotation.T
    found = np.zeros((12, 12))
    found[:3, :3] = -back
    found[3:6, :3] = -back @ cross_matrix(frames.e_translation)
    found[3:6, 3:6] = -back
    found[6:, 6:] = np.eye(6)
    return found
