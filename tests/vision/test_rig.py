"""Several cameras of one rig: where they are, and poses by all of them, as good as stated; files; the command."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.vision_scenes import facing_poses, found_dots, one
from cpcal.cli import app
from cpcal.common.errors import InputError
from cpcal.robot import Pose, quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product, rotation_vector
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.files.camera_file import CameraRecord, save_camera
from cpcal.vision.files.rig_file import load_rig, rig_bytes, save_rig
from cpcal.vision.files.target_file import save_target
from cpcal.vision.pose import estimate_pose
from cpcal.vision.render import Scene, render
from cpcal.vision.rig.calibrate_rig import NoRigError, calibrate_rig
from cpcal.vision.rig.joint_pose import joint_pose
from cpcal.vision.rig.rig import EACH, Rig, SeenPlate
from cpcal.vision.target import DELTALAB_TARGET

OTHER = Camera(1024, 768, [950.0, 948.0], [505.0, 390.0], [-0.15, 0.05, -2e-4, 1e-4, 0.0])
TURN = quaternion_from_rotation_vector(np.array([0.03, -0.45, 0.02]))
TRUE = Rig(
    ("left", "right"),
    (DELTALAB_CAMERA, OTHER),
    np.array([[0.0, 0.0, 0.0], [300.0, 12.0, 65.0]]),
    np.array([[1.0, 0.0, 0.0, 0.0], TURN]),
    np.zeros((2 * EACH, 2 * EACH)),
)
NOISE = 0.02
SPREAD = np.array([0.3, 0.3, 0.4, 0.4, 4e-4, 8e-4, 5e-5, 5e-5, 6e-4])  # of a camera's numbers, before


def plates(rng, count):
    """Poses in the first camera's frame that both cameras see."""
    poses = facing_poses(rng, count, depth=(650.0, 800.0), tilt=20.0)
    return [Pose(one(poses, k).position + [20.0, 0.0, 0.0], one(poses, k).quaternion) for k in range(count)]


def seen(rng, plate, cameras):
    """What both cameras see, as cameras of the given numbers understand it."""
    out = []
    for k, camera in enumerate(cameras):
        placed = TRUE.seen_by(k, plate)
        centers, numbers = found_dots(rng, DELTALAB_TARGET, TRUE.cameras[k], placed, noise=NOISE)
        covariance = np.tile(NOISE**2 * np.eye(2), (len(numbers), 1, 1))
        pose = estimate_pose(centers, covariance, numbers, DELTALAB_TARGET, camera).pose
        out.append(SeenPlate(k, centers, covariance, numbers, pose))
    return out


def off(pose, true):
    """(6,): position and rotation vector from a pose to the truth."""
    turn = quaternion_product(true.quaternion, quaternion_conjugate(pose.quaternion))
    return np.concatenate([true.position - pose.position, rotation_vector(turn)])


def square(error, covariance):
    """The mean square of an error's parts under a covariance."""
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


def test_rigs_and_poses_are_as_good_as_stated_with_exact_and_with_calibrated_cameras():
    for uncertain in (False, True):
        rigs, poses, alone = [], [], []
        for k in range(5):
            rng = np.random.default_rng(110 + k)
            cameras = [c.with_numbers(c.numbers + uncertain * SPREAD * rng.standard_normal(9)) for c in TRUE.cameras]
            covariance = np.diag(SPREAD**2) if uncertain else None
            records = {n: CameraRecord(c, covariance) for n, c in zip(TRUE.names, cameras, strict=True)}
            found = calibrate_rig(records, [seen(rng, plate, cameras) for plate in plates(rng, 8)], DELTALAB_TARGET)
            rig = found.rig
            assert 0.8 < found.scale < 1.25
            place = slice(EACH, EACH + 6)
            wrong = off(Pose(rig.position[1], rig.quaternion[1]), Pose(TRUE.position[1], TRUE.quaternion[1]))
            rigs.append(square(wrong, rig.covariance[place, place]))
            for plate in plates(rng, 3):
                views = seen(rng, plate, rig.cameras)
                joint = joint_pose(views, rig, DELTALAB_TARGET)
                poses.append(square(off(joint.pose, plate), joint.covariance))
                single = joint_pose(views[:1], rig, DELTALAB_TARGET)
                alone.append(square(off(single.pose, plate), single.covariance))
                assert (np.linalg.eigvalsh(single.covariance - joint.covariance) > -1e-9).all()
        assert 0.3 < np.mean(rigs) < 2.0  # 30 degrees of freedom
        assert 0.5 < np.mean(poses) < 1.7  # 90, in groups of 18 that share a rig
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
