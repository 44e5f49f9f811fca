"""Imperfect legs: poses that satisfy the physical leg equations, mechanism by mechanism."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.robot import DELTALAB, KinematicsError, Pose, leg_vectors
from cpcal.simulate.campaigns import (
    STROKE,
    assembled,
    assembled_with,
    clearance_sides,
    configurations,
    leg_gaps,
    mechanisms_of,
    streams,
)

LARGE = {  # mm; the gain is relative
    "axis_offset": 20.0, "backlash": 20.0, "sag": 20.0, "gain": 0.2, "joint_error": 20.0,
}  # fmt: skip
READINGS = configurations(np.tile(np.array(STROKE)[:, None], 6), streams(5)[2], random_poses=20, extremal=True)[1]
IDEAL = assembled(DELTALAB, READINGS, STROKE)


def sampled(seed=1, **sizes):
    return mechanisms_of({"seed": seed, "stroke": STROKE, "friction": 0.0} | dict.fromkeys(LARGE, 0.0) | sizes)


def solved(**sizes):
    return assembled_with(DELTALAB, sampled(**sizes), READINGS, IDEAL)


@pytest.mark.parametrize("name", LARGE)
def test_poses_satisfy_the_six_leg_equations_to_rounding(name):
    mechanisms = sampled(**{name: LARGE[name]})
    pose = assembled_with(DELTALAB, mechanisms, READINGS, IDEAL)
    gaps = leg_gaps(DELTALAB, mechanisms, READINGS, pose, clearance_sides(DELTALAB, mechanisms, pose))
    assert np.abs(gaps).max() < 1e-10
    assert np.abs(pose.position - IDEAL.position).max() > 1.0


def test_a_lower_axis_offset_moves_the_end_of_the_leg_towards_it():
    """By trigonometry in the plane of the first axis and the leg, and not by the code's vectors."""
    mechanisms = sampled(axis_offset=7.0)
    pose = assembled_with(DELTALAB, mechanisms, READINGS, IDEAL)
    legs = leg_vectors(DELTALAB, pose)
    along = np.einsum("kni,ni->kn", legs, mechanisms.base_axis)
    across = np.sqrt(np.sum(legs**2, axis=-1) - along**2)
    assert_allclose(np.hypot(along, across - mechanisms.base_offset), 345 + READINGS, rtol=1e-12)


def test_legs_that_carry_the_platform_are_compressed_and_their_forces_balance_it():
    upright = Pose(np.array([0.0, 0.0, 359.41]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert (clearance_sides(DELTALAB, sampled(backlash=1.0), upright) == -1).all()
    side = clearance_sides(DELTALAB, sampled(backlash=1.0), IDEAL)
    assert 0.02 < (side > 0).mean() < 0.3  # in extremal poses some legs hold the platform down


def test_mechanisms_that_fit_no_pose_are_refused():
    with pytest.raises(KinematicsError, match="imperfections"):
        solved(gain=-0.9)
