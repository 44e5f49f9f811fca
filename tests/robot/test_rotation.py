"""Quaternions against their defining properties."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.robot import kinematics
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, evaluate

component = st.floats(-10, 10).map(lambda value: 0.0 if abs(value) < 1e-3 else value)
quaternions = st.tuples(component, component, component, component).filter(any)
vectors = st.tuples(*[st.floats(-1.8, 1.8)] * 3)


@given(quaternions)
def test_the_matrix_of_any_quaternion_is_a_rotation(q):
    matrix = kinematics.rotation_matrix(q)
    assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@settings(max_examples=20, deadline=None)
@given(quaternions)
def test_the_entries_over_any_ring_are_those_over_fractions(q):
    exact, norm = kinematics.rotation_numerators(map(Fraction, q))
    points = [IntervalArray.point(value) for value in q]
    network = ConstraintNetwork()
    symbol = network.variable("q", 4)
    for name in ("float64", "arb"):
        enclosed, norm_enclosed = kinematics.rotation_numerators(points, get_arithmetic(name))
        assert float(norm_enclosed.lo) <= norm <= float(norm_enclosed.hi)
        for row, other in zip(exact, enclosed, strict=True):
            assert all(float(e.lo) <= v <= float(e.hi) for v, e in zip(row, other, strict=True))
    expressions, _ = kinematics.rotation_numerators(symbol[k] for k in range(4))
    for row, other in zip(exact, expressions, strict=True):
        for value, expression in zip(row, other, strict=True):
            box = evaluate(network, expression, Box(network.names, q, q))
            assert float(box.lo) <= value <= float(box.hi)
    columns = np.array(exact) @ np.array(exact).T  # orthogonal, exactly: |q|^4 times the identity
    assert (columns == np.eye(3, dtype=int) * norm * norm).all()


@given(quaternions)
def test_the_matrix_is_the_rational_one_to_a_few_ulps(q):
    w, x, y, z = map(Fraction, q)
    exact = [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)]
    norm = w * w + x * x + y * y + z * z
    assert_allclose(kinematics.rotation_matrix(q)[0], [float(e / norm) for e in exact], atol=2e-15)


@given(quaternions, quaternions)
def test_products_compose(p, q):
    both = kinematics.rotation_matrix(kinematics.quaternion_product(p, q))
    assert_allclose(both, kinematics.rotation_matrix(p) @ kinematics.rotation_matrix(q), atol=1e-13)


@given(quaternions)
def test_conjugate_is_the_inverse(q):
    assert_allclose(
        kinematics.rotation_matrix(kinematics.quaternion_conjugate(q)), kinematics.rotation_matrix(q).T, atol=1e-14
    )


@given(quaternions)
def test_matrix_round_trip(q):
    back = kinematics.quaternion_from_matrix(kinematics.rotation_matrix(q))
    assert back[0] >= 0
    assert_allclose(kinematics.rotation_matrix(back), kinematics.rotation_matrix(q), atol=1e-13)


@given(vectors)
def test_rotation_vector_round_trip(v):
    assert_allclose(kinematics.rotation_vector(kinematics.quaternion_from_rotation_vector(v)), v, atol=1e-13)


def test_a_quarter_turn_about_z_takes_x_to_y():
    q = kinematics.quaternion_from_rotation_vector([0.0, 0.0, np.pi / 2])
    assert_allclose(kinematics.rotation_matrix(q) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


def test_a_small_rotation_is_the_rotation_vector_up_to_a_twelfth_of_its_square():
    v = np.array([1e-3, -2e-3, 1.5e-3])
    found = kinematics.rotation_vector(kinematics.small_rotation(v))
    angle_squared = v @ v
    assert_allclose(found, v * (1 - angle_squared / 12), rtol=1e-9)


def test_everything_is_vectorised():
    rng = np.random.default_rng(0)
    q, v = rng.standard_normal((2, 5, 4)), rng.uniform(-1, 1, (2, 5, 3))
    assert kinematics.rotation_matrix(q).shape == (2, 5, 3, 3)
    single = kinematics.rotation_matrix(q[1, 3])
    assert np.array_equal(kinematics.rotation_matrix(q)[1, 3], single)
    assert np.array_equal(kinematics.quaternion_product(q, q)[1, 3], kinematics.quaternion_product(q[1, 3], q[1, 3]))
    assert kinematics.quaternion_from_matrix(kinematics.rotation_matrix(q)).shape == (2, 5, 4)
    assert kinematics.rotation_vector(kinematics.quaternion_from_rotation_vector(v)).shape == v.shape
    assert kinematics.small_rotation(v).shape == (2, 5, 4)
