"""The one loop of least squares: dense by singular values, and in blocks by the Schur complement."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.common.least_squares import Blocks, least_squares
from cpcal.common.values import Floats

RNG = np.random.default_rng(5)
VIEWS, ROWS = 7, 5
TIMES = RNG.uniform(0.0, 2.0, (VIEWS, ROWS))
HEIGHTS = RNG.uniform(1.0, 3.0, VIEWS)


def residual(x: Floats) -> Floats:
    """Decays of one rate (shared) and of a height of each view (its own), which meet at every reading."""
    return np.asarray(x[1:, None] * np.exp(-x[0] * TIMES) - HEIGHTS[:, None] * np.exp(-0.7 * TIMES))


def from_rows(residual: Floats, shared: Floats, own: Floats) -> Blocks:
    """Of residuals (v, r), r in each block, with derivatives (v, r, s) and (v, r, k)."""
    across = np.swapaxes(own, 1, 2)
    flat = shared.reshape(-1, shared.shape[2])
    sides = -flat.T @ residual.ravel(), -(across @ residual[..., None])[..., 0]
    return Blocks(flat.T @ flat, sides[0], across @ shared, across @ own, sides[1])


def blocks(x: Floats) -> Blocks:
    decay = np.exp(-x[0] * TIMES)
    return from_rows(residual(x), (-x[1:, None] * TIMES * decay)[..., None], decay[..., None])


def jacobian(x: Floats) -> Floats:
    decay = np.exp(-x[0] * TIMES)
    own = np.einsum("vr,vw->vrw", decay, np.eye(VIEWS))
    return np.concatenate([(-x[1:, None] * TIMES * decay)[..., None], own], axis=2).reshape(VIEWS * ROWS, -1)


@pytest.mark.parametrize("linear", [jacobian, blocks])
def test_shared_and_own_unknowns_are_found_with_and_without_elimination(linear) -> None:
    found = least_squares(residual, linear, np.ones(1 + VIEWS), tolerance=1e-12)
    assert found.settled
    assert_allclose(found.at, [0.7, *HEIGHTS], rtol=1e-9)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_a_step_in_blocks_solves_the_whole_normal_equations(damping: float) -> None:
    x = 1.0 + RNG.uniform(size=1 + VIEWS)
    J = jacobian(x)
    normal = J.T @ J
    expected = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -J.T @ residual(x).ravel())
    assert_allclose(blocks(x).step(damping), expected, rtol=1e-9)
    reduced, _ = blocks(x).reduced()
    assert_allclose(np.linalg.inv(reduced)[0, 0], np.linalg.inv(normal)[0, 0])


def test_places_that_are_refused_or_not_finite_are_never_entered() -> None:
    seen: list[float] = []

    def moved(x: float, step: Floats) -> float | None:
        return None if x + step[0] < 0.5 else x + float(step[0])

    def values(x: float) -> Floats:
        seen.append(x)
        return np.array([np.sqrt(x) if x > 0.0 else np.nan])

    found = least_squares(values, lambda x: np.array([[0.5 / np.sqrt(x)]]), 4.0, tolerance=1e-9, moved=moved)
    assert min(seen) >= 0.5
    assert 0.5 <= found.at < 0.51
