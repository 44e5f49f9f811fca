"""The lean stand-ins for numpy's general functions give what those give."""

import numpy as np
import pytest

from cpcal.vision.projection import determinants, eigenvalues, inverses, median


def test_symmetric_matrices_as_lapack_has_them() -> None:
    half = np.random.default_rng(1).normal(size=(500, 2, 2))
    matrices = half @ half.transpose(0, 2, 1) + 0.01 * np.eye(2)
    largest = np.linalg.eigvalsh(matrices)[:, 1:]
    assert np.abs((eigenvalues(matrices) - np.linalg.eigvalsh(matrices)) / largest).max() < 1e-14
    np.testing.assert_allclose(determinants(matrices), np.linalg.det(matrices), rtol=1e-11)
    np.testing.assert_allclose(inverses(matrices) @ matrices, np.broadcast_to(np.eye(2), (500, 2, 2)), atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 133])
def test_the_median_is_numpys(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)
    values[count // 2] = np.nan
    assert np.isnan(median(values))
