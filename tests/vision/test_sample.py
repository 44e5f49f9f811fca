"""A second look at some images stays small."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (pip install 'cpcal[vision]')")

from cpcal.vision.batch.detect import NUMBERS, Detection
from cpcal.vision.batch.study_images import MOST_PICTURES, look_again
from cpcal.vision.camera import DELTALAB_CAMERA


def test_pictures_are_few_whatever_the_images(monkeypatch):
    """Refused ones first, one a reason, then the worst doubtful ones."""
    monkeypatch.setattr("cpcal.vision.batch.study_images.refusal", lambda *given: b"x" * 1000)
    monkeypatch.setattr("cpcal.vision.batch.study_images.overlay", lambda *given: b"x" * 200_000)
    monkeypatch.setattr("cpcal.vision.batch.study_images.measure_pose", lambda *given, **hints: object())

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
    names = [seen.row.file for seen in sample]
    assert names == ["none0", "none1", "none2", "none3", "poor5", "poor4"]  # no room for a third of 200 kB
    assert sum(len(seen.jpeg) for seen in sample) <= 600_000
    monkeypatch.setattr("cpcal.vision.batch.study_images.overlay", lambda *given: b"x")
    names = [seen.row.file for seen in look_again(rows, Grey(), Plate(), DELTALAB_CAMERA)]
    assert len(names) == MOST_PICTURES
    assert names[4:8] == ["poor5", "poor4", "poor3", "poor2"]
