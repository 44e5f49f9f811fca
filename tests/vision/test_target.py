"""Targets as values: what makes one, the default one, and the boards that people have."""

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.vision.files.plate_and_camera import load_target
from cpcal.vision.files.target_print import dark_squares
from cpcal.vision.opencv import opencv
from cpcal.vision.target import Board, Target

ROW = np.array([[0.0, 0.0], [10.0, 10.0], [30.0, 30.0], [45.0, 45.0], [0.0, 20.0]])


def problems(**changed):
    values = {"name": "t", "dots": ROW, "radius": 2.0} | changed
    with pytest.raises(InputError) as caught:
        Target(**values)
    return [(p.where, p.what) for p in caught.value.problems]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"dots": np.zeros((3, 3))}, "two finite numbers"),
        ({"dots": np.array([[0.0, np.nan]])}, "two finite numbers"),
        ({"dots": np.zeros(4)}, "two finite numbers"),
        ({"radius": 0.0}, "is 0"),
        ({"dots": np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 0.0]])}, "0 and 2 are in the same place"),
        ({"dots": np.array([[0.0, 0.0], [1e308, 0.0]])}, "no plate is so large"),
        ({"radius": np.nan}, "is nan"),
        ({"radius": np.inf}, "is inf"),
        ({"board": "acircles:7x11:10:8"}, "has not 5 dots"),
    ],
)
def test_what_is_no_target_is_refused_with_the_reason(changed, said):
    assert any(said in what for _, what in problems(**changed))


@pytest.mark.parametrize("text", ["charuco:6x5:36:24:4X4_50", "grid:3x2:36:6:4X4_50"])
def test_what_is_printed_is_what_opencv_prints(text):
    """Six bits a marker: pixels of a millimetre."""
    cv2, board = opencv(), Board.parsed(text)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    made = (cv2.aruco.CharucoBoard if board.kind == "charuco" else cv2.aruco.GridBoard)(
        (board.columns, board.rows), *board.lengths, dictionary
    )
    size = (216, 180) if board.kind == "charuco" else (120, 78)
    own = np.full(size[::-1], 255, dtype=np.uint8)
    for x, y, side in np.rint(dark_squares(board)).astype(int).tolist():
        own[y : y + side, x : x + side] = 0
    assert (own == made.generateImage(size)).mean() > 0.999


@pytest.mark.parametrize(
    "text",
    [
        "chessboard:8x6", "charuco:5x7:40:30", "grid:2x2:30:-1:4X4_50", "brick:2x2:1", "chessboard:1x6:30",
        "circles:7x7:20", "acircles:7x11:10:nan", "chessboard:100x100:1", "circles:7x7:20:8:4X4_50",
    ],
)  # fmt: skip
def test_texts_that_name_no_board_are_refused(text):
    with pytest.raises(InputError, match="acircles:COLUMNSxROWS:PITCH:DIAMETER"):
        load_target(text)
