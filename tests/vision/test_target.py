"""Targets: what makes one, boards that people have; target.toml byte for byte, problems with line and remedy."""

from dataclasses import replace

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.vision.files.plate_and_camera import load_target, save_target
from cpcal.vision.files.target_print import dark_squares
from cpcal.vision.opencv import opencv
from cpcal.vision.target import DELTALAB_TARGET, Board, Target, target_from
from tests.refusals import refused

ROW = np.array([[0.0, 0.0], [10.0, 10.0], [30.0, 30.0], [45.0, 45.0], [0.0, 20.0]])


def problems(**changed):
    values = {"name": "t", "dots": ROW, "radius": 2.0} | changed
    with pytest.raises(InputError) as caught:
        Target(**values)
    return [(p.where, p.what) for p in caught.value.problems]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        *(
            ({"dots": dots}, "two finite numbers")
            for dots in (np.zeros((3, 3)), np.array([[0.0, np.nan]]), np.zeros(4))
        ),
        *(({"radius": radius}, f"is {radius:g}") for radius in (0.0, np.nan, np.inf)),
        ({"dots": np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 0.0]])}, "0 and 2 are in the same place"),
        ({"dots": np.array([[0.0, 0.0], [1e308, 0.0]])}, "no plate is so large"),
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


TOML = """\
format = "cpcal-target/2"

[target]
name = "five"
bright = false
radius = 2.5
dots = [[0, 0], [10, 10], [30, 30.0], [45, 45], [0, 20]]

[provenance]
printed = "by hand"
"""


@pytest.mark.parametrize(
    "target",
    [
        DELTALAB_TARGET,
        replace(target_from("acircles:4x3:20:12"), bright=True, dot_sigma=0.02),
        target_from("charuco:5x4:40:30:4X4_50"),
        Target('name with "quotes", \\ and \n a break', np.array([[1 / 3, -1e-17], [1e6, 2.0]]), 1e-3, bright=False),
    ],
)
def test_what_is_saved_is_loaded_and_saved_again_byte_for_byte(tmp_path, target):
    path = tmp_path / "target.toml"
    save_target(target, path)
    first = path.read_bytes()
    path.write_bytes(first + b'\n[provenance]\n"made by" = "the test"\n')
    assert load_target(path) == target
    save_target(load_target(path), path)
    assert path.read_bytes() == first
    assert [p.name for p in tmp_path.iterdir()] == ["target.toml"]


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("scale = 0", "scale is 0"),
        ("scale = -1.0", "scale is -1"),
        ("scale_sigma = 0.5", "scale_sigma is 0.5"),
        ("scale_sigma = -1e-5", "scale_sigma holds the negative number -1e-05"),
        ("dot_sigma = 30.0", "dot_sigma is 30"),
        ('dot_sigma = "0.01"', "dot_sigma holds '0.01', which is not a number"),
    ],
)
def test_deviations_that_cannot_be_are_refused_at_their_line(tmp_path, line, what):
    assert refused(load_target, tmp_path / "target.toml", TOML.replace("radius", f"{line}\nradius")) == [(6, what)]


def test_every_problem_is_said_at_once_with_its_line(tmp_path):
    text = TOML.replace('"five"', "5").replace("false", '"no"').replace("2.5", "-2.5")
    text = text.replace("[10, 10]", "[10, nan]").replace("[30, 30.0]", "[30]").replace("printed", "[unknown]\nprinted")
    assert refused(load_target, tmp_path / "target.toml", text) == [
        (10, "unknown key 'unknown'"),
        (4, "name is 5, not text"),
        (6, "radius is -2.5"),
        (7, "row 1 of dots holds nan"),
        (7, "row 2 of dots has 1 numbers, not 2"),
        (5, "bright is 'no'"),
    ]


@pytest.mark.parametrize(
    ("old", "new", "problems"),
    [
        ("radius = 2.5", "radius = 0", [(6, "radius is 0")]),
        ("radius = 2.5", "radius = 1e-300", [(6, "radius is 1e-300")]),
        ("[0, 20]", "[10, 10]", [(7, "dots 1 and 4 are in the same place")]),
        ("[0, 20]", "[10, 15]", [(7, "dots 1 and 4 are 5 mm apart and overlap")]),
        ("[0, 20]", "[0, 1e11]", [(7, "dots place dot 4 at (0, 1e+11): no plate is so large")]),
        ("radius =", 'board = "acircles:7x11:10:8"\nradius =', [(6, "board acircles:7x11:10:8 has not 5 dots")]),
        ("radius =", 'board = "circles:7"\nradius =', [(6, "target is 'circles:7'")]),
        ("[10, 10]", '[10, "10"]', [(7, "row 1 of dots holds '10', which is not a number")]),
    ],
)
def test_each_problem_has_its_line(tmp_path, old, new, problems):
    assert refused(load_target, tmp_path / "target.toml", TOML.replace(old, new, 1)) == problems
