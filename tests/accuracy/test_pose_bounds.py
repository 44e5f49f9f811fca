"""The true pose of a robot whose model error is as assumed lies where it is proved to lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cpcal.accuracy.certified_set import SIZE, certified_set
from cpcal.accuracy.estimates import distances, true_poses
from cpcal.accuracy.pose_bounds import cell_bounds, pose_bounds
from cpcal.accuracy.pose_cells import Cells
from cpcal.robot import (
    Pose,
    central_pose,
    forward_kinematics,
    normalised,
    quaternion_conjugate,
    quaternion_product,
    small_rotation,
)
from cpcal.solver.interval import IntervalArray


def unseen(known, count, seed):
    readings = np.random.default_rng(seed).uniform(5.0, 135.0, (count, 6))
    return forward_kinematics(known.controller, readings, central_pose(known.controller, np.full(6, 70.0)))


def z_of(one, x):
    alpha, beta, rest = x[:3] - one.controller[:3], x[3:6] - one.controller[3:6], x[6] - one.controller[6]
    return np.concatenate([alpha, beta, [rest, alpha @ alpha + beta @ beta - rest**2], np.outer(alpha, beta).ravel()])


def test_the_certified_set_holds_the_true_parameters(known):
    rng = np.random.default_rng(1)
    for one, x in zip(known.sets, known.truth.parameters, strict=True):
        z = z_of(one, x)
        assert ((one.box.lo <= z) & (z <= one.box.hi)).all()
        along = one.basis.T @ z[:7]
        assert ((one.along.lo <= along + 1e-9) & (along - 1e-9 <= one.along.hi)).all()
    directions = rng.standard_normal((5, SIZE))
    found = one.ranges(directions)
    assert ((found.lo <= directions @ z) & (directions @ z <= found.hi)).all()


def test_a_model_error_that_the_campaign_refutes_leaves_no_set(known):
    wrong = known.campaign.length.copy()
    wrong[3, 0] += 5.0
    campaign = replace(known.campaign, length=wrong)
    x = known.controller.parameters[0]
    assert certified_set(campaign, 1, 0.02, center=x, delta=8.0, controller=x) is None


def test_the_true_pose_lies_in_the_proved_box_and_within_both_bounds(known):
    poses = unseen(known, 12, 2)
    found = pose_bounds(poses, known.sets)
    true = true_poses(known.campaign, known.controller, poses)
    assert found.proved.all()
    position, angle = distances(true, poses)
    assert (position <= found.position).all()
    assert (angle <= found.rotation).all()
    turn = quaternion_product(true.quaternion, quaternion_conjugate(poses.quaternion))
    inside = np.concatenate([true.position - poses.position, turn[:, 1:] / turn[:, :1]], axis=1)
    assert ((found.box.lo <= inside) & (inside <= found.box.hi)).all()
    # and what is not of first order counts for little
    assert (found.position <= 1.2 * found.share.sum(axis=1)).all()


def test_a_drawing_far_from_the_truth_is_bounded_as_well(known):
    nominal = known.campaign.robot
    sets = [
        certified_set(known.campaign, k + 1, 0.02, center=x, delta=8.0, controller=nominal.parameters[k])
        for k, x in enumerate(known.controller.parameters)
    ]
    poses = unseen(known, 4, 4)
    found, (position, angle) = pose_bounds(poses, sets), distances(true_poses(known.campaign, nominal, poses), poses)
    assert found.proved.all()
    assert (position <= found.position).all()
    assert (angle <= found.rotation).all()
    assert (found.position < 2.0 * position + 0.5).all()


@pytest.mark.parametrize(("reach", "turn"), [(3.0, 0.0), (3.0, 0.01), (12.0, 0.0)])
def test_the_bound_of_a_cell_holds_for_every_pose_in_it(known, reach, turn):
    rng = np.random.default_rng(5)
    middle = np.concatenate([central_pose(known.controller, np.full(6, 70.0)).position, np.zeros(3)])
    size = np.array([reach] * 3 + [turn] * 3)
    cells = Cells.of_boxes(IntervalArray((middle - size)[None], (middle + size)[None]))
    over, center = cell_bounds(cells, known.sets)
    assert over.proved.all()
    assert (center.position <= over.position).all()
    drawn = middle + size * rng.uniform(-1.0, 1.0, (20, 6))
    drawn[:4, :3] = middle[:3] + reach * np.array([[1, 1, 1], [1, -1, 1], [-1, 1, -1], [-1, -1, -1]])
    poses = Pose(drawn[:, :3], normalised(small_rotation(2.0 * drawn[:, 3:])))
    position, angle = distances(true_poses(known.campaign, known.controller, poses), poses)
    assert (position <= over.position).all()
    assert (angle <= over.rotation).all()
    alone = pose_bounds(poses, known.sets)
    assert (alone.position <= over.position * (1.0 + 1e-9)).all()


def test_nothing_is_proved_where_the_platform_is_singular(known):
    # a Gough platform that is turned by about 90 degrees about its axis can move with all legs held
    quarter = np.array([[np.cos(a / 2), 0.0, 0.0, np.sin(a / 2)] for a in np.radians([88.0, 90.0, 92.0])])
    height = central_pose(known.controller, np.full(6, 70.0)).position
    determinants = pose_bounds(Pose(np.tile(height, (3, 1)), quarter), known.sets)
    assert not determinants.proved[1]
    assert np.isinf(determinants.position[~determinants.proved]).all()
