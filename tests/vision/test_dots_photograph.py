"""A real photograph of a plate with a grid of dark dots, a smudge and a shadowed corner."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cpcal.vision.dots import observe_dots
from cpcal.vision.opencv import opencv

PHOTOGRAPH = Path(__file__).resolve().parents[3] / "shared" / "data" / "dots" / "dot_pattern_05.jpg"

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not PHOTOGRAPH.exists(), reason=f"the photograph of dots is not at {PHOTOGRAPH}"),
]


def grid_indices(centers):
    """Column and row (n, 2) of dots on a nearly regular upright grid, walking from neighbour to neighbour; -1 where the
    walk does not come."""
    tree = cKDTree(centers)
    near = np.asarray(tree.query(centers, 5)[1])[:, 1:]
    steps = (centers[near] - centers[:, None]).reshape(-1, 2)
    wide = np.abs(steps[:, 0]) > np.abs(steps[:, 1])
    right = np.median(steps[wide & (steps[:, 0] > 0.0)], axis=0)
    down = np.median(steps[~wide & (steps[:, 1] > 0.0)], axis=0)
    index = np.full((len(centers), 2), np.iinfo(np.int64).min)
    start = int(((centers - centers.mean(axis=0)) ** 2).sum(axis=1).argmin())
    index[start], todo = 0, [start]
    while todo:
        one = todo.pop()
        for sign, (axis, step) in ((s, move) for s in (-1, 1) for move in enumerate((right, down))):
            distance, other = tree.query(centers[one] + sign * step)
            if distance < 0.25 * np.linalg.norm(step) and index[other, 0] == np.iinfo(np.int64).min:
                index[other] = index[one] + sign * np.eye(2, dtype=np.int64)[axis]
                todo.append(int(other))
    reached = index[:, 0] > np.iinfo(np.int64).min
    index[reached] -= index[reached].min(axis=0)
    index[~reached] = -1
    return index


def grid_residuals(centers, index, degree):
    """The residuals (n, 2) of centres to the polynomials of a degree of their column and row, by least squares."""
    half = 0.5 * index.max(axis=0)
    x, y = (index / half - 1.0).T
    terms = np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
    return np.asarray(centers - terms @ np.linalg.lstsq(terms, centers, rcond=None)[0])


def test_every_dot_of_the_photograph_to_a_hundredth_of_a_pixel():
    """They lie on smooth grids, polynomials of column and row; JPEG's noise is not white."""
    found = observe_dots(opencv().imread(str(PHOTOGRAPH), opencv().IMREAD_UNCHANGED))
    index = grid_indices(found.centers)
    assert not found.bright
    assert len(found) == 4315 == len(np.unique(index, axis=0))
    assert (index >= 0).all()
    for degree in (5, 6, 7):
        residual = grid_residuals(found.centers, index, degree)
        assert np.sqrt((residual**2).mean(axis=0)).max() <= 0.012
    over = np.linalg.solve(np.linalg.cholesky(found.covariance), residual[..., None])[..., 0]
    assert np.count_nonzero(np.linalg.norm(over, axis=1) > 4.0) < 0.005 * len(found)
    stated = np.sqrt(np.median(found.covariance[:, 0, 0]))
    assert 0.8 < stated / np.mean(np.sqrt((residual**2).mean(axis=0))) < 1.7


def test_over_a_thousand_soft_dots_of_a_wide_lens_are_found_in_the_halved_image():
    """Twelve megapixels, whose dots no blurred ellipse explains before the image is halved."""
    image = opencv().imread(str(PHOTOGRAPH.with_name("GoPro8_dot_pattern.jpg")), opencv().IMREAD_GRAYSCALE)
    found = observe_dots(image, bright=False)
    assert found.halvings
    assert len(found) > 1150
    index = grid_indices(found.centers)
    assert (index >= 0).all(axis=1).mean() > 0.9  # the walk by one step for all ends where the lens bends most
