"""A real photograph of a plate with a grid of dark dots, a smudge and a shadowed corner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.dot_errors import photograph_figures
from cpcal.vision.opencv import opencv

PHOTOGRAPH = Path(__file__).resolve().parents[3] / "shared" / "data" / "dots" / "dot_pattern_05.jpg"

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not PHOTOGRAPH.exists(), reason=f"the photograph of dots is not at {PHOTOGRAPH}"),
]


def test_every_dot_of_the_photograph_to_a_hundredth_of_a_pixel():
    image = opencv().imread(str(PHOTOGRAPH), opencv().IMREAD_UNCHANGED)
    found, figures = photograph_figures(image)
    assert not found.bright
    assert len(found) == 4315
    assert figures["off the grid"] == 0
    for degree in (5, 6, 7):
        assert max(figures[f"degree {degree}"]) <= 0.012
    assert figures["beyond 4"] < 0.005 * len(found)
    assert 0.8 < figures["stated"] / np.mean(figures["degree 7"]) < 1.7  # JPEG's noise is not white
