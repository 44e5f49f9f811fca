"""A second look at some images: what it finds of lens and plate, and that it stays small."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from cpcal.vision.batch.detect import NUMBERS, Detection
from cpcal.vision.batch.study_images import MOST_PICTURES, look_again
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.measure import Residuals, over_image, over_plate

SIGMA = 0.005  # pixels


def drawn(field, count=20_000, seed=0):
    """Residuals of that mean, by (place in pixels, number of a dot), with noise."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.0, 1.0, (count, 2)) * [1024.0, 768.0] - 0.5
    numbers = rng.integers(0, 9, count)
    off = field(at, numbers) + SIGMA * rng.standard_normal((count, 2))
    variance = np.full((count, 2), SIGMA**2)
    return Residuals(at, off, variance, numbers, 0.5 * off, 0.25 * variance)


def test_noise_leaves_what_it_should_of_means():
    means = over_image(drawn(lambda at, numbers: np.zeros_like(at)), 1024, 768)
    assert len(means.at) == 16 * 12
    assert means.counts.sum() == 20_000
    assert means.rms == pytest.approx(means.noise_rms, rel=0.15)
    assert means.noise_rms == pytest.approx(SIGMA / np.sqrt(20_000 / 192), rel=0.05)


def test_an_error_of_the_lens_is_found_where_it_is():
    means = over_image(drawn(lambda at, numbers: 1e-5 * (at - [512.0, 384.0])), 1024, 768)
    assert np.abs(means.mean - 1e-5 * (means.at - [512.0, 384.0])).max() < 5 * SIGMA / np.sqrt(60)
    assert means.rms > 4 * means.noise_rms


def test_an_error_of_a_dot_is_found_on_the_plate():
    dots = np.stack(np.meshgrid([0.0, 10.0, 20.0], [0.0, 10.0, 20.0]), axis=-1).reshape(-1, 2)
    means = over_plate(drawn(lambda at, numbers: np.where(numbers[:, None] == 4, [0.02, 0.0], 0.0)), dots)
    assert np.array_equal(means.at, dots)
    assert means.mean[4] == pytest.approx([0.01, 0.0], abs=5e-4)  # mm: half of the pixels
    assert np.abs(np.delete(means.mean, 4, axis=0)).max() < 5e-4


def test_few_residuals_make_no_means():
    none = Residuals.joined([])
    assert len(over_image(none, 1024, 768).at) == 0
    assert np.isnan(over_image(none, 1024, 768).rms)
    assert len(over_image(drawn(lambda at, numbers: 0.0 * at, count=7), 1024, 768).at) == 0


def test_images_that_cannot_be_read_any_more_are_left_out():
    class Gone:
        def read(self, name):
            raise OSError("gone")

    rows = [Detection("a.png", "", 133, tuple(1.0 for _ in NUMBERS)), Detection("b.png", "is empty")]
    sample = look_again(rows, Gone(), None, DELTALAB_CAMERA)
    assert sample.pictures == ()
    assert sample.measured == len(sample.residuals.at) == 0


def test_pictures_are_few_whatever_the_images(monkeypatch):
    """Refused ones first, one a reason, then the worst doubtful ones."""
    monkeypatch.setattr("cpcal.vision.batch.study_images.refusal", lambda *given: b"x" * 1000)
    monkeypatch.setattr("cpcal.vision.batch.study_images.overlay", lambda *given: b"x" * 200_000)
    monkeypatch.setattr("cpcal.vision.batch.study_images.measure_pose", lambda *given, **hints: object())
    monkeypatch.setattr("cpcal.vision.batch.study_images.residuals_of", lambda *given: Residuals.joined([]))

    class Grey:
        def read(self, name):
            return np.zeros((768, 1024), np.uint8)

    class Plate:
        bright = True

    def pose(name, scale, doubt=""):
        values = tuple(scale if number == "scale" else 0.0 for number in NUMBERS)
        return Detection(name, "", 133, values, doubt)

    rows = [pose(f"good{k:02}", 1.0) for k in range(50)]
    rows += [pose(f"poor{k}", 3.0 + k, "doubtful") for k in range(6)]
    rows += [Detection(f"none{k}", f"reason {k % 6}") for k in range(30)]
    sample = look_again(rows, Grey(), Plate(), DELTALAB_CAMERA)
    names = [seen.row.file for seen in sample.pictures]
    assert names == ["none0", "none1", "none2", "none3", "poor5", "poor4"]  # no room for a third of 200 kB
    assert sum(len(seen.jpeg) for seen in sample.pictures) <= 600_000
    assert sample.measured == 40
    monkeypatch.setattr("cpcal.vision.batch.study_images.overlay", lambda *given: b"x")
    names = [seen.row.file for seen in look_again(rows, Grey(), Plate(), DELTALAB_CAMERA).pictures]
    assert len(names) == MOST_PICTURES
    assert names[4:8] == ["poor5", "poor4", "poor3", "poor2"]
