"""Images by the command line: rendered, detected, on a page, joined with leg readings, calibrated."""

import csv

import numpy as np
import pytest
from tinyhtml5.parser import HTMLParser

from cpcal.cli.image import MOST_ROWS, write_detections_page
from cpcal.files import load_study
from cpcal.questions import load_record
from cpcal.simulate import simulate_study
from cpcal.vision.batch.detect import NUMBERS, Detection, Detections
from cpcal.vision.batch.study_images import SeenImage
from cpcal.vision.camera import CAMERA_NUMBERS, DELTALAB_CAMERA
from cpcal.vision.files.plate_and_camera import CameraRecord, load_camera, load_target
from cpcal.vision.target import DELTALAB_TARGET
from tests.changed import of_poses
from tests.cli.command import done, refused, run

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")


@pytest.fixture(scope="module", autouse=True)
def one_process():
    """The tests of this machine's cores are elsewhere; to start processes costs more here than they save."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("multiprocessing.cpu_count", lambda: 1)
        yield


def every(step):
    """Studies of each so many-th of the 64 configurations: what is rendered and measured takes long."""

    def simulated(robot, **options):
        return of_poses(simulate_study(robot, **options), [f"e{k:02}" for k in range(0, 64, step)])

    return simulated


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """What an engineer brings home: images, target, camera and leg readings."""
    folder = tmp_path_factory.mktemp("images") / "shots"
    options = ("--runs", 1, "--validation-runs", 1, "--random-poses", 2, "--images", 2, "--seed", 3, "--sag", 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cpcal.cli.image.simulate_study", every(6))
        said = done("simulate", "deltalab", "--study", "--render", "-o", folder, *options)
    assert "22 images for calibration, 4 for validation" in said
    return folder


def detect(shots, table, *options):
    files = ("--target", shots / "target.toml", "--camera", shots / "camera.toml")
    return run("image", "detect", shots / "images" / table, "-o", shots / f"poses-{table}.csv", *files, *options)


def test_from_images_to_a_study_that_can_be_calibrated(shots):
    assert load_target(shots / "target.toml") == DELTALAB_TARGET
    assert load_camera(shots / "camera.toml").camera == DELTALAB_CAMERA
    for table in ("calibration", "validation"):
        joined = ("--readings", shots / f"{table}-readings.csv", "--table", shots / f"{table}.csv")
        outcome = detect(shots, table, *joined)
        assert outcome.exit_code == 0, outcome.stderr
        assert f"Table of a study: {shots / table}.csv" in outcome.stdout
    rows = (shots / "poses-calibration.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) > 22
    assert not any(row["reason"] for row in csv.DictReader(rows))
    assert len(load_study(shots).calibration) == 22
    again = detect(shots, "calibration")
    assert "Poses in 22 of 22 images (0 measured now)" in again.stdout
    page = shots / "poses-calibration.csv.html"
    assert f"Page: {page}" in again.stdout
    text = page.read_text(encoding="utf-8")
    assert text.count("data:image/jpeg;base64,") == 12
    assert "More than noise" not in text  # the camera is the one that the images were made with
    assert "No image was measured now" in text
    assert page.stat().st_size < 1_000_000
    done("calibrate", shots, "-o", shots / "calibrated")
    found = load_record(shots / "calibrated")
    before, after = found.validation.x_c.figures("position")["mean"]
    assert after < 0.5 * before


def test_a_camera_from_images(shots, tmp_path):
    options = ("--target", shots / "target.toml", "-o", tmp_path / "camera.toml")
    assert "views" in refused("image", "camera", shots / "images" / "calibration" / "e00", *options)
    some = tmp_path / "some"
    for k in range(0, 64, 6):
        name = f"e{k:02}"
        (some / name).mkdir(parents=True)
        source = shots / "images" / "calibration" / name / "1" / "1.png"
        (some / name / "1.png").write_bytes(source.read_bytes())
    assert done("image", "camera", some, *options).count("dots, RMS 0.00") == 11
    record = load_camera(tmp_path / "camera.toml")
    error = np.abs(record.camera.numbers - DELTALAB_CAMERA.numbers) / np.sqrt(np.diag(record.covariance))
    assert error.shape == (len(CAMERA_NUMBERS),)
    assert error.max() < 5.0


def test_every_problem_of_every_file_is_told_and_nothing_is_written(shots, tmp_path):
    (tmp_path / "readings.csv").write_text("pose,run,L1\na,1,x\n")
    files = ("--target", shots / "camera.toml", "--camera", shots / "target.toml")
    joined = ("--readings", tmp_path / "readings.csv", "--table", tmp_path / "new" / "calibration.csv")
    said = refused(
        "image", "detect", shots / "images" / "validation", "-o", tmp_path / "new" / "poses.csv", *files, *joined
    )
    for part in ("cpcal-target/2", "cpcal-camera/1", "readings.csv:2"):
        assert part in said
    assert not (tmp_path / "new").exists()


def test_options_that_do_not_go_together_are_told_at_once(shots, tmp_path):
    files = ("--target", shots / "target.toml", "--camera", shots / "camera.toml")
    said = refused("image", "detect", tmp_path, "-o", tmp_path / "x.csv", *files, "--table", "t")
    for part in ("--readings and --table", "holds no PNG, JPEG, TIFF or BMP"):
        assert part in said


EVIL = "<script>alert(1)</script>.png"
SIGMA = 0.004


def row(name, scale=1.0, doubt=""):
    values = {**dict.fromkeys(NUMBERS, 0.0), "qw": 1.0, "rms": SIGMA, "scale": scale, "sz": 0.0031, "shared_sz": 0.0012}
    return Detection(name, "", 130, tuple(values[number] for number in NUMBERS), doubt)


def page_of(tmp_path, rows, *, seconds=0.0, pictures=(), generator="somebody"):
    found = Detections(tuple(rows), len(rows) if seconds else 0, seconds)
    camera = CameraRecord(DELTALAB_CAMERA, provenance={"generator": generator})
    file = write_detections_page(found, pictures, DELTALAB_TARGET, camera, tmp_path / "poses.csv")
    assert file == tmp_path / "poses.csv.html"
    text = file.read_text(encoding="utf-8")
    parser = HTMLParser()
    parser.parse(text)
    assert parser.errors == []
    return text


def test_counts_reasons_and_time_are_told_and_names_are_no_markup(tmp_path):
    rows = [row("a.png"), row("b.png"), row("c.png", 7.5, "the residuals are 2.7 times as large")]
    rows += [Detection(EVIL, "is empty"), Detection("e.png", "is empty"), Detection("f.png", "not <identified>")]
    seen = SeenImage(rows[3], b"\xff\xd8 a picture", (420, 315))
    text = page_of(tmp_path, rows, seconds=0.8, pictures=(seen,))
    for part in (">2</span> found,", ">1</span> found, doubtful,", ">3</span> refused."):
        assert part in text
    assert text.index("<td>2</td>") < text.index("not &lt;identified&gt;")  # the most frequent reason first
    assert "<script" not in text
    assert text.count("data:image/jpeg;base64,") == 1
    assert "<td>7.5</td>" in text
    assert "0.0031" in text
    assert "0.0012" in text
    assert "6 images were measured now, in 133.3 ms of processor time each" in text
    assert "default-src 'none'; style-src 'unsafe-inline'; img-src data:" in text
    assert "http://" not in text
    assert "https://" not in text


def test_it_stays_short_and_says_what_it_leaves_out(tmp_path):
    rows = [Detection(f"{k}.png", f"{k} dots are too few") for k in range(MOST_ROWS + 5)]
    text = page_of(tmp_path, rows)
    assert "And 5 more, in poses.csv." in text
    assert "No image was measured now" in text
    rows = [row(f"{k}.png", 3.0 + k, "doubtful") for k in range(MOST_ROWS + 7)]
    text = page_of(tmp_path, rows)
    assert "And 7 more, in poses.csv." in text
    assert '<th scope="row">0.png</th>' not in text  # the least doubtful
