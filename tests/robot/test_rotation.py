"""Quaternions against their defining properties."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.robot.kinematics import (
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    rotation_vector,
    small_rotation,
)

component = st.floats(-10, 10).map(lambda value: 0.0 if abs(value) < 1e-3 else value)
quaternions = st.tuples(component, component, component, component).filter(any)


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
