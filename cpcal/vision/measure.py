"""The whole chain for one image: dots, identification, pose; or the reason why there is no pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.errors import CpcalError, InputError
from cpcal.common.values import Floats, Indices
from cpcal.robot import Pose
from cpcal.vision.boards import DEVIATION, board_points
from cpcal.vision.camera import Camera
from cpcal.vision.dots import Dots, populations, refitted
from cpcal.vision.files.image_file import UnreadableImageError
from cpcal.vision.identify import FEWEST as FEWEST_DOTS
from cpcal.vision.identify import Identification, Unidentified, identify, turned
from cpcal.vision.opencv import Grey
from cpcal.vision.pose import DOUBTFUL, NoPose, PoseEstimate, estimate_pose
from cpcal.vision.pose import FEWEST as FEWEST_POINTS
from cpcal.vision.target import Target

FEWEST = 20  # dots of the target
RESIDUAL = 0.1  # pixels: a larger rms says that camera, target or identification is wrong


class NotMeasured(CpcalError):
    """An image shows no pose that could be relied on. Its text is the reason."""


REFUSED = (UnreadableImageError, NotMeasured, Unidentified, InputError)  # what an image without a pose raises


def reason_of(error: Exception) -> str:
    """Why, in a row of a table."""
    return "; ".join(one.what for one in error.problems) if isinstance(error, InputError) else str(error)


@dataclass(frozen=True, eq=False)
class MeasuredImage:
    """A pose of the target in the camera frame, and all that it came from.

    dots            what was found in the image
    identification  which of the dots are the target's
    estimate        pose, covariance, residuals; its m dots are those of the identification, in its order
    """

    dots: Dots
    identification: Identification
    estimate: PoseEstimate

    @property
    def pose(self) -> Pose:
        return self.estimate.pose

    @property
    def numbers(self) -> Indices:
        """(m,) of the target's dots that the pose rests on."""
        return np.asarray(self.identification.numbers[~self.estimate.outliers], dtype=np.intp)

    @property
    def centers(self) -> Floats:
        """(m, 2) pixels, of these dots."""
        return self.dots.centers[self.identification.found[~self.estimate.outliers]]

    @property
    def doubt(self) -> str:
        """Why the pose may be off by more than is stated; "" when nothing says so."""
        if self.estimate.scale <= DOUBTFUL:
            return ""
        return (
            f"the residuals are {np.sqrt(self.estimate.scale):.1f} times as large as stated: "
            "check the camera's calibration, the target's dots and whether the plate is flat"
        )


def measure_pose(
    image: Grey,
    target: Target,
    camera: Camera,
    camera_covariance: Floats | None = None,
    *,
    near: Pose | None = None,
    first_row: str | Pose = "",
) -> MeasuredImage:
    """The pose that an image (height, width) or (height, width, 3), 8 or 16 bits, of the camera shows.

    `camera_covariance` (9, 9) as a calibration states it; left out: the camera is exact. A camera or a target that is
    not as stated can move the pose by much more than is stated: `doubt` says so. `near` is a pose that may be near the
    true one, as that of the image before. It saves time, and changes no answer: what it leads to passes the same tests.
    `first_row` tells how a target is turned that looks the same when it is: see `turned`.

    Raises NotMeasured with the reason for an image without a reliable pose, and InputError for what is no image.
    """
    shape = np.shape(image)
    if len(shape) >= 2 and shape[1::-1] != (camera.width, camera.height):  # else the next station says what an image is
        raise NotMeasured(
            f"the image is {shape[1]} x {shape[0]} pixels, the camera's images are {camera.width} x {camera.height}"
        )
    dots, identification = points_in(image, target, camera, near)
    try:
        identification = turned(identification, dots.centers, target, first_row, camera)
    except Unidentified as reason:
        raise NotMeasured(f"not identified: {reason}") from None
    mine, fewest = identification.found, min(FEWEST, max(len(target.dots) // 2, FEWEST_POINTS))
    if len(mine) < fewest:
        raise NotMeasured(f"{len(mine)} dots of the target are too few: at least {fewest} are needed")
    try:
        seen = dots.centers[mine], dots.covariance[mine], identification.numbers
        estimate = estimate_pose(*seen, target, camera, camera_covariance)
    except NoPose as reason:
        raise NotMeasured(f"no pose: {reason}") from reason
    limit = max(RESIDUAL, 3.0 * DEVIATION.get(target.board.partition(":")[0], 0.0))
    if estimate.rms > limit:
        raise NotMeasured(
            f"the residuals are {estimate.rms:.3f} pixels (rms), more than {limit:g}: "
            "the camera or the target is not as stated"
        )
    return MeasuredImage(dots, identification, estimate)


def points_in(
    image: Grey, target: Target, camera: Camera | None, near: Pose | None = None
) -> tuple[Dots, Identification]:
    """The points of a target that an image shows: of dots the first population that is the target, turned in any way in
    which it looks the same. Without a camera an ordinary lens is allowed for; `near` as in `measure_pose`.

    Raises NotMeasured for what is said of the largest population, and InputError.
    """
    try:
        if target.printed:
            return board_points(image, target)
        guess = None if near is None else np.column_stack([near.rotation[:, :2], near.position])
        why, most = Unidentified(f"0 dots are too few: at least {FEWEST_DOTS} are needed"), -1
        for dots in populations(image, bright=target.bright):
            try:
                pairs = identify(dots.centers, target, camera, size=(image.shape[1], image.shape[0]), near=guess)
                return refitted(image, dots, pairs.found), pairs
            except Unidentified as refusal:
                if len(dots) > most:
                    why, most = refusal, len(dots)
        raise why
    except Unidentified as reason:
        raise NotMeasured(f"not identified: {reason}") from None
