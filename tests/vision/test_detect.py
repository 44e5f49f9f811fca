"""One image or a folder of them to poses: the same whatever the workers, a reason for every image without a pose."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from benchmarks.vision_scenes import degenerate_images, facing_poses, pose_error
from cpcal.common.errors import InputError
from cpcal.robot import quaternion_conjugate, quaternion_product, rotation_vector
from cpcal.simulate import simulate_study
from cpcal.vision.batch.detect import (
    POSITION,
    QUATERNION,
    SIGMA,
    ImageFolder,
    detect,
    detections_bytes,
    in_parallel,
    values_of,
)
from cpcal.vision.batch.study_images import RenderedImages, camera_above
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene, render
from cpcal.vision.target import DELTALAB_TARGET

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")


BAD = {
    "bad/empty.png": "is empty", "bad/text.jpg": "cannot be read", "bad/black.png": "not identified",
    "bad/white.png": "not identified", "bad/noise.png": "not identified",
    "bad/dot.png": "the image is 1 x 1 pixels", "bad/large.png": "the image is 4000 x 3000 pixels",
    "bad/cut.png": "is truncated",
}  # fmt: skip


@pytest.fixture(scope="module")
def rendered():
    """Twelve images of three configurations, with the poses they were rendered from."""
    study = simulate_study(
        seed=3, runs=2, validation_runs=1, random_poses=3, images=2, pose_noise=0.0, camera=camera_above(seed=3)
    )
    every = RenderedImages.of(study.calibration, DELTALAB_TARGET, DELTALAB_CAMERA, Scene(), seed=3)
    return replace(every, names=every.names[:12])


@pytest.fixture(scope="module")
def folder(rendered, tmp_path_factory):
    path = tmp_path_factory.mktemp("images")
    rendered.write(path, workers=1)
    (path / "bad").mkdir()
    grey = np.random.default_rng(0).integers(0, 256, (768, 1024), dtype=np.uint8)
    images = {
        "black": np.zeros_like(grey), "white": np.full_like(grey, 255), "noise": grey, "dot": grey[:1, :1],
        "large": np.zeros((3000, 4000), np.uint8),
    }  # fmt: skip
    for name, image in images.items():
        opencv().imwrite(str(path / "bad" / f"{name}.png"), image)
    (path / "bad" / "empty.png").write_bytes(b"")
    (path / "bad" / "text.jpg").write_text("no image")
    good = (path / rendered.names[0]).read_bytes()
    (path / "bad" / "cut.png").write_bytes(good[: len(good) // 2])
    return path


@pytest.fixture(scope="module")
def alone(folder):
    return detect(ImageFolder(folder), DELTALAB_TARGET, DELTALAB_CAMERA, workers=1)


def test_poses_are_right_and_bad_images_have_their_reasons(alone, rendered):
    reasons = {row.file: row.reason for row in alone.rows if not row.found}
    assert reasons.keys() == BAD.keys()
    for name, reason in BAD.items():
        assert reason in reasons[name]
    rows = [row for row in alone.rows if row.found]
    assert [row.file for row in rows] == sorted(rendered.names)
    values = values_of(rows)
    true = [rendered.names.index(row.file) for row in rows]
    turn = quaternion_product(values[:, QUATERNION], quaternion_conjugate(rendered.poses.quaternion[true]))
    error = np.concatenate([values[:, POSITION] - rendered.poses.position[true], rotation_vector(turn)], axis=1)
    assert np.abs(error / values[:, SIGMA]).max() < 5.0
    assert np.abs(error[:, :3]).max() < 0.03
    assert np.degrees(np.abs(error[:, 3:])).max() < 0.01


def test_the_table_does_not_depend_on_who_works(alone, folder):
    expected = detections_bytes(alone.rows)
    pair = detect(ImageFolder(folder), DELTALAB_TARGET, DELTALAB_CAMERA, workers=2)
    assert detections_bytes(pair.rows) == expected


def test_a_restart_redoes_nothing(alone, rendered, folder, tmp_path):
    journal = tmp_path / "poses.csv.journal"

    class Enough(Exception):
        pass

    def stop(done, count):
        if done >= 8:
            raise Enough("eight images")

    given = (ImageFolder(folder), DELTALAB_TARGET, DELTALAB_CAMERA)
    with pytest.raises(Enough, match="eight images"):
        detect(*given, workers=1, journal=journal, progress=stop)
    kept = journal.read_text().count("\n") - 1
    assert kept >= 8
    with journal.open("a") as file:
        file.write('{"file": "e00/1/1.png", "st')  # as a crash leaves it
    seen = []
    again = detect(*given, workers=1, journal=journal, progress=lambda *numbers: seen.append(numbers))
    assert again.measured == len(alone.rows) - kept
    assert seen[0] == (kept, len(alone.rows))
    assert seen[-1] == (len(alone.rows), len(alone.rows))
    assert detections_bytes(again.rows) == detections_bytes(alone.rows)
    assert detect(*given, workers=1, journal=journal).measured == 0
    (folder / "bad" / "black.png").touch()  # perhaps another image now
    assert detect(*given, workers=1, journal=journal).measured == 1
    head, *_ = journal.read_text().splitlines()
    journal.write_text(json.dumps({**json.loads(head), "of": "another camera"}) + "\n")
    assert (
        detect(
            replace(rendered, names=rendered.names[:1]), DELTALAB_TARGET, DELTALAB_CAMERA, workers=1, journal=journal
        ).measured
        == 1
    )
    journal.write_text("not a journal\n")
    with pytest.raises(InputError, match="is not a journal"):
        detect(*given, workers=1, journal=journal)


def test_what_fails_unexpectedly_is_told_and_tried_again(rendered, tmp_path):
    class Broken(RenderedImages):
        def read(self, name):
            raise RuntimeError("the disk is on fire")

    good = replace(rendered, names=rendered.names[:2])
    broken, journal = Broken(**vars(good)), tmp_path / "journal"
    for source, poses in ((broken, 0), (good, 2), (broken, 2)):
        found = detect(source, DELTALAB_TARGET, DELTALAB_CAMERA, workers=1, journal=journal)
        assert sum(row.found for row in found.rows) == poses
        reasons = {row.reason for row in found.rows if not row.found}
        assert reasons <= {"failed unexpectedly: RuntimeError: the disk is on fire"}


def test_poses_at_the_nominal_setting() -> None:
    """At most 0.01 mm and 0.003 degrees rms per axis (issue 6), and the stated covariances hold."""
    poses, errors, squares = facing_poses(np.random.default_rng(7), 8, depth=(700.0, 700.0)), [], []
    for k in range(8):
        image = render(DELTALAB_TARGET, DELTALAB_CAMERA, poses.rows(k), seed=k)
        found = measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
        errors.append(pose_error(poses.rows(k), found.estimate))
        squares.append(errors[-1] @ np.linalg.solve(found.estimate.covariance, errors[-1]) / 6.0)
    rms = np.sqrt(np.square(errors).mean(axis=0))
    assert max(rms[:3]) < 0.01
    assert np.degrees(max(rms[3:])) < 0.003
    assert 0.3 < np.mean(squares) < 1.7  # standard deviation 0.2


REASONS = {
    "black": "too few", "white": "too few", "saturated": "", "noise": "not identified",
    "blurred by 15 pixels": "", "half out, to the right": "not identified", "half out, below": "not identified",
    "mirrored": "mirror image", "without its rows": "ambiguous", "chessboard": "not identified",
    "a regular grid of dots": "not identified", "1 x 1": "1 x 1 pixels",
    "100 megapixels": "the image is 10000 x 10001 pixels",
}  # fmt: skip


def test_there_is_a_reason_for_every_image_without_a_target() -> None:
    images = degenerate_images(1)
    assert set(images) == set(REASONS)
    for name, image in images.items():
        with pytest.raises(NotMeasured) as refusal:
            measure_pose(image, DELTALAB_TARGET, DELTALAB_CAMERA)
        assert REASONS[name] in str(refusal.value), name


def test_a_wrong_camera_shows_in_the_residuals() -> None:
    pose = facing_poses(np.random.default_rng(2), 1, depth=(700.0, 700.0)).rows(0)
    image = render(DELTALAB_TARGET, DELTALAB_CAMERA, pose)
    off = Camera(1024, 768, DELTALAB_CAMERA.focal, DELTALAB_CAMERA.center, DELTALAB_CAMERA.distortion * 0.5)
    with pytest.raises(NotMeasured, match="the camera or the target is not as stated"):
        measure_pose(image, DELTALAB_TARGET, off)


def limits():
    """The threads of OpenCV and of every library of linear algebra in this process."""
    np.ones(1) @ np.ones(1)
    blas = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
    assert blas
    return [opencv().getNumThreads(), *blas]


@pytest.fixture
def free():
    """Libraries that may use four threads, set back in the end."""
    from threadpoolctl import threadpool_limits

    before = opencv().getNumThreads()
    with threadpool_limits(limits=4):
        opencv().setNumThreads(4)
        yield limits()
    opencv().setNumThreads(before)


def test_limits_come_back_after_an_error_and_after_an_abandoned_run(free):
    def fails(names):
        raise RuntimeError("on purpose")

    with pytest.raises(RuntimeError, match="on purpose"):
        list(in_parallel(fails, ["a"], workers=1))
    assert limits() == free
    running: Any = in_parallel(lambda names: limits(), ["a"] * 20, workers=1)
    assert set(next(running)) == {1}
    running.close()
    assert limits() == free
