"""camera.toml: round trips byte for byte; unusable files with every problem, its line and remedy."""

import numpy as np
import pytest

from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import CameraRecord, camera_bytes, load_camera, save_camera
from tests.refusals import refused

HALF = np.tril(np.random.default_rng(0).standard_normal((9, 9)))
COVARIANCE = HALF @ HALF.T
COVARIANCE = 0.5 * (COVARIANCE + COVARIANCE.T)

TOML = """\
format = "cpcal-camera/1"

[camera]
width = 1024
height = 768
focal = [903.2, 903]
center = [515.3, 380.6]
distortion = [-0.18, 0.07, 4e-4, -3e-4, 0]

[calibration]
rms = 0.01
covariance = [
    ROWS
]

[provenance]
by = "hand"
"""
ROWS = "\n    ".join(f"{[4.0 if i == j else 0 for j in range(9)]}," for i in range(9))
TOML = TOML.replace("ROWS", ROWS)


@pytest.mark.parametrize(
    "record",
    [
        CameraRecord(DELTALAB_CAMERA),
        CameraRecord(DELTALAB_CAMERA, COVARIANCE, 0.0123, {"made by": 'a "test"'}),
        CameraRecord(DELTALAB_CAMERA, rms=1 / 3),
        CameraRecord(DELTALAB_CAMERA, np.zeros((9, 9))),
    ],
)
def test_what_is_saved_is_loaded_and_saved_again_byte_for_byte(tmp_path, record):
    path = tmp_path / "camera.toml"
    save_camera(record, path)
    first = path.read_bytes()
    again = load_camera(path)
    assert again == record
    assert again.camera == record.camera
    assert again.rms == record.rms
    assert again.provenance == record.provenance
    if record.covariance is None:
        assert again.covariance is None
    else:
        np.testing.assert_array_equal(again.covariance, record.covariance)
    save_camera(again, path)
    assert path.read_bytes() == first == camera_bytes(record)


def test_every_problem_is_said_at_once_with_its_line(tmp_path):
    text = TOML.replace("1024", "1024.5").replace("903.2", "inf").replace("4e-4, ", "").replace("rms", "rsm")
    assert refused(load_camera, tmp_path / "camera.toml", text) == [
        (11, "unknown key 'rsm' in [calibration]"),
        (4, "width is 1024.5"),
        (6, "focal holds inf"),
        (8, "distortion has 4 numbers, not 5"),
    ]


@pytest.mark.parametrize(
    ("old", "new", "problems"),
    [
        ("width = 1024", "width = 0", [(4, "width is 0")]),
        ("903.2, 903]", "903.2, 0]", [(6, "has no positive size or focal length")]),
        ("[515.3, 380.6]", "515.3", [(7, "center is not a list of numbers")]),
        ("rms = 0.01", "rms = -0.01", [(11, "rms holds the negative number -0.01")]),
        ("[4.0, 0, 0", "[4.0, 1, 0", [(12, "covariance is not symmetric")]),
        ("[4.0, 0, 0", "[-4.0, 0, 0", [(12, "covariance is of no random numbers: it is not positive semidefinite")]),
        ("    [4.0, 0, 0, 0, 0, 0, 0, 0, 0],\n", "", [(12, "covariance is not 9 rows of 9 finite numbers")]),
        ("903.2, 903]", "903200, 903.2]", [(6, "fx is 903200 and fy 903.2: no pixel is so long")]),
        ("903.2, 903]", "4.2, 4.2]", [(6, "focal 4.2, 4.2 is not from 51.2 to 1.024e+06 pixels")]),
        ("-0.18, 0.07", "4e16, 0.07", [(8, "distortion holds 4e+16")]),
        ("-0.18, 0.07", "-1e11, 1e11", [(8, "distortion bends most of the image beyond measure")]),
    ],
)
def test_each_problem_has_its_line(tmp_path, old, new, problems):
    assert refused(load_camera, tmp_path / "camera.toml", TOML.replace(old, new, 1)) == problems
