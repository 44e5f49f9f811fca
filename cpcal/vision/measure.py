"""The whole chain for one image: dots, identification, pose; or the reason why there is no pose."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpcal.common.errors import CpcalError, InputError
from cpcal.common.values import Floats, Indices, Ints, floats
from cpcal.robot import Pose
from cpcal.vision.camera import Camera
from cpcal.vision.dots import Dots, nothing, populations, refitted
from cpcal.vision.dots.segmentation import eight_bits, grey_levels
from cpcal.vision.files.image_file import UnreadableImageError
from cpcal.vision.identify import FEWEST as FEWEST_DOTS
from cpcal.vision.identify import Identification, Unidentified, identify, turned
from cpcal.vision.opencv import Grey, marker_dictionary, opencv
from cpcal.vision.pose import DOUBTFUL, NoPose, PoseEstimate, estimate_pose
from cpcal.vision.pose import FEWEST as FEWEST_POINTS
from cpcal.vision.target import Board, Target

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
        return np.asarray(self.identification.numbers[~self.estimate.outliers], np.intp)

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


# ------------------------------------------------------------------------------------------------------------------
# Points of printed boards, by OpenCV: corners of chessboards, ChArUco boards, ArUco and AprilTag grids.

# Standard deviation of a corner's x and of its y (pixels), by kind: what OpenCV leaves in rendered photographs with
# blur and noise (docs/images.md). The residuals say what it is in yours.
DEVIATION = {"chessboard": 0.03, "charuco": 0.05, "grid": 0.2}


def board_points(image: object, target: Target) -> tuple[Dots, Identification]:
    """The points of a printed board (`target.board`), with a stated covariance. Raises Unidentified."""
    grey, board = eight_bits(grey_levels(image)), Board.parsed(target.board)
    centers, numbers = (_chessboard if board.kind == "chessboard" else _coded)(grey, board)
    first = np.unique(numbers, return_index=True)[1]  # a marker that is in sight twice would be two places for one
    if len(numbers) < FEWEST_POINTS or len(first) < len(numbers):
        why = "is not found" if len(numbers) < FEWEST_POINTS else "is in sight twice"
        raise Unidentified(f"the board {target.board} {why}")
    covariance = np.tile(DEVIATION[board.kind] ** 2 * np.eye(2), (len(centers), 1, 1))
    unseen = np.setdiff1d(np.arange(len(target.dots)), numbers)
    found = Identification(np.arange(len(numbers)), numbers, np.zeros(0, np.int64), unseen, margin=len(numbers))
    return replace(nothing(False), centers=centers, covariance=covariance), found


def _chessboard(grey: Any, board: Board) -> tuple[Floats, Ints]:
    cv2 = opencv()
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY)
    centers = floats(corners).reshape(-1, 2) if found else np.zeros((0, 2))
    return centers, np.arange(len(centers))


def _coded(grey: Any, board: Board) -> tuple[Floats, Ints]:
    """Of a ChArUco board its inner corners, of a grid its markers' own."""
    aruco, size, dictionary = opencv().aruco, (board.columns, board.rows), marker_dictionary(board.dictionary)
    if board.kind == "charuco":
        printed = aruco.CharucoBoard(size, board.lengths[0], board.lengths[1], dictionary)
        corners, ids, *_ = aruco.CharucoDetector(printed).detectBoard(grey)
    else:
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
        corners, ids, _ = aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    if ids is None:
        return np.zeros((0, 2)), np.zeros(0, np.int64)
    numbers = np.asarray(ids, np.int64)
    if board.kind == "grid":
        numbers = 4 * numbers.reshape(-1, 1) + np.arange(4)
    mine = numbers.ravel() < len(board.dots)
    return floats(corners).reshape(-1, 2)[mine], numbers.ravel()[mine]
