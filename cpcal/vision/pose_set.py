"""Guaranteed pose sets: all poses that show the dots of a target within stated boxes of pixels.

What is assumed of the image: the centre of each dot i listed, projected with the distortion, lies in the box
`lo_i <= pixel <= hi_i`. (Measured centres are those of ellipses: take `unbiased_boxes`.) Camera and target are exact, the
numbers that their floats are. The pose set is

    { (P, R) : for every i, dot i is in front of the camera, in its field of view, and its pixel is in box i }

and with `outliers` = q the larger set of poses for which this holds for all dots but at most q of them. `enclose_pose` gives a
box that is proved to hold the set, wherever it is: rotation and position are not restricted beforehand.

Three stages, each an outer enclosure of all that is left: viewing pyramids instead of pixels (`pyramid`), a first box by
linear programs in the homography (`homography`), then the constraints themselves, polynomials in position and rotation
(`pose_rows`), contracted by the general solver until the box no longer shrinks.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal import plugins
from cpcal.errors import InputError, Problem
from cpcal.interfaces import Contractor, Verdict
from cpcal.interval import Box, IntervalArray
from cpcal.robot.kinematics import Pose
from cpcal.robot.robot import frozen_array
from cpcal.robot.rotation import quaternion_from_matrix
from cpcal.solver import Network
from cpcal.vision.camera import Camera
from cpcal.vision.enclosed import exact, rotation
from cpcal.vision.homography import Motions, first_motions
from cpcal.vision.pose_rows import Frames, PoseBox, pose_box, pose_rows
from cpcal.vision.pyramid import Pyramids, pyramids
from cpcal.vision.target import Target

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

CONTRACTORS = ("lifted",)
_PASSES = 8
_PAYS = 0.98  # a further pass is made where some width shrinks below this share
_HALF_TURN = "the rotation is known too badly"


@dataclass(frozen=True, eq=False)
class PixelBoxes:
    """Where dots of a target are in an image.

    numbers  (m,) of the dots in the target, each once
    lo, hi   (m, 2) pixels: the projection of dot `numbers[i]` is stated to lie in lo[i] <= pixel <= hi[i]

    Raises InputError when the arrays make no boxes.
    """

    numbers: Indices
    lo: Array
    hi: Array

    def __post_init__(self) -> None:
        numbers = np.array(self.numbers, dtype=np.intp)
        numbers.setflags(write=False)
        object.__setattr__(self, "numbers", numbers)
        object.__setattr__(self, "lo", frozen_array(self.lo))
        object.__setattr__(self, "hi", frozen_array(self.hi))
        shape = (len(numbers), 2) if numbers.ndim == 1 else None
        if shape is None or self.lo.shape != shape or self.hi.shape != shape:
            what = f"have shapes {numbers.shape}, {self.lo.shape} and {self.hi.shape}"
            raise InputError([Problem("pixel boxes", what, "give numbers (m,), lo (m, 2) and hi (m, 2)")])
        good = (self.lo <= self.hi).all(axis=1) & np.isfinite(self.lo).all(axis=1) & np.isfinite(self.hi).all(axis=1)
        problems = [
            Problem(f"pixel box {k}", "has no points, or infinitely many", "give finite lo <= hi")
            for k in np.flatnonzero(~good)
        ]
        if len(np.unique(numbers)) < len(numbers):
            problems.append(Problem("pixel boxes", "name a dot twice", "give one box for each dot"))
        if problems:
            raise InputError(problems)

    @classmethod
    def around(cls, numbers: npt.ArrayLike, centers: npt.ArrayLike, half_width: npt.ArrayLike) -> PixelBoxes:
        """`center +- half_width`, pixels: centers (m, 2), half_width a number, (2,), (m, 1) or (m, 2), >= 0."""
        middle = np.asarray(centers, dtype=np.float64)
        try:
            radius = np.broadcast_to(np.asarray(half_width, dtype=np.float64), middle.shape)
        except ValueError:
            what = f"is {np.shape(half_width)} for centres {middle.shape}"
            raise InputError([Problem("half_width", what, "give one number, or one for each coordinate")]) from None
        if not bool((radius >= 0.0).all()):
            raise InputError([Problem("half_width", "is negative or NaN", "give pixels >= 0")])
        boxes = IntervalArray.around(middle, radius)
        return cls(np.asarray(numbers, dtype=np.intp), boxes.lo, boxes.hi)

    def __len__(self) -> int:
        return len(self.numbers)


@dataclass(frozen=True, eq=False)
class PoseSet:
    """What is proved of the poses that show the dots in their pixel boxes.

    PROVED   all of them have |P - pose.position| <= position_radius and R = R(1, s) R(pose.quaternion) with
             |2 s| <= rotation_radius, componentwise, in exact arithmetic on these floats: the reading set of a campaign.
             Whether there is one at all is not said.
    REFUTED  there is none: pose and radii are None
    UNKNOWN  nothing bounded was proved, for the `reason` told

    pose      of the mobile frame in the base frame of `frames`: of the target in the camera frame if none were given
    outliers  how many dots may lie outside their boxes
    refuted   numbers of dots that are outside for every pose of the set: outliers for sure
    seconds   that it took
    """

    verdict: Verdict
    pose: Pose | None
    position_radius: Array | None
    rotation_radius: Array | None
    frames: Frames
    outliers: int = 0
    refuted: tuple[int, ...] = ()
    reason: str = ""
    seconds: float = 0.0

    @property
    def status(self) -> str:
        """A sentence."""
        but = f" but at most {self.outliers}" if self.outliers else ""
        if self.verdict is Verdict.PROVED:
            return f"All poses that show all dots{but} in their pixel boxes are enclosed: proved."
        if self.verdict is Verdict.REFUTED:
            return f"No pose shows all dots{but} in their pixel boxes: proved."
        return f"Nothing is proved: {self.reason}."

    def __contains__(self, pose: Pose) -> bool:
        """Whether a pose (of exact floats) is proved to lie in the enclosure."""
        if self.pose is None or self.position_radius is None or self.rotation_radius is None:
            return False
        motion = Motions(rotation(pose.quaternion), exact(pose.position))
        found = pose_box(motion, self.pose)
        if found is None:
            return False
        near = (found.position.mag <= self.position_radius).all()
        return bool(near and (2.0 * found.half_turn.mag <= self.rotation_radius).all())


@dataclass(frozen=True)
class View:
    """What the stages need: m dots of the target, their pyramids, and the frames."""

    dots: Array
    pyramids: Pyramids
    frames: Frames
    points: IntervalArray  # (m, 3) in the mobile frame
    contractor: Callable[[Network], Contractor]

    def part(self, chosen: Indices) -> View:
        """Of some of the dots."""
        seen = Pyramids(self.pyramids.planes[chosen], self.pyramids.lo[chosen], self.pyramids.hi[chosen])
        return View(self.dots[chosen], seen, self.frames, self.points[chosen], self.contractor)


def enclose_pose(
    boxes: PixelBoxes,
    target: Target,
    camera: Camera,
    *,
    frames: Frames | None = None,
    outliers: int = 0,
    contractors: tuple[str, ...] = CONTRACTORS,
    certificate: str | os.PathLike[str] | None = None,
) -> PoseSet:
    """A box that is proved to hold every pose that shows all dots but at most `outliers` in their pixel boxes.

    `frames` are exact motions: then the poses are those of the mobile frame in the base frame, which is where the
    box's axes are. `certificate` names a file for the proof of the last stage (see `cpcal.vision.pose_certificate`);
    there is none with outliers.

    Raises InputError for boxes that are not of this target, or that show nothing of the camera's field of view.
    """
    begin = time.perf_counter()
    frames = frames or Frames()
    _check(boxes, target, outliers, certificate is not None)
    dots = target.dots[boxes.numbers]
    points = frames.in_mobile(target.points[boxes.numbers])
    view = View(dots, pyramids(camera, boxes.lo, boxes.hi), frames, points, contractor_of(contractors))
    refuted: Indices = np.zeros(0, dtype=np.intp)
    if outliers:
        from cpcal.vision.robust_pose_set import enclosed_but

        found, refuted = enclosed_but(view, outliers)
    else:
        found = enclosed(view)
        if certificate is not None:
            from cpcal.vision.pose_certificate import write_certificate

            write_certificate(certificate, view, found)
    told = (frames, outliers, tuple(int(k) for k in np.sort(boxes.numbers[refuted])))
    if isinstance(found, PoseBox):
        radii = frozen_array(found.position.mag), frozen_array(2.0 * found.half_turn.mag)
        return PoseSet(Verdict.PROVED, found.center, *radii, *told, "", time.perf_counter() - begin)
    verdict, reason = (Verdict.REFUTED, "") if found is None else (Verdict.UNKNOWN, found)
    return PoseSet(verdict, None, None, None, *told, reason, time.perf_counter() - begin)


def contractor_of(names: Sequence[str]) -> Callable[[Network], Contractor]:
    """What makes the named contractors, one after the other, for any network; the names are looked up once."""
    factories = [plugins.load(name) for name in names]

    def build(network: Network) -> Contractor:
        parts = [factory(network, objective=None, arithmetic="float64") for factory in factories]
        return plugins.composed(parts, names)

    return build


def enclosed(view: View) -> PoseBox | str | None:
    """All poses that satisfy all of a view, about their middle; None: there are none; a text: why nothing is known."""
    start = first_box(view)
    return contracted(view, start) if isinstance(start, PoseBox) else start


def first_box(view: View) -> PoseBox | str | None:
    """From the homography alone."""
    motions = first_motions(view.dots, view.pyramids, view.contractor)
    if not isinstance(motions, Motions):
        return motions
    moved = view.frames.mobile_in_base(motions)
    left, _, right = np.linalg.svd(moved.rotation.mid)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return pose_box(moved, Pose(moved.position.mid, quaternion_from_matrix(turn))) or _HALF_TURN


def contracted(view: View, box: PoseBox) -> PoseBox | str | None:
    """What the constraints leave of a box, about its new middle."""
    for _ in range(_PASSES):
        before = box.unknowns
        after = one_pass(view, box, before)
        if after.is_empty:
            return None
        narrower = box.with_unknowns(after)
        moved = narrower.about(narrower.middle)
        if moved is None:
            return _HALF_TURN
        box = moved
        if not (after.width < _PAYS * before.width).any():
            break
    return box


def one_pass(view: View, box: PoseBox, unknowns: Box) -> Box:
    """The contractors, once, on the box of (W, s)."""
    rows = pose_rows(view.pyramids.planes, view.points, view.frames, box.center, unknowns)
    return view.contractor(rows.network(unknowns)).contract(unknowns).box


def _check(boxes: PixelBoxes, target: Target, outliers: int, certified: bool) -> None:
    problems = [
        Problem(f"pixel box of dot {k}", f"{target.name!r} has dots 0 to {len(target.dots) - 1}", "number dots from 0")
        for k in boxes.numbers[(boxes.numbers < 0) | (boxes.numbers >= len(target.dots))]
    ]
    if outliers < 0:
        problems.append(Problem("outliers", f"is {outliers}", "give a number of dots >= 0"))
    if outliers and certified:
        problems.append(Problem("certificate", "none can be written with outliers", "leave one of both out"))
    if problems:
        raise InputError(problems)
