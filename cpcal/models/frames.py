"""Hand-eye as a model: its rows in stages, each on the box that the one before left, and the certificates of these.

1. `image`: the board's pose in single images, from their pixels alone. No frames and no robot enter.
2. `links`: poses of images and frames together, tied by the robot's poses and what these may be off.
3. `places`: the pixels of the board's middle and the frames but for the target's turn, which they do not depend on,
   where the robot's poses are exact. Its programs are small: the camera's turn may be halved often.
4. `frames`: the pixels of all images and the frames, where the robot's poses are exact.

The checker derives the rows from the study (`cpcal.checker.frames`); here the same numbers become arrays for linear
programs, and what these propose is proved by the checker's rule.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from fractions import Fraction as F
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cpcal.checker import FORMAT
from cpcal.checker.frames import E_, EQUATIONS, F_, R_F, R_X, SIZE, T_F, T_X, Rows, Study, asked_box
from cpcal.checker.rule import Box
from cpcal.common.numbers import at_most
from cpcal.common.values import Floats, norms
from cpcal.models.hand_eye import HandEyeFrames, HandEyeStudy, study_json
from cpcal.robot import normalised, quaternion_from_matrix, rotation_matrix
from cpcal.solver.certificate.exact_network import number
from cpcal.solver.certificate.prover import Contracted, Descent, System, write_steps

Tell = Callable[[str], None]
_ROTATIONS = (*R_X, *R_F)
_SPREAD, _UNCERTAIN = 9, 24  # images whose poses are bounded: where the robot's poses are exact, and where not
_FEWEST = 3
_IMPLIED = (1, 2, 4, 7, 8, 10)  # of a rotation's equations: right angles, which cost columns and say nothing new
_BOXES, _FEW_BOXES = 256, 32  # where halves are sought; where their hull goes on
COARSE = 0.5  # an entry of a rotation's matrix that is wider leaves its turn open
_NARROW = COARSE / 2.0  # of the camera's: the board's middle alone bounds it to that
_GAIN = 0.05  # share of the widths that a pass must take away; of large programs and in many boxes more


@dataclass(frozen=True)
class PlacedFrames:
    """The camera in the hand (eye in hand) or base frame, and the target in the base (eye in hand) or hand frame.

    Positions in mm, quaternions scalar first; float64 numbers that are taken as exact. Raises ValueError for frames
    that are none.
    """

    camera_position: tuple[float, float, float]
    camera_quaternion: tuple[float, float, float, float]
    target_position: tuple[float, float, float]
    target_quaternion: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        for quaternion in (self.camera_quaternion, self.target_quaternion):
            if not 0.1 < math.hypot(*quaternion) < 10.0:  # nor NaN
                raise ValueError("a quaternion is of no rotation")

    @property
    def numbers(self) -> tuple[F, ...]:
        """The 14 that the checker takes."""
        return tuple(F(v) for part in astuple(self) for v in part)

    @property
    def frames(self) -> HandEyeFrames:
        """E and F, in float64."""
        turn = rotation_matrix(normalised(self.camera_quaternion)).T
        target = rotation_matrix(normalised(self.target_quaternion))
        return HandEyeFrames(turn, -turn @ np.array(self.camera_position), target, np.array(self.target_position))

    @staticmethod
    def of(frames: HandEyeFrames, given: Floats | None = None) -> PlacedFrames:
        """With positions between the ends `given` (2, 8)."""
        turn = frames.e_rotation.T
        camera, target = -turn @ frames.e_translation, frames.f_translation
        if given is not None:
            camera, target = np.clip(camera, *given[:, :3]), np.clip(target, *given[:, 4:7])
        parts = camera, quaternion_from_matrix(turn), target, quaternion_from_matrix(frames.f_rotation)
        return PlacedFrames(*(tuple(part.tolist()) for part in parts))


def exact(values: Any) -> tuple[F, ...]:
    return tuple(F(float(v)) for v in values)


def exact_study(study: HandEyeStudy) -> Study:
    """As the checker reads it."""
    return Study(
        study.setup == "eye-in-hand", exact(study.camera.focal), exact(study.camera.center), study.images,
        tuple(zip(map(exact, study.poses.position), map(exact, study.poses.quaternion), strict=True)),
        tuple(map(exact, study.pose_half_width)), tuple(study.image.tolist()), study.names,
        tuple(map(exact, study.rays)), tuple(map(exact, study.points)), exact(study.half_width),
    )  # fmt: skip


class Proof(NamedTuple):
    """What is proved at a tolerance: `left` (30 unknowns) holds all frames that explain the pixels; None: there are
    none.

    `certificate` is the last of its `files`, None where none is needed; `poses` are those of images that it rests on,
    and `sets` what they claim; `last`: sides and numbers of the rows of its last step; `timed`: a time limit ended the
    search.
    """

    eps: float
    left: Box | None
    certificate: str | None
    poses: tuple[str, ...] = ()
    sets: Mapping[int, tuple[Any, Any]] = {}
    files: Mapping[str, tuple[dict[str, Any], Contracted]] = {}
    last: tuple[tuple[str, int], ...] = ()
    programs: int = 0
    timed: bool = False

    @property
    def refuted(self) -> bool:
        return self.left is None

    @property
    def open(self) -> bool:
        """Whether frames may be turned any way."""
        left = self.left
        return left is not None and any(left.hi[i] - left.lo[i] >= COARSE for i in _ROTATIONS)

    def write(self, folder: Path | None) -> None:
        """The certificate, and all that it rests on."""
        for name, (header, found) in self.files.items():
            if folder is not None:
                write_steps(folder / name, header, found.left, found.steps)


class Prover:
    """Proves what a study allows in the box of frames about a center (14 numbers); `near`: some that fit."""

    def __init__(
        self, study: HandEyeStudy, center: Sequence[F], reach: float, angle: float | None, near: HandEyeFrames,
        tell: Tell,
    ) -> None:  # fmt: skip
        self.study, self.tell = study, tell
        self.exact = exact_study(study)
        self.digest = sha256(study_json(study)).hexdigest()
        # the origins: a point in the middle of the board, so that its pixels say nothing of the target's turn, and
        # where it is in the mean of the images
        off = study.points - 0.5 * (study.points.min(axis=0) + study.points.max(axis=0))
        middle = study.points[np.argmin(norms(off).round(6))]
        turn, shift = study.motions()
        mean = (turn @ (near.f_rotation @ middle + near.f_translation) + shift).mean(axis=0)
        self.hand, self.board = exact(np.round(mean * 8.0) / 8.0), exact(middle)
        far, turned = F(reach), None if angle is None else F(angle)
        known = [(name, F(low), F(high)) for name, low, high in study.known]
        self.root = asked_box(tuple(center), far, turned, known, self.hand, self.board)
        self.asked: dict[str, Any] = {
            "center": list(map(number, center)),
            "reach": number(far),
            "angle": turned and number(turned),
            "hand": list(map(number, self.hand)),
            "board": list(map(number, self.board)),
        }
        if known:
            self.asked["known"] = [[name, number(low), number(high)] for name, low, high in known]

    def over(
        self, name: str, images: Sequence[int], eps: float, end: float = math.inf, wide: Proof | None = None,
        coarse: float = 0.0,
    ) -> Proof:  # fmt: skip
        """Contract the box until nothing is left or it gets no smaller; no image and no pass begins after `end`.

        Of one image its pixels alone count, whatever the robot's poses are. From where the proof `wide` of these images
        at a larger tolerance ended only its last stage is done again, in halves that leave nothing, or whose turns are
        bounded to within `coarse`.
        """
        uncertain, before, sets = self.exact.uncertain, Proof(eps, self.root, None), dict[int, tuple[Any, Any]]()
        if len(images) == 1:
            return self._proof(f"{name}-image-{images[0] + 1}", "image", before, eps, images, math.inf)
        if wide is not None and wide.left is not None and eps <= wide.eps:
            stage, seen, boxes = ("links", sorted(wide.sets), 1) if uncertain else ("frames", images, _BOXES)
            return self._proof(name, stage, wide, eps, seen, end, boxes, coarse)
        for k in spread(self.study, images, _UNCERTAIN if uncertain else _SPREAD):
            if len(sets) >= _FEWEST and time.monotonic() > end:
                break
            one = self.over(name, [k], eps)
            self.tell(f"{self.study.images[k]} alone: {'no pose is left' if one.refuted else 'its pose is bounded'}")
            if one.left is None:
                return one
            if one.certificate is not None:
                sets[k] = one.left.lo, one.left.hi
                before = before._replace(
                    sets=sets, poses=(*before.poses, one.certificate), files={**before.files, **one.files},
                    programs=before.programs + one.programs,
                )  # fmt: skip
        if sets or uncertain:
            linked = name if uncertain else f"{name}-links"
            before = self._proof(linked, "links", before, eps, sorted(sets) or images, end)
        if before.open and not uncertain:
            placed = self._proof(f"{name}-places", "places", before, eps, images, end, _FEW_BOXES, _NARROW)
            if placed.left is not None and all(placed.left.hi[i] - placed.left.lo[i] >= COARSE for i in R_X):
                # which bounds next to nothing less, and needs no check; all pixels say nothing yet
                return before._replace(programs=placed.programs, timed=placed.timed)
            before = placed
        if before.refuted or uncertain:
            return before
        return self._proof(name, "frames", before, eps, images, end)

    def _proof(
        self, name: str, stage: str, before: Proof, eps: float, images: Sequence[int], end: float, boxes: int = 1,
        coarse: float = 0.0,
    ) -> Proof:  # fmt: skip
        """One stage, in the box and with the poses of images that a proof before it left."""
        assert before.left is not None
        of = "frames" if stage == "places" else stage
        rows = Rows(self.exact, of, images, F(eps), self.hand, self.board, before.sets, before.left)
        rows.tags = {(side, k): None for side, k in rows.tags if side[:4] != "turn" or k % EQUATIONS not in _IMPLIED}

        def lifted(i: int, j: int) -> bool:
            """Poses of images are known so well that their products with the frames' rotations need no columns."""
            return stage != "links" or (i in _ROTATIONS and j in _ROTATIONS) or (i in R_X and j in E_)

        def say(box: Box | None) -> None:
            if stage == "image":
                return
            width = None if box is None else max(float(box.hi[i] - box.lo[i]) / 2 for i in _ROTATIONS)
            self.tell(f"{stage}: {'nothing is left' if width is None else f'rotations +-{at_most(width, 2)}'}")

        columns: dict[str, tuple[Any, ...]] = {
            "image": ((range(12),), range(9)),
            "links": (((*_ROTATIONS, *T_X, *E_, *F_),), _ROTATIONS, T_F),
            "places": (((*R_X, *E_, *F_),), R_X, (), R_F),
            "frames": ((R_F, (*R_X, *E_, *F_)), _ROTATIONS, (*T_F, *T_X)),
        }
        gain = _GAIN * (2.0 if coarse or stage == "links" else 1.0 if boxes == 1 else 4.0)
        system = System(rows, lifted, *columns[stage])
        first = System(rows, lifted, *columns["places"]) if stage == "frames" and boxes > 1 else None
        found = Descent(system, gain, boxes, coarse, end=end, tell=say, first=first).over(rows.root)
        header = {
            "format": FORMAT, "study": self.digest, "stage": of, "images": list(images), "eps": number(eps),
            "asked": self.asked, "after": before.certificate, "poses": list(before.poses),
        }  # fmt: skip
        file = f"{name}.cert.jsonl" if found.steps or stage != "image" else None
        left = None if found.left is None else Box(found.left.lo[:SIZE], found.left.hi[:SIZE])
        files = {**before.files, **({} if file is None else {file: (header, found)})}
        programs, timed = before.programs + found.programs, before.timed or found.timed
        last = tuple((side, k) for side, k, *_ in found.steps[-1].get("rows", ())) if found.steps else ()
        return Proof(eps, left, file, before.poses, before.sets, files, last, programs, timed)


def spread(study: HandEyeStudy, images: Sequence[int], count: int) -> list[int]:
    """So many of the images, each in turn the one whose pose is farthest from those chosen before."""
    if len(images) <= count:
        return list(images)
    turn = study.motions()[0][list(images)].reshape(len(images), 9)
    place = study.poses.position[list(images)]
    place = place / max(float(np.ptp(place, axis=0).max()), 1e-9)
    where = np.concatenate([turn, place], axis=1)
    chosen = [0]
    gap = norms(where - where[0])
    while len(chosen) < count:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, norms(where - where[chosen[-1]]))
    return sorted(images[k] for k in chosen)
