"""Simulated campaigns: determinism, extremal configurations, noise, and what 7 parameters cannot describe."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.common.errors import InputError
from cpcal.files import campaign_sha256
from cpcal.robot import (
    DELTALAB,
    KinematicsError,
    quaternion_conjugate,
    quaternion_product,
    rotation_matrix,
)
from cpcal.simulate import simulate, true_robot
from cpcal.simulate.campaigns import assembled


def test_the_same_seed_gives_the_same_campaign_bit_for_bit():
    first, second = (simulate(seed=7, runs=2, random_poses=5, joint_error=1.0) for _ in range(2))
    assert first == second
    assert campaign_sha256(first) == campaign_sha256(second)
    assert campaign_sha256(simulate(seed=8)) != campaign_sha256(simulate(seed=7))


def test_the_64_extremal_configurations_are_distinct_with_every_leg_at_an_end():
    campaign = simulate(seed=0, noise=0.0, deviation=0.0)
    total = campaign.length + DELTALAB.offset
    assert_allclose(np.minimum(abs(total - 345), abs(total - 485)), 0.0, atol=1e-9)
    assert len({tuple(row) for row in np.round(campaign.length).tolist()}) == 64
    both = np.concatenate([campaign.position, 300 * campaign.quaternion], axis=1)
    distance = np.linalg.norm(both[:, None] - both, axis=2) + 1e3 * np.eye(64)
    assert distance.min() > 40  # some pairs differ in rotation alone
    assert campaign.length[0b100101] == pytest.approx([140, 0, 140, 0, 0, 140])
    assert campaign.position[:, 2].min() > 200
    assert rotation_matrix(campaign.quaternion)[:, 2, 2].min() > np.cos(np.radians(40))


@pytest.mark.parametrize("truncate", [3.0, 1.0])
def test_truncated_noise_leaves_the_truth_inside_the_reading_sets(truncate):
    noisy = simulate(seed=5, runs=60, truncate=truncate, factor=truncate)
    clean = simulate(seed=5, runs=60, noise=0.0)
    assert (abs(noisy.position - clean.position) < noisy.position_radius).all()
    assert (abs(noisy.length - clean.length) < noisy.length_radius).all()
    # the true rotation is R(1, s) R(q_k), and |2 s_i| <= r_i
    turn = quaternion_product(clean.quaternion, quaternion_conjugate(noisy.quaternion))
    size = abs(2 * turn[:, 1:] / turn[:, :1])
    assert (size < noisy.rotation_radius).all()
    assert (size.max(axis=0) > 0.9 * noisy.rotation_radius[0]).all()


def test_all_senseless_options_are_named_at_once():
    with pytest.raises(InputError) as caught:
        simulate(seed=-1, runs=0, random_poses=1.5, joint_error=-1.0, factor=float("nan"), noise=-1, truncate=0)
    named = [problem.where for problem in caught.value.problems]
    assert sorted(named) == sorted(
        f"option {name}" for name in ("seed", "runs", "random_poses", "joint_error", "factor", "noise", "truncate")
    )
    with pytest.raises(InputError, match="stroke"):
        simulate(seed=0, stroke=(140.0, 0.0))
    with pytest.raises(InputError, match="random_poses"):
        simulate(seed=0, extremal=False)
    with pytest.raises(InputError, match="within 10,000,000"):
        simulate(seed=0, runs=1_000_000)


def test_a_robot_that_cannot_be_assembled_is_refused():
    with pytest.raises(KinematicsError, match="no pose found for 1 of 2 rows"):
        assembled(DELTALAB, np.array([[70.0] * 6, [0.0, 900.0, 0.0, 0.0, 0.0, 900.0]]), (0.0, 140.0))


def test_provenance_without_a_truth_has_no_true_robot():
    campaign = simulate(seed=0)
    for provenance in ({"true_parameters": "rubbish"}, {"true_parameters": "[" * 15_000}, {}):
        assert true_robot(dataclasses.replace(campaign, provenance=provenance)) is None
