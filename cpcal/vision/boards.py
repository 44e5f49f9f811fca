"""Points of printed boards in an image, by OpenCV: corners of chessboards, ChArUco boards, ArUco and AprilTag grids."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cpcal.common.errors import unusable
from cpcal.common.values import Floats, Ints
from cpcal.vision.dots import Dots, nothing
from cpcal.vision.dots.segmentation import eight_bits, grey_levels
from cpcal.vision.identify import Identification, Unidentified
from cpcal.vision.opencv import opencv
from cpcal.vision.target import TEXTS, Board, Target

# Standard deviation of a corner's x and of its y (pixels), by kind: what OpenCV leaves in rendered photographs with
# blur and noise (docs/images.md). The residuals say what it is in yours.
DEVIATION = {"chessboard": 0.03, "charuco": 0.05, "grid": 0.2}
FEWEST = 6  # points


def dictionary_of(board: Board) -> Any:
    """OpenCV's dictionary of markers. Raises InputError."""
    aruco, name = opencv().aruco, "DICT_" + board.dictionary.removeprefix("DICT_")
    if not hasattr(aruco, name):
        raise unusable("target", f"has the dictionary {board.dictionary!r:.40}", f"give {TEXTS}")
    return aruco.getPredefinedDictionary(getattr(aruco, name))


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
    count = board.columns * board.rows if found else 0
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2)[:count] if found else np.zeros((0, 2)), np.arange(count)


def _coded(grey: Any, board: Board) -> tuple[Floats, Ints]:
    """Of a ChArUco board its inner corners, of a grid its markers' own."""
    aruco, size, dictionary = opencv().aruco, (board.columns, board.rows), dictionary_of(board)
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


def dark_squares(board: Board) -> Floats:
    """What is black on a printed board: x, y of the upper left corner and side (m, 3), mm; none of a circle grid."""
    nodes, side = board.nodes(board.columns, board.rows), board.lengths[0]
    if board.kind == "grid":
        return _markers(board, sum(board.lengths) * nodes, side)
    if board.kind == "charuco":
        dark, inner = nodes.sum(axis=1) % 2.0 == 0.0, board.lengths[1]
        markers = _markers(board, side * nodes[~dark] + 0.5 * (side - inner), inner)
        return np.concatenate([np.column_stack([side * nodes[dark], np.full(dark.sum(), side)]), markers])
    if board.kind == "chessboard":
        nodes = board.nodes(board.columns + 1, board.rows + 1)
        nodes = nodes[nodes.sum(axis=1) % 2.0 == 1.0] - 1.0
        return np.column_stack([side * nodes, np.full(len(nodes), side)])
    return np.zeros((0, 3))


def _markers(board: Board, corners: Floats, side: float) -> Floats:
    """The dark bits of the first markers of a dictionary, at their upper left corners (n, 2)."""
    dictionary, out = dictionary_of(board), []
    count = dictionary.markerSize + 2  # a border of one bit all around
    for number, corner in enumerate(corners):
        bits = opencv().aruco.generateImageMarker(dictionary, number, count)
        rows, columns = np.nonzero(bits == 0)
        places = corner + side / count * np.column_stack([columns, rows])
        out.append(np.column_stack([places, np.full(len(places), side / count)]))
    return np.concatenate(out)
