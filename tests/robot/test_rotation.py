"""Quaternions against their defining properties."""

from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.robot import kinematics
from cpcal.robot.kinematics import (
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    rotation_vector,
    small_rotation,
)
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, evaluate

component = st.floats(-10, 10).map(lambda value: 0.0 if abs(value) < 1e-3 else value)
quaternions = st.tuples(component, component, component, component).filter(any)


@settings(max_examples=20, deadline=None)
@given(quaternions)
def test_the_entries_over_any_ring_are_those_over_fractions(q):
    exact, norm = kinematics.rotation_numerators(map(Fraction, q))
    points = [IntervalArray.point(value) for value in q]
    network = ConstraintNetwork()
    symbol = network.variable("q", 4)
    enclosed, norm_enclosed = kinematics.rotation_numerators(points)
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
    w, x, y, z = map(Fraction, q)
    assert exact[0] == [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)]
    assert_allclose(rotation_matrix(q), (np.array(exact) / norm).astype(float), atol=2e-15)  # to a few ulps
    assert np.linalg.det(rotation_matrix(q)) > 0.0


@given(quaternions, quaternions)
def test_products_compose_conjugates_are_inverse_and_matrices_come_back(p, q):
    one, other = rotation_matrix(p), rotation_matrix(q)
    assert_allclose(rotation_matrix(quaternion_product(p, q)), one @ other, atol=1e-13)
    assert_allclose(rotation_matrix(quaternion_conjugate(q)), other.T, atol=1e-14)
    back = quaternion_from_matrix(other)
    assert back[0] >= 0
    assert_allclose(rotation_matrix(back), other, atol=1e-13)


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3))
def test_rotation_vectors_come_back_and_small_rotations_are_theirs_up_to_a_twelfth_of_their_square(v):
    v = np.array(v)
    assert_allclose(rotation_vector(quaternion_from_rotation_vector(v)), v, atol=1e-13)
    small = 1e-3 * v
    assert_allclose(rotation_vector(small_rotation(small)), small * (1 - small @ small / 12), rtol=1e-9, atol=1e-300)
