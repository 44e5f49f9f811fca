"""Guaranteed pose sets: all poses that show the dots of a target within stated boxes of pixels.

What is assumed of the image: for each dot i listed the projection of its centre, or, with `PixelBoxes.of_images`, the
centre of its image as it is measured, lies in the box `lo_i <= pixel <= hi_i`; dots are in the field of view and at
least 40 of their radii in front of the camera. What is assumed of camera and target: their numbers are in stated sets
(`CameraSet`, `TargetSet`), or are the floats given. The pose set is

    { (P, R) : for some camera and some target of these sets, for every i, the pixel of dot i is in box i }

and with `outliers` = q the larger set of poses for which this holds for all dots but at most q of them. `enclose_pose`
gives a box that is proved to hold the set, wherever it is: rotation and position are not restricted beforehand, but for
a distance of one kilometre.

Three stages, each an outer enclosure of all that is left: viewing pyramids instead of pixels (`pyramid`, `bias`), a
first box by linear programs in the homography (`motion_rows`), then the constraints themselves, polynomials in position
and rotation (`pose_rows`), contracted by the general solver until the box no longer shrinks.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats, Indices, frozen_array
from cpcal.robot import Campaign, Pose, Robot
from cpcal.solver.contract import Verdict
from cpcal.vision.camera import Camera
from cpcal.vision.pose_sets.enclosed import Frames, Motions, PoseBox, exact, pose_box, rotation
from cpcal.vision.pose_sets.pose_certificate import write_certificate
from cpcal.vision.pose_sets.pose_enclosure import Found, View, contractor_of, enclosed, enclosed_but
from cpcal.vision.pose_sets.sight import PixelBoxes, Sight
from cpcal.vision.pose_sets.uncertain import CameraSet, TargetSet
from cpcal.vision.target import Target

__all__ = ["Frames", "PixelBoxes", "PoseSet", "enclose_pose"]

CONTRACTORS = ("lifted",)


@dataclass(frozen=True, eq=False)
class PoseSet:
    """What is proved of the poses that show the dots in their pixel boxes.

    PROVED   all of them have |P - pose.position| <= position_radius and R = R(1, s) R(pose.quaternion) with
             |2 s| <= rotation_radius, componentwise, in exact arithmetic on these floats: the reading set of a
             campaign. Whether there is one at all is not said.
    REFUTED  there is none: pose and radii are None
    UNKNOWN  nothing bounded was proved, for the `reason` told

    pose      of the mobile frame in the base frame of `frames`: of the target in the camera frame if none were given
    outliers  how many dots may lie outside their boxes
    refuted   numbers of dots that are outside for every pose of the set: outliers for sure
    seconds   that it took
    """

    verdict: Verdict
    pose: Pose | None
    position_radius: Floats | None
    rotation_radius: Floats | None
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


def enclose_pose(
    boxes: PixelBoxes,
    target: Target | TargetSet,
    camera: Camera | CameraSet,
    *,
    frames: Frames | None = None,
    outliers: int = 0,
    contractors: tuple[str, ...] = CONTRACTORS,
    certificate: str | os.PathLike[str] | None = None,
    sources: Mapping[str, bytes] | None = None,
) -> PoseSet:
    """A box that is proved to hold every pose that shows all dots but at most `outliers` in their pixel boxes.

    `target` and `camera` are exact, or the sets that they are known to be in. `frames` are exact motions: then the
    poses are those of the mobile frame in the base frame, which is where the box's axes are. `certificate` is a path
    without its ends: PATH.pose.json states all of this with the box, and PATH.1.cert.jsonl and so on prove it (at most
    3 outliers); the box is then the one that was certified. `sources` are the bytes of the files that pixels, camera
    and target came from, by name, whose SHA-256 the claim states.

    Raises InputError for boxes that are not of this target, or that show nothing of the camera's field of view,
    ModelError where no certificate can be made.
    """
    begin = time.perf_counter()
    frames = frames or Frames()
    targets = TargetSet.of(target)
    _check(boxes, targets.target, outliers)
    view = View(Sight(boxes, targets, CameraSet.of(camera), frames), contractor_of(contractors))
    refuted: Indices = np.zeros(0, dtype=np.intp)
    if outliers:
        found, refuted = enclosed_but(view, outliers)
    else:
        found = enclosed(view)
    if certificate is not None:
        found = write_certificate(Path(certificate), view, found, outliers, sources)
    elif isinstance(found, PoseBox):
        found = view.sight.with_scale(found)
    wrong = tuple(int(k) for k in np.sort(boxes.numbers[refuted]))
    return _pose_set(found, frames, outliers, wrong, time.perf_counter() - begin)


def _pose_set(found: Found, frames: Frames, outliers: int, refuted: tuple[int, ...], seconds: float) -> PoseSet:
    if isinstance(found, PoseBox):
        radii = frozen_array(found.position.mag), frozen_array(2.0 * found.half_turn.mag)
        return PoseSet(Verdict.PROVED, found.center, *radii, frames, outliers, refuted, "", seconds)
    verdict, reason = (Verdict.REFUTED, "") if found is None else (Verdict.UNKNOWN, found)
    return PoseSet(
        verdict=verdict,
        pose=None,
        position_radius=None,
        rotation_radius=None,
        frames=frames,
        outliers=outliers,
        refuted=refuted,
        reason=reason,
        seconds=seconds,
    )


def _check(boxes: PixelBoxes, target: Target, outliers: int) -> None:
    problems = [
        Problem(f"pixel box of dot {k}", f"{target.name!r} has dots 0 to {len(target.dots) - 1}", "number dots from 0")
        for k in boxes.numbers[(boxes.numbers < 0) | (boxes.numbers >= len(target.dots))]
    ]
    if outliers < 0:
        problems.append(Problem("outliers", f"is {outliers}", "give a number of dots >= 0"))
    if problems:
        raise InputError(problems)


# ------------------------------------------------------------------------------------------------------------------
# Campaigns whose reading sets come from pixels: a guaranteed pose set for every row instead of 3 sigma.

# a page of such a campaign shows it among the campaign's provenance
NOT_ON_THE_PAGE = "checked by `cpcal verify` of their folder, from pixels on; the check on this page begins after them"


def campaign_of(
    sets: Sequence[PoseSet],
    lengths: npt.ArrayLike,
    robot: Robot,
    *,
    length_radius: npt.ArrayLike = 0.0,
    pose: Sequence[str] | None = None,
    run: Sequence[str] | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Campaign:
    """The campaign of N pose sets of the mobile frame in the base frame, and leg readings (N, n) mm.

    Row k states |P - P_k| <= p and |2 s| <= r with half-widths of its own, which hold the pose set of image k: what is
    certified of the campaign is true of every robot whose poses show the dots in their pixel boxes and whose leg
    readings are off by at most `length_radius` (broadcast to (N, n) mm). The frames were exact: what is not known of
    them (hand-eye calibration) is not in the sets. What the campaign's certificates and pages check begins at these
    boxes, not at the pixels; its `provenance` says so.

    Raises InputError for sets that are not proved, for frames that differ, and for what makes no campaign.
    """
    problems = [
        Problem(f"pose set {k}", one.status, "leave the image out, or give wider pixel boxes")
        for k, one in enumerate(sets)
        if one.pose is None
    ]
    if any(one.frames != sets[0].frames for one in sets):
        problems.append(Problem("pose sets", "have different frames", "enclose all with the same Frames"))
    if problems:
        raise InputError(problems)
    poses = [one.pose for one in sets if one.pose is not None]
    return Campaign.of(
        robot,
        np.array([one.position for one in poses]),
        np.array([one.quaternion for one in poses]),
        lengths,
        pose=pose,
        run=run,
        position_radius=np.array([one.position_radius for one in sets]),
        rotation_radius=np.array([one.rotation_radius for one in sets]),
        length_radius=length_radius,
        exact=length_radius is None,
        provenance={"pose sets": NOT_ON_THE_PAGE, **(provenance or {})},
    )
