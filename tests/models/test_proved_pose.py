"""Proved poses: the box holds the true pose, and nothing is proved where there is none, or more than one."""

from fractions import Fraction as F

import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cpcal.common.errors import InputError
from cpcal.models import prove_pose
from cpcal.robot import (
    DELTALAB,
    Pose,
    Robot,
    central_pose,
    forward_kinematics,
    forward_poses,
    inverse_kinematics,
    normalised,
    quaternion_from_rotation_vector,
    quaternion_product,
)
from cpcal.solver.interval import get_arithmetic
from tests.checker.proofs import rotation_of

CENTRE = central_pose(DELTALAB, [70.0] * 6)

# v with a whole norm: legs whose exact length is a float
TRIPLES = np.array([[3, 4, 12, 13], [-4, 3, 12, 13], [2, -10, 11, 15], [6, 6, 7, 11], [-2, 6, 9, 11], [1, -12, 12, 17]])


def exact_platform(seed):
    """A robot, readings and a pose that solves its equations exactly: dyadic joints, a rotation of whole numbers."""
    rng = np.random.default_rng(seed)
    position = rng.integers(-400, 400, 3) / 8 + np.array([0, 0, 300])
    mobile = rng.integers(-1600, 1600, (6, 3)) / 8
    quaternion = np.array([[1.0, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 1], [1, 0, -1, 0]])[seed % 4]
    turned = (
        np.array([[F(x) for x in row] for row in mobile.tolist()])
        @ np.array(rotation_of([F(v) for v in quaternion.tolist()])).T
    )
    vectors = 25.0 * rng.permutation(TRIPLES)
    base = position + turned.astype(float) - vectors[:, :3]
    offset = np.full(6, 100.0)
    return Robot("exact", base, mobile, offset), vectors[:, 3] - offset, Pose(position, quaternion)


def exact_s(proved, truth):
    """The s with R(1, s) R(proved.quaternion) = R(truth), in fractions: q truth * conjugate(proved.quaternion)."""
    w, x, y, z = (F(v) for v in truth.quaternion.tolist())
    p = [F(v) for v in proved.quaternion.tolist()]
    p = [p[0], -p[1], -p[2], -p[3]]
    scalar = w * p[0] - x * p[1] - y * p[2] - z * p[3]
    vector = [
        w * p[1] + x * p[0] + y * p[3] - z * p[2],
        w * p[2] - x * p[3] + y * p[0] + z * p[1],
        w * p[3] + x * p[2] - y * p[1] + z * p[0],
    ]
    return [v / scalar for v in vector]


def moved(pose, seed, far):
    rng = np.random.default_rng(seed)
    turn = quaternion_from_rotation_vector(far * 0.003 * rng.normal(size=3))
    return Pose(pose.position + far * rng.normal(size=3), normalised(quaternion_product(turn, pose.quaternion)))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("arithmetic", ["float64", "arb"])
def test_the_box_holds_the_true_pose(seed, arithmetic):
    """Truth in exact numbers, start next to it: inside to the last bit, and the box is of the size of rounding."""
    robot, readings, truth = exact_platform(seed)
    proved = prove_pose(robot, readings, moved(truth, seed, 1e-3), arithmetic=get_arithmetic(arithmetic))
    if proved is None:  # such a random platform may be nearly singular
        assert seed not in range(8)
        return
    point = [*(F(v) for v in truth.position.tolist()), *exact_s(proved, truth)]
    assert all(F(lo) <= v <= F(hi) for lo, v, hi in zip(proved.box.lo, point, proved.box.hi, strict=True))
    assert proved.box.subset(proved.region)
    assert proved.position_radius.max() < 1e-8


@settings(max_examples=15, deadline=None)
@given(readings=st.lists(st.floats(0, 140), min_size=6, max_size=6), seed=st.integers(0, 1000))
def test_any_pose_of_a_deltalab_robot_is_proved(readings, seed):
    robot = Robot.from_parameters("r", DELTALAB.parameters + np.random.default_rng(seed).normal(0, 2, (6, 7)))
    pose = forward_kinematics(robot, readings, central_pose(robot, [70.0] * 6))
    proved = prove_pose(robot, readings, pose)
    assert proved is not None
    assert proved.position_radius.max() < 1e-10
    assert proved.rotation_radius.max() < 1e-12
    np.testing.assert_allclose(proved.pose.position, pose.position, atol=1e-9)
    np.testing.assert_allclose(proved.pose.rotation, pose.rotation, atol=1e-11)


def test_newtons_method_in_200_bits_ends_inside_the_box():
    readings = [10.0, 130.0, 40.0, 77.0, 5.0, 99.0]
    proved = prove_pose(DELTALAB, readings, forward_kinematics(DELTALAB, readings, CENTRE))
    saved, flint.ctx.prec = flint.ctx.prec, 200
    try:
        x = [flint.arb(float(v)) for v in proved.box.mid]
        for _ in range(6):
            value, jacobian = equations(DELTALAB, readings, proved.quaternion, x)
            step = jacobian.solve(value)
            x = [(x[i] - step[i, 0]).mid() for i in range(6)]
        inside = [lo <= float_below(v) and float_above(v) <= hi for lo, v, hi in zip(*bounds(proved, x), strict=True)]
    finally:
        flint.ctx.prec = saved
    assert all(inside)


def bounds(proved, x):
    return proved.box.lo, x, proved.box.hi


def float_below(value):
    return np.nextafter(float(value), -np.inf)


def float_above(value):
    return np.nextafter(float(value), np.inf)


def equations(robot, readings, quaternion, x):
    """f (6, 1) and df/d(P, s) (6, 6) in balls; R(1, s) R(q) b by Rodrigues' formula, its derivative by differences."""
    w, r = flint.arb(float(quaternion[0])), [flint.arb(float(v)) for v in quaternion[1:]]

    def cross(u, v):
        return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]

    def turned(scalar, vector, v):
        once = cross(vector, v)
        twice = cross(vector, once)
        scale = scalar * scalar + sum(c * c for c in vector)
        return [a + 2 * (scalar * b + c) / scale for a, b, c in zip(v, once, twice, strict=True)]

    def f(y, leg):
        arm = turned(flint.arb(1), y[3:], turned(w, r, [flint.arb(float(v)) for v in robot.mobile[leg]]))
        vector = [p + u - flint.arb(float(a)) for p, u, a in zip(y[:3], arm, robot.base[leg], strict=True)]
        total = flint.arb(float(readings[leg])) + flint.arb(float(robot.offset[leg]))
        return sum(v * v for v in vector) - total * total

    step = flint.arb(2) ** -60
    value = flint.arb_mat(6, 1, [f(x, leg) for leg in range(6)])
    rows = []
    for leg in range(6):
        for i in range(6):
            up, down = list(x), list(x)
            up[i], down[i] = up[i] + step, down[i] - step
            rows.append((f(up, leg) - f(down, leg)) / (2 * step))
    return value, flint.arb_mat(6, 6, rows)


def test_nothing_is_proved_on_a_singular_platform():
    """Equal hexagons: the platform can move with all lengths fixed, so no solution is alone."""
    angles = np.arange(6) * np.pi / 3 + 0.1 * (-1.0) ** np.arange(6)
    ring = 200.0 * np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    robot = Robot("parallelogram", ring, ring, np.zeros(6))
    for height in (200.0, 300.0):
        pose = Pose(np.array([0.0, 0.0, height]), np.array([1.0, 0.0, 0.0, 0.0]))
        assert prove_pose(robot, [height] * 6, pose) is None


def test_nothing_is_proved_where_the_legs_cannot_meet():
    assert prove_pose(DELTALAB, [0.0, 2000.0, 0.0, 0.0, 0.0, 0.0], CENTRE) is None


def test_what_is_no_question_is_refused():
    for robot, readings, pose, message in [
        (Robot.from_parameters("five", DELTALAB.parameters[:5]), [70.0] * 5, CENTRE, "exactly six legs"),
        (DELTALAB, np.zeros((2, 6)), CENTRE, "one pose at a time"),
        (DELTALAB, [70.0, -345.0, 70.0, np.nan, 70.0, 70.0], CENTRE, "leg 4: does not have a finite length"),
        (DELTALAB, [70.0] * 6, Pose(CENTRE.position, np.zeros(4)), "near: is not one pose"),
    ]:
        with pytest.raises(InputError, match=message):
            prove_pose(robot, readings, pose)


def test_forward_kinematics_reports_row_by_row():
    readings = np.full((2, 2, 6), 70.0)
    readings[1, 0, 1] = 2000.0
    found, converged = forward_poses(DELTALAB, readings, CENTRE)
    assert converged.tolist() == [[True, True], [False, True]]
    assert np.isnan(found.position[1, 0]).all()
    assert np.abs(inverse_kinematics(DELTALAB, found) - readings)[converged].max() < 1e-9
