"""A target on paper: distances on the page are the target's, to the micrometre; the same bytes each time."""

import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.vision.dots import observe_dots
from cpcal.vision.files.image_file import read_image
from cpcal.vision.files.target_print import PAPERS, on_paper, page_bytes, print_target, sheet
from cpcal.vision.target import DELTALAB_TARGET, Target, two_diagonals

NAME, FIRST, SECOND = "small & <dark>, $5", (-60.0, -31.0, -9.0, 22.0, 55.0), (-58.0, -20.0, 40.0, 63.0)
SMALL = replace(two_diagonals(NAME, FIRST, SECOND, 100.0, 25.0, 3.0), bright=False)
TARGETS = [DELTALAB_TARGET, SMALL]
NUMBER = r"(-?[\d.]+)"


def pdf_paths(target):
    """The page's size (mm), and each path in its only stream as (n, 2) mm from the upper left corner, y down."""
    content = page_bytes(target, "pdf")
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    size = np.array([float(side) for side in box.groups()]) * 25.4 / 72.0
    streams = [
        zlib.decompress(body)
        for body in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S)
        if body[0] == 0x78
    ]
    page = next(text for text in streams if b" m\n" in text).decode("latin-1")
    paths, points = [], []
    for line in page.splitlines():
        if re.fullmatch(rf"{NUMBER} {NUMBER} m", line):
            points = [line.split()[:2]]
        elif re.fullmatch(rf"({NUMBER} )+[lc]", line):
            points.append(line.split()[-3:-1])
        elif line in ("f", "S", "b", "B") and points:
            paths.append(np.array(points, dtype=np.float64) * 25.4 / 72.0 * [1.0, -1.0] + [0.0, size[1]])
            points = []
    return size, paths


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name[:5])
def test_the_pdf_has_every_dot_at_its_place_and_a_bar_of_100_mm(target):
    size, paths = pdf_paths(target)
    np.testing.assert_allclose(size, sheet(target).size, atol=1e-6)
    circles = [path for path in paths if len(path) == 9]  # eight arcs
    low, high = (np.array([extent(path, axis=0) for path in circles]) for extent in (np.min, np.max))
    drawn, dots = 0.5 * (low + high) * [1.0, -1.0], target.dots  # drawn with y down
    np.testing.assert_allclose(drawn - drawn.mean(axis=0), dots - dots.mean(axis=0), atol=2e-6)
    np.testing.assert_allclose(0.5 * (high - low), target.radius, atol=2e-6)
    lines = [path for path in paths if len(path) == 2]
    assert max(np.ptp(line[:, 0]) for line in lines) == pytest.approx(100.0, abs=2e-6)


@pytest.mark.peers
@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="pdftoppm is not installed")
def test_the_printed_page_is_seen_as_the_target(tmp_path):
    print_target(SMALL, tmp_path / "target.pdf")
    subprocess.run(["pdftoppm", "-r", "127", "-png", "-gray", "target.pdf", "page"], cwd=tmp_path, check=True)
    (page,) = tmp_path.glob("page*.png")
    found = observe_dots(read_image(page), bright=False)
    on = sheet(SMALL)
    places = (SMALL.dots - on.corner) * [1.0, -1.0] + [0.0, on.size[1]]
    wanted = places * 5.0 - 0.5  # 127 dots an inch: 5 pixels a mm; pixel centres are whole
    nearest = np.linalg.norm(found.centers[:, None] - wanted, axis=2)
    assert (nearest.min(axis=0) < 0.1).all()
    radii = found.axes[nearest.argmin(axis=0)].mean(axis=1)
    np.testing.assert_allclose(radii, 5.0 * SMALL.radius, atol=0.2)


def test_files_are_written_by_their_suffix(tmp_path):
    for suffix in ("pdf", "svg"):
        print_target(SMALL, tmp_path / f"target.{suffix}")
        assert (tmp_path / f"target.{suffix}").read_bytes() == page_bytes(SMALL, suffix)
    with pytest.raises(InputError, match=r"neither a \.pdf nor an \.svg"):
        print_target(SMALL, tmp_path / "target.png")
    with pytest.raises(InputError, match="cannot be written"):
        print_target(SMALL, Path("/dev/null") / "target.svg")


@pytest.mark.parametrize("paper", PAPERS)
def test_a_target_made_for_a_paper_is_the_largest_that_fits_it(paper):
    made = on_paper(DELTALAB_TARGET, paper)
    assert sheet(made, paper).paper == paper
    factor = made.radius / DELTALAB_TARGET.radius
    np.testing.assert_allclose(made.dots, factor * DELTALAB_TARGET.dots)
    more = (factor + 0.05) / factor
    larger = Target("t", more * made.dots, more * made.radius)
    with pytest.raises(InputError, match=f"does not fit {paper}"):
        sheet(larger, paper)
