"""The identification Jacobian against differences and against arb's exact derivatives."""

import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.calibration import leg_jacobian, robot_jacobian
from cpcal.common.errors import InputError
from cpcal.robot import DELTALAB, Pose, inverse_kinematics, normalised

X = DELTALAB.parameters[2]


def poses(seed, count=8):
    rng = np.random.default_rng(seed)
    return Pose(rng.normal([0, 0, 350], 40, (count, 3)), normalised(rng.normal([4, 0, 0, 0], 1, (count, 4))))


def equation(x, pose, length, form):
    distance = np.linalg.norm(pose.position + pose.rotation @ x[3:6] - x[:3], axis=1)
    return distance**2 - (length + x[6]) ** 2 if form == "f" else distance - (length + x[6])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), form=st.sampled_from(["g", "f"]))
def test_it_is_the_derivative(seed, form):
    rng = np.random.default_rng(seed)
    pose, length, step = poses(seed), rng.uniform(0, 140, 8), rng.normal(0, 1, 7)
    numeric = [equation(X + t * step, pose, length, form) for t in (1e-3, -1e-3)]
    found = leg_jacobian(X, pose, length, form=form) @ step
    assert_allclose(found, (numeric[0] - numeric[1]) / 2e-3, rtol=1e-6, atol=1e-6)


def exact_row(x, position, quaternion, length, form):
    """One row in balls of 200 bits, by the quotient of exact differences: the remainder term is enclosed too.

    h(t) = f(x + t e_i) is a polynomial of degree 2 in t, so that its central difference is the derivative; and
    dg = df / (2 ||v||) but for the length's part, which is -1.
    """
    saved, flint.ctx.prec = flint.ctx.prec, 200
    try:
        x, position, q = ([flint.arb(float(v)) for v in values] for values in (x, position, quaternion))
        length = flint.arb(float(length))
        w, r = q[0], q[1:]
        scale = sum((v * v for v in q[1:]), w * w)

        def cross(u, v):
            return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]

        def vector(y):
            once = cross(r, y[3:6])
            twice = cross(r, once)
            return [
                p + b + 2 * (w * o + t) / scale - a
                for p, a, b, o, t in zip(position, y[:3], y[3:6], once, twice, strict=True)
            ]

        def f(y):
            return sum(v * v for v in vector(y)) - (length + y[6]) ** 2

        row = []
        for i in range(7):
            up, down = list(x), list(x)
            up[i], down[i] = up[i] + 1, down[i] - 1
            row.append((f(up) - f(down)) / 2)
        if form == "g":
            twice = 2 * sum(v * v for v in vector(x)).sqrt()
            row = [value / twice for value in row[:6]] + [flint.arb(-1)]
        return [float(value.mid()) for value in row]
    finally:
        flint.ctx.prec = saved


@pytest.mark.parametrize("form", ["g", "f"])
def test_it_agrees_with_arb(form):
    pose, length = poses(1), np.random.default_rng(2).uniform(0, 140, 8)
    found = leg_jacobian(X, pose, length, form=form)
    rows = zip(pose.position, pose.quaternion, length, strict=True)
    exact = np.array([exact_row(X, p, q, reading, form) for p, q, reading in rows])
    assert_allclose(found, exact, rtol=1e-12, atol=1e-12 * np.abs(exact).max())


def test_where_the_equations_hold_the_two_differ_by_twice_the_length():
    pose = poses(3)
    of_g, of_f = (robot_jacobian(DELTALAB, pose, form=form) for form in ("g", "f"))
    total = (inverse_kinematics(DELTALAB, pose) + DELTALAB.offset).T
    assert of_g.shape == (6, 8, 7)
    assert_allclose(of_f, 2.0 * total[..., None] * of_g, rtol=1e-12)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="give 7 parameters"):
        leg_jacobian(X[:6], poses(1))
    with pytest.raises(InputError, match='choose "f"'):
        leg_jacobian(X, poses(1), form="squared")
    together = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
    with pytest.raises(InputError, match=r"pose 0 .* the length 0"):
        leg_jacobian([1, 2, 3, 1, 2, 3, 0], together)
