"""`cpcal image sets` and its verification, on a rendered image."""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.vision_scenes import facing_poses
from cpcal.checker import sight
from cpcal.checker.sight import check_pose_set, check_pose_sets
from cpcal.cli import app
from cpcal.cli.image import _stated
from cpcal.cli.verified import _table_problem
from cpcal.robot import Pose
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import CameraRecord, save_camera, save_target
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene, render
from cpcal.vision.target import DELTALAB_TARGET, target_from, two_diagonals
from tests.vision.test_boards import CAMERA, photographed, seen_at

SMALL = two_diagonals("small", (-70.0, -20.0, 15.0, 50.0, 70.0), (-70.0, 5.0, 55.0, 70.0), 110.0, 20.0, 4.0)

ODD_BYTES, ODD_NAME = b"=-\xe9 nothing.png", r"=-\xe9 nothing.png"
DEVIATIONS = np.array([0.02, 0.02, 0.02, 0.02, 1e-5, 1e-5, 1e-6, 1e-6, 1e-5])


def run(*words: str | Path) -> tuple[int, str]:
    found = CliRunner().invoke(app, [str(word) for word in words])
    return found.exit_code, found.output


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Pose]:
    """Files of a camera, a target and an image; and its pose."""
    folder = tmp_path_factory.mktemp("place")
    pose = facing_poses(np.random.default_rng(1), 1, depth=(300.0, 350.0), tilt=20.0).rows(0)
    (folder / "images").mkdir()
    image = render(SMALL, DELTALAB_CAMERA, pose, seed=1)
    opencv().imwrite(str(folder / "images" / "first.png"), image)
    opencv().imwrite(str(folder / "nothing.png"), np.full_like(image, 90))
    (folder / "nothing.png").rename(folder / "images" / os.fsdecode(ODD_BYTES))
    save_camera(CameraRecord(DELTALAB_CAMERA, np.diag(DEVIATIONS**2)), folder / "camera.toml")
    save_target(SMALL, folder / "target.toml")
    return folder, pose


def test_from_images_to_checked_boxes_of_poses(place: tuple[Path, Pose], monkeypatch: pytest.MonkeyPatch) -> None:
    folder, pose = place
    known: dict[bytes, sight.PoseSetChecked] = {}

    def once(path: Path, **options: Any) -> sight.PoseSetChecked:
        """A claim of the same bytes is not checked again."""
        content = path.read_bytes()
        return known.get(content) or known.setdefault(content, check_pose_set(path, **options))

    monkeypatch.setattr(sight, "check_pose_set", once)
    files = ("--target", folder / "target.toml", "--camera", folder / "camera.toml")
    words = ("image", "sets", folder / "images", *files, "-o", folder / "sets", "--workers", "1", "--plate-exact")
    status, said = run(*words)
    assert status == 0, said
    assert "Poses enclosed in 1 of 2 images" in said
    assumed = "px; the camera's numbers are in an ellipsoid of half-widths fx 0.1, fy 0.1, cx 0.1, cy 0.1, k1 0.00005"
    assert "Assumed, not proved: the centre of each dot's image is within 0.05 " + assumed in said
    assert "dots are exact, the plate's size is exact" in said
    with (folder / "sets" / "sets.csv").open(encoding="utf-8") as file:
        nothing, first = csv.DictReader(file)
    assert (nothing["file"], nothing["verdict"]) == (f"'{ODD_NAME}", "unknown")
    assert nothing["reason"]
    for name, true in zip("xyz", pose.position, strict=True):
        assert abs(float(first[name]) - true) <= float(first[f"d{name}"]) < 0.5
    status, said = run("verify", folder / "sets")
    assert status == 0, said
    assert "first: all poses that show all" in said
    assert assumed in said
    table = folder / "sets" / "sets.csv"
    genuine, checked = table.read_text(), check_pose_sets(folder / "sets")
    assert _table_problem(table, checked) == ""
    for old, new, why in (
        (first["x"], repr(float(first["x"]) + 1e-9), "its verdict and numbers are not those of a claim that is proved"),
        (first["dx"], "", "its verdict and numbers are not those of a claim that is proved"),
        (",proved,", ",refuted,", "its verdict and numbers are not those of a claim that is proved"),
        (",unknown,", ",refuted,", "its verdict and numbers are not those of a claim that is proved"),
        ("first.png", "second.png", "its verdict and numbers are not those of a claim that is proved"),
        (genuine.splitlines(keepends=True)[2], "", "it leaves out first"),
        ("file,", "files,", "is no table of pose sets"),
    ):
        table.write_text(genuine.replace(old, new, 1))
        assert why in _table_problem(table, checked), (old, new)
    table.write_text(genuine)
    path = folder / "sets" / "first.pose.json"
    claim = json.loads(path.read_text())
    claim["inputs"]["pixels"]["lo"][0][0] = claim["inputs"]["pixels"]["hi"][0][0]
    path.write_text(json.dumps(claim))
    table.write_text(genuine.replace(first["x"], "0.0"))
    status, said = run("verify", folder / "sets")
    assert status == 1
    assert "first: REFUSED" in said
    assert "sets.csv: REFUSED, first.png: its verdict and numbers are not those of a claim that is proved" in said


@pytest.mark.parametrize(("text", "off"), [("charuco:6x5:30:20:4X4_50", "0.25"), ("grid:4x3:32:8:APRILTAG_36h11", "1")])
def test_corners_of_a_board_are_within_five_deviations(text: str, off: str, tmp_path: Path) -> None:
    target = target_from(text)
    image = photographed(target, CAMERA, seen_at(420.0, 0.25, 0.1, 0.1, target=target), Scene())
    (tmp_path / "images").mkdir()
    opencv().imwrite(str(tmp_path / "images" / "board.png"), image)
    save_camera(CAMERA, tmp_path / "camera.toml")
    files = ("--target", text, "--camera", tmp_path / "camera.toml", "--camera-exact", "--plate-exact")
    status, said = run("image", "sets", tmp_path / "images", *files, "-o", tmp_path / "sets", "--workers", "1")
    assert status == 0, said
    assert "Poses enclosed in 1 of 1 images" in said
    assert f"the centre of each dot's image is within {off} px" in said


def test_perfection_is_asked_for_by_name(place: tuple[Path, Pose]) -> None:
    folder, _ = place
    save_camera(DELTALAB_CAMERA, folder / "bare.toml")
    files = ("--target", folder / "target.toml", "--camera", folder / "bare.toml")
    status, said = run("image", "sets", folder / "images", *files, "-o", folder / "bare")
    assert status == 2
    said = " ".join(said.split())
    assert "the camera: has no covariance: nothing says how far its numbers may be off -> calibrate" in said
    assert "the target: has neither dot_sigma nor scale_sigma: nothing says how far its dots may be off -> add" in said
    assert not (folder / "bare").exists()


def test_the_dots_deviations_count_factor_times() -> None:
    plate, lens = replace(DELTALAB_TARGET, dot_sigma=0.01, scale_sigma=1e-4), CameraRecord(DELTALAB_CAMERA)
    plates, cameras = _stated(plate, lens, None, 3.0, plate_exact=False, camera_exact=True)
    np.testing.assert_array_equal(plates.half_widths, [0.03, 0.03, 0.0])
    assert (plates.scale, cameras.spread.shape[1]) == (3.0 * 1e-4, 0)
    plates, _ = _stated(plate, lens, None, 3.0, plate_exact=True, camera_exact=True)
    assert (plates.half_widths.any(), plates.scale) == (False, 0.0)
