"""`cpcal pose-sets` and its verification, on a rendered image."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.vision_scenes import facing_poses, one
from cpcal.cli import app
from cpcal.robot import Pose
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.camera_file import CameraRecord, save_camera
from cpcal.vision.files.target_file import save_target
from cpcal.vision.opencv import opencv
from cpcal.vision.render import render
from cpcal.vision.target import DELTALAB_TARGET

DEVIATIONS = np.array([0.02, 0.02, 0.02, 0.02, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5])


def run(*words: str | Path) -> tuple[int, str]:
    found = CliRunner().invoke(app, [str(word) for word in words])
    return found.exit_code, found.output


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Pose]:
    """Files of a camera, a target and an image; and its pose."""
    folder = tmp_path_factory.mktemp("place")
    pose = one(facing_poses(np.random.default_rng(1), 1, depth=(600.0, 700.0), tilt=20.0), 0)
    (folder / "images").mkdir()
    image = render(DELTALAB_TARGET, DELTALAB_CAMERA, pose, seed=1)
    opencv().imwrite(str(folder / "images" / "first.png"), image)
    opencv().imwrite(str(folder / "images" / "nothing.png"), np.full_like(image, 90))
    save_camera(CameraRecord(DELTALAB_CAMERA, np.diag(DEVIATIONS**2)), folder / "camera.toml")
    save_target(DELTALAB_TARGET, folder / "target.toml")
    return folder, pose


def test_from_images_to_checked_boxes_of_poses(place: tuple[Path, Pose]) -> None:
    folder, pose = place
    files = ("--target", folder / "target.toml", "--camera", folder / "camera.toml")
    status, said = run("pose-sets", folder / "images", *files, "-o", folder / "sets", "--workers", "1")
    assert status == 0, said
    assert "2 images: 1 poses enclosed" in said
    with (folder / "sets" / "sets.csv").open() as file:
        first, nothing = csv.DictReader(file)
    assert nothing["verdict"] == "unknown"
    assert nothing["reason"]
    for name, true in zip("xyz", pose.position, strict=True):
        assert abs(float(first[name]) - true) <= float(first[f"d{name}"]) < 0.5
    sources = ("--source", folder / "camera.toml", "--source", folder / "target.toml")
    status, said = run("verify", folder / "sets", *sources)
    assert status == 0, said
    assert "first: all poses that show all" in said
    assert said.count("the file that the pose sets name") == 2
    other = folder / "other"
    other.mkdir()
    (other / "camera.toml").write_text("another")
    status, said = run("verify", folder / "sets" / "first.pose.json", "--source", other / "camera.toml")
    assert status == 1
    assert "SHA-256 differs" in said
    path = folder / "sets" / "first.pose.json"
    claim = json.loads(path.read_text())
    claim["inputs"]["pixels"]["lo"][0][0] = claim["inputs"]["pixels"]["hi"][0][0]
    path.write_text(json.dumps(claim))
    status, said = run("verify", folder / "sets")
    assert status == 1
    assert "REFUSED" in said


def test_a_folder_without_images_is_refused(place: tuple[Path, Pose]) -> None:
    folder, _ = place
    (folder / "empty").mkdir()
    files = ("--target", folder / "target.toml", "--camera", folder / "camera.toml")
    status, said = run("pose-sets", folder / "empty", *files, "-o", folder / "none")
    assert status == 2
    assert "holds no images" in said
