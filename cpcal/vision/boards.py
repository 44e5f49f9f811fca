"""Points of printed boards in an image, by OpenCV: corners of chessboards, ChArUco boards, ArUco and AprilTag grids."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cpcal.common.values import Floats, Ints
from cpcal.vision.dots import Dots, nothing
from cpcal.vision.dots.segmentation import eight_bits, grey_levels
from cpcal.vision.identify import Identification, Unidentified
from cpcal.vision.opencv import marker_dictionary, opencv
from cpcal.vision.target import Board, Target

# Standard deviation of a corner's x and of its y (pixels), by kind: what OpenCV leaves in rendered photographs with
# blur and noise (docs/images.md). The residuals say what it is in yours.
DEVIATION = {"chessboard": 0.03, "charuco": 0.05, "grid": 0.2}
FEWEST = 6  # points


def board_points(image: object, target: Target) -> tuple[Dots, Identification]:
    """The points of a printed board (`target.board`), with a stated covariance. Raises Unidentified."""
    grey, board = eight_bits(grey_levels(image)), Board.parsed(target.board)
    centers, numbers = (_chessboard if board.kind == "chessboard" else _coded)(grey, board)
    first = np.unique(numbers, return_index=True)[1]  # a marker that is in sight twice would be two places for one
    if len(numbers) < FEWEST or len(first) < len(numbers):
        why = "is not found" if len(numbers) < FEWEST else "is in sight twice"
        raise Unidentified(f"the board {target.board} {why}")
    covariance = np.tile(DEVIATION[board.kind] ** 2 * np.eye(2), (len(centers), 1, 1))
    unseen = np.setdiff1d(np.arange(len(target.dots)), numbers)
    found = Identification(np.arange(len(numbers)), numbers, np.zeros(0, dtype=np.int64), unseen, margin=len(numbers))
    return replace(nothing(False), centers=centers, covariance=covariance), found


def _chessboard(grey: Any, board: Board) -> tuple[Floats, Ints]:
    cv2 = opencv()
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY)
    centers = np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else np.zeros((0, 2))
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
    if ids is None or not len(ids):
        return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    ids, centers = np.asarray(ids, dtype=np.int64).ravel(), np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    if board.kind == "charuco":
        return centers, ids
    mine = np.repeat(ids < board.columns * board.rows, 4)
    return centers[mine], (4 * ids[:, None] + np.arange(4)).ravel()[mine]
