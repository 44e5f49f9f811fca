"""Cameras of OpenCV and ROS: what their own programs write is read."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cpcal.cli.app import app
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import load_camera
from tests.refusals import refused

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")
ROS = """\
image_width: 640
image_height: 480
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: [525.5, 0.0, 319.5, 0.0, 526, 239.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.1, 0.01, 0.001, -0.002, 0]
"""


def test_what_opencv_writes_is_read(tmp_path: Path) -> None:
    """With four numbers of distortion, as without k3."""
    file = tmp_path / "out.yml"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    for key, value in (("image_width", 1024), ("image_height", 768)):
        storage.write(key, value)
    matrix = np.array([[903.2, 0.0, 515.3], [0.0, 903.2, 380.6], [0.0, 0.0, 1.0]])
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", np.array([[-0.18], [0.07], [4e-4], [-3e-4]]))
    storage.release()
    assert load_camera(file).camera == DELTALAB_CAMERA


def test_a_file_of_ros_is_read(tmp_path: Path) -> None:
    (tmp_path / "head.yaml").write_text(ROS)
    camera = load_camera(tmp_path / "head.yaml").camera
    assert (camera.width, camera.height, camera.model) == (640, 480, "brown")
    np.testing.assert_array_equal(camera.numbers, [525.5, 526.0, 319.5, 239.5, -0.1, 0.01, 0.001, -0.002, 0.0])


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("640", "0", "image_width and image_height are not two whole numbers"),
        ("plumb_bob", "thin_prism", "distortion_model is 'thin_prism'"),
        ("plumb_bob", "equidistant", "distortion_coefficients has 5 numbers"),
        ("525.5, 0.0", "525.5, 3.0", "camera_matrix is not [fx 0 cx; 0 fy cy; 0 0 1]"),
        ("525.5, 0.0, ", "0.0, ", "camera_matrix has 8 numbers"),
        ("525.5, 0.0", "525.5, .nan", "camera_matrix is {"),
        ("camera_matrix", "cameramatrix", "camera_matrix is missing"),
        ("[-0.1", "[-4000", "distortion: distortion bends most of the image beyond measure"),
        ("[-0.1", "[&a -0.1, *a", "is no YAML: aliases are not understood"),
        ("data: [-0.1", "data: [-0.1, [[[[[", "is no YAML"),
        ("525.5, 0.0", "9" * 400 + ", 0.0", "camera focal is not 2 finite numbers"),
        ("640", "9" * 400, "image_width and image_height are not two whole numbers from 1 to 1,000,000"),
        ("640", "!!python/object/apply:os.system [ls]", "image_width and image_height are not two whole numbers"),
        ("plumb_bob", "{a: b}", "distortion_model is {'a': 'b'}"),
        ("camera_name: head_camera", "? [a]\n: 1", "is no YAML: found unhashable key"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, old: str, new: str, what: str) -> None:
    found = refused(load_camera, tmp_path / "camera.yaml", ROS.replace(old, new, 1))
    assert len(found) == 1
    assert what in found[0][1]


def test_the_command_writes_a_camera_toml(tmp_path: Path) -> None:
    (tmp_path / "head.yaml").write_text(ROS)
    given = ["image", "camera", str(tmp_path / "head.yaml"), "-o", str(tmp_path / "camera.toml")]
    assert CliRunner().invoke(app, given).exit_code == 0
    assert load_camera(tmp_path / "camera.toml") == load_camera(tmp_path / "head.yaml")


def test_hostile_files_are_refused(tmp_path: Path) -> None:
    for text in ("", "- 1\n", "[" * 20_000, "a: " * 50, "\0"):
        refused(load_camera, tmp_path / "camera.yaml", text)
