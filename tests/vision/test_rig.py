"""Several cameras of one rig: where they are, and poses by all of them, as good as stated; files; the command."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.rigs import TRUE, found_rig, measured, place_square, plates, pose_square, seen
from cpcal.cli import app
from cpcal.common.errors import InputError
from cpcal.vision.files.camera_file import CameraRecord, save_camera
from cpcal.vision.files.rig_file import load_rig, rig_bytes, save_rig
from cpcal.vision.files.target_file import save_target
from cpcal.vision.render import Scene, render
from cpcal.vision.rig.calibrate_rig import NoRigError, calibrate_rig
from cpcal.vision.rig.rig import EACH, Rig
from cpcal.vision.target import DELTALAB_TARGET


def test_rigs_and_poses_are_as_good_as_stated_with_exact_and_with_calibrated_cameras():
    for uncertain in (False, True):
        places, both, alone = [], [], []
        for k in range(5):
            rng = np.random.default_rng(110 + k)
            found = found_rig(rng, uncertain)
            assert 0.8 < found.scale < 1.25
            places.append(place_square(found.rig))
            for _ in range(3):
                true, joint, single = measured(rng, found.rig)
                both.append(pose_square(joint, true))
                alone.append(pose_square(single, true))
                assert (np.linalg.eigvalsh(single.covariance - joint.covariance) > -1e-9).all()
        assert 0.3 < np.mean(places) < 2.0  # 30 degrees of freedom
        assert 0.5 < np.mean(both) < 1.7  # 90, in groups of 18 that share a rig
        assert 0.4 < np.mean(alone) < 1.8


def test_what_does_not_determine_a_rig_is_refused():
    rng = np.random.default_rng(4)
    records = {n: CameraRecord(c) for n, c in zip(TRUE.names, TRUE.cameras, strict=True)}
    moments = [seen(rng, plate, TRUE.cameras) for plate in plates(rng, 3)]
    with pytest.raises(NoRigError, match="shares 2 images"):
        calibrate_rig(records, moments[:2], DELTALAB_TARGET)
    with pytest.raises(NoRigError, match="shares 0 images"):
        calibrate_rig(records, [moment[:1] for moment in moments], DELTALAB_TARGET)


def test_a_rig_is_read_as_it_was_written_and_each_problem_has_its_line(tmp_path):
    rng = np.random.default_rng(5)
    spread = rng.standard_normal((2 * EACH, 2 * EACH))
    rig = Rig(TRUE.names, TRUE.cameras, TRUE.position, TRUE.quaternion, spread @ spread.T, 0.01)
    save_rig(rig, tmp_path / "rig.toml")
    assert load_rig(tmp_path / "rig.toml") == rig
    assert rig_bytes(load_rig(tmp_path / "rig.toml")) == rig_bytes(rig)
    text = (tmp_path / "rig.toml").read_text(encoding="utf-8")
    for change, said in (
        (('["left", "right"]', '["left", "left"]'), "different names"),
        (('["left", "right"]', '["left"]'), "no list of names"),
        (("[[1024, 768], [1024, 768]]", "[[1024, 768]]"), "1 rows, not 2"),
        (("rms = 0.01", "rmz = 0.01"), "rmz"),
        (("903.2, 903.2", "0.0, 903.2"), "focal"),
    ):
        (tmp_path / "rig.toml").write_text(text.replace(*change), encoding="utf-8")
        with pytest.raises(InputError, match=said):
            load_rig(tmp_path / "rig.toml")


def test_from_rendered_images_to_a_rig_and_poses(tmp_path):
    rng = np.random.default_rng(6)
    shown = plates(rng, 4)
    save_target(DELTALAB_TARGET, tmp_path / "target.toml")
    (tmp_path / "cameras").mkdir()
    for k, (name, camera) in enumerate(zip(TRUE.names, TRUE.cameras, strict=True)):
        save_camera(camera, tmp_path / "cameras" / f"{name}.toml")
        (tmp_path / "shots" / name).mkdir(parents=True)
        for i, plate in enumerate(shown):
            if (i, k) != (3, 0):  # the last moment is seen by the right camera alone
                image = render(DELTALAB_TARGET, camera, TRUE.seen_by(k, plate), Scene(), seed=10 * i + k)
                cv2.imwrite(str(tmp_path / "shots" / name / f"{i}.png"), image)

    def run(*words):
        given = ["rig", str(tmp_path / "shots"), "--target", str(tmp_path / "target.toml"), "--workers", "1", *words]
        return CliRunner().invoke(app, given)

    outcome = run("--cameras", str(tmp_path / "cameras"), "-o", str(tmp_path / "rig.toml"))
    assert outcome.exit_code == 0, outcome.output
    assert "3 of 4 moments" in outcome.output
    rig = load_rig(tmp_path / "rig.toml")
    assert np.abs(rig.position[1] - TRUE.position[1]).max() < 0.05
    outcome = run("--rig", str(tmp_path / "rig.toml"), "-o", str(tmp_path / "poses.csv"))
    assert outcome.exit_code == 0, outcome.output
    table = np.genfromtxt(tmp_path / "poses.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    for row, plate in zip(table, shown, strict=True):
        errors = np.abs(np.array([row["x"], row["y"], row["z"]]) - plate.position)
        assert (errors < 4.5 * np.array([row["sx"], row["sy"], row["sz"]])).all()
    assert (table["dots"][:3] > 200).all()
    assert run("-o", str(tmp_path / "rig.toml")).exit_code == 2
