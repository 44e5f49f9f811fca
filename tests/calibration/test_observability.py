"""Observability indices against their definitions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.calibration import column_scale, observability, robot_jacobian
from cpcal.common.errors import InputError
from cpcal.robot import DELTALAB, Pose
from cpcal.simulate import simulate

INDICES = ["product", "condition", "smallest", "noise_amplification"]


def jacobian(extremal=True, random_poses=64):
    """Of all six legs at poses of the nominal DeltaLab platform."""
    plan = simulate(seed=1, extremal=extremal, random_poses=random_poses, noise=0.0, deviation=0.0, factor=0.0)
    return robot_jacobian(DELTALAB, Pose(plan.position, plan.quaternion))


J = jacobian()


def goodness(found, index):
    value = getattr(found, index)
    return 1.0 / value if index == "condition" else value


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(4, 12))
def test_the_indices_are_their_definitions(seed, rows):
    matrix = np.random.default_rng(seed).normal(size=(rows, 4))
    found, gram = observability(matrix), matrix.T @ matrix
    eigenvalues = np.linalg.eigvalsh(gram)
    assert found.product == pytest.approx(np.linalg.det(gram) ** (1 / 8) / np.sqrt(rows), rel=1e-6)
    assert found.condition == pytest.approx(np.linalg.cond(matrix), rel=1e-6)
    assert found.smallest == pytest.approx(np.linalg.norm(matrix, -2), rel=1e-6)
    assert found.noise_amplification == pytest.approx(eigenvalues[0] / np.sqrt(eigenvalues[-1]), rel=1e-6)
    assert np.linalg.norm(matrix @ found.weakest[0]) == pytest.approx(found.smallest, rel=1e-9)
    assert np.linalg.norm(found.weakest) == pytest.approx(1.0)


def test_several_legs_are_one_block_diagonal_jacobian():
    blocks = np.zeros((2 * J.shape[1], 14))
    blocks[: J.shape[1], :7], blocks[J.shape[1] :, 7:] = J[0], J[1]
    assert_allclose(observability(J[:2]).singular_values, np.linalg.svd(blocks, compute_uv=False), rtol=1e-12)
    assert observability(J[:2]).smallest == pytest.approx(min(observability(J[k]).smallest for k in (0, 1)))


def test_what_is_not_determined_has_the_indices_of_that():
    found = observability(np.array([[1.0, 1.0], [2.0, 2.0], [0.1, 0.1]]))
    assert (found.smallest, found.product, found.noise_amplification, found.condition) == (0.0, 0.0, 0.0, np.inf)
    assert_allclose(np.abs(found.weakest), [[np.sqrt(0.5), np.sqrt(0.5)]])
    assert observability(J[0, :6]).smallest == 0.0  # six poses, seven parameters


def test_scales_are_units_of_the_parameters():
    scale = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.1])
    assert_allclose(observability(J[0], scale).singular_values, np.linalg.svd(J[0] * scale, compute_uv=False))
    lengths = np.diag([1.0, 10.0, 0.01]) @ np.random.default_rng(1).normal(size=(3, 3))
    bad = np.random.default_rng(2).normal(size=(9, 3)) * [1.0, 1e4, 1e-3]
    assert observability(bad, column_scale(bad)).condition < 10 < 1e6 < observability(bad).condition
    assert_allclose(np.mean((lengths * column_scale(lengths)) ** 2, axis=0), 1.0)


def test_extremal_poses_observe_better_than_random_ones():
    """What the paper says of its 64 extremal configurations (section 2.3.2, after its reference 7)."""
    extremal, random = observability(J[:, :64]), observability(J[:, 64:])
    for index in INDICES:
        assert goodness(extremal, index) > 1.9 * goodness(random, index)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="not finite"):
        observability(np.array([[np.nan, 1.0]]))
    with pytest.raises(InputError, match="does not fit"):
        observability(J[0], [1.0, 1.0])
