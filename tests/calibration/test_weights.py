"""Noise of readings and weights from it, rank that is due to noise, and options that are refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.calibration import LegEquations, Noise, fit
from cpcal.calibration.leg_equations import whitening
from cpcal.common.errors import InputError
from cpcal.robot import (
    DELTALAB,
    Campaign,
    Pose,
    inverse_kinematics,
    quaternion_from_rotation_vector,
    quaternion_product,
)
from cpcal.simulate import simulate


@pytest.fixture(scope="module")
def campaign():
    return simulate(seed=3)


def redrawn(clean, noise, rng):
    """`clean` with readings drawn from `noise`, whose pose covariances are diagonal."""
    moved = np.sqrt(np.diagonal(noise.pose, axis1=1, axis2=2)) * rng.standard_normal((len(clean), 6))
    turned = quaternion_product(quaternion_from_rotation_vector(moved[:, 3:]), clean.quaternion)
    length = clean.length + noise.length * rng.standard_normal(clean.length.shape)
    return replace(clean, position=clean.position + moved[:, :3], quaternion=turned, length=length)


def never_turning(rng, turn_sigma):
    """40 poses that differ in position, whose rotation is only noise; and the noise."""
    noise = Noise.from_sigmas([0.06, 0.02, 0.06], [turn_sigma] * 3, [0.01] * 6, count=40)
    position = np.array([0, 0, 360]) + rng.uniform(-60, 60, (40, 3))
    still = Pose(position, np.tile([1.0, 0, 0, 0], (40, 1)))
    clean = Campaign.of(DELTALAB, position, still.quaternion, inverse_kinematics(DELTALAB, still), exact=True)
    return redrawn(clean, noise, rng), noise


def test_rank_that_is_due_to_noise_is_said_to_be_and_the_fit_is_wrong_indeed():
    campaign, noise = never_turning(np.random.default_rng(6), 2e-4)
    found = fit(campaign, weights="joint", noise=noise)
    assert found.rank == 42
    assert found.noise_share > 0.5
    assert "IS THE NOISE ITSELF" in found.sentence
    assert np.sqrt(np.mean(((found.parameters - DELTALAB.parameters) / found.standard_errors) ** 2)) > 2
    good = simulate(seed=1)
    assert fit(good, noise=Noise.of(good)).noise_share < 1e-4
    assert "NOISE ITSELF" not in fit(good, noise=Noise.of(good)).sentence
    assert fit(good).noise_share is None


@pytest.mark.parametrize("form", ["f", "g"])
def test_the_share_of_the_noise_is_that_of_jacobians_with_redrawn_readings(form):
    clean, rng = simulate(seed=10, noise=0.0), np.random.default_rng(7)
    noise = Noise.from_sigmas([0.06, 0.02, 0.06], [2e-4] * 3, [0.3] * 6, count=64)
    found = fit(clean, legs=[2], form=form, noise=noise)

    def jacobian(campaign):
        return LegEquations.of(campaign, [2], form).by_parameters(found.parameters)[:, 0]

    changes = [jacobian(redrawn(clean, noise, rng)) - jacobian(clean) for _ in range(400)]
    half = np.linalg.inv(np.linalg.cholesky(jacobian(clean).T @ jacobian(clean)))
    expected = half @ np.mean([change.T @ change for change in changes], axis=0) @ half.T
    assert found.noise_share == pytest.approx(np.linalg.eigvalsh(expected)[-1], rel=0.1)


def test_whitening_makes_errors_white():
    rng = np.random.default_rng(5)
    mix = rng.normal(0, 1, (10, 4, 4))
    sigma = mix @ mix.transpose(0, 2, 1) + 0.1 * np.eye(4)
    joint, legs = whitening(sigma, "joint"), whitening(sigma, "legs")
    assert_allclose(joint @ sigma @ joint.transpose(0, 2, 1), np.broadcast_to(np.eye(4), (10, 4, 4)), atol=1e-9)
    assert_allclose(np.diagonal(legs @ sigma @ legs, axis1=1, axis2=2), 1.0)


def test_the_noise_of_a_campaign_is_its_half_widths_over_their_factor(campaign):
    noise = Noise.of(campaign)
    assert_allclose(np.sqrt(np.diagonal(noise.pose, axis1=1, axis2=2))[:, :3], campaign.position_radius / 3)
    assert_allclose(noise.length, campaign.length_radius / 3)
    assert_allclose(Noise.of(campaign, factor=1.5).length, 2 * noise.length)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"legs": [0]}, "from 1 to 6"),
        ({"legs": [1, 1]}, "different numbers"),
        ({"legs": []}, "legs"),
        ({"form": "h"}, "'f', 'g'|'g', 'f'"),
        ({"weights": "joint"}, "needs the noise"),
        ({"weights": "all"}, "'none', 'legs', 'joint'"),
        ({"loss": "l2"}, "'huber'"),
        ({"loss_scale": 0.0}, "number > 0"),
        ({"tolerance": 0.0}, "1e-10"),
        ({"covariance": "noise"}, "needs the noise"),
        ({"noise": Noise.from_sigmas([1] * 3, [1] * 3, [1] * 6, count=5)}, "is for"),
        ({"start": np.zeros((5, 7))}, "shape"),
        ({"start": "here"}, "numbers"),
    ],
    ids=str,
)
def test_options_without_a_meaning_are_refused(campaign, options, said):
    with pytest.raises(InputError, match=said):
        fit(campaign, **options)


def test_a_robust_loss_has_no_covariance_from_the_noise_and_levels_are_probabilities(campaign):
    with pytest.raises(InputError, match="robust loss"):
        fit(campaign, noise=Noise.of(campaign), loss="huber", covariance="noise")
    with pytest.raises(InputError, match="between 0 and 1"):
        fit(campaign).interval(95)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([1] * 3, [1] * 3, [-1] * 6), "negative"),
        (([1] * 3, [np.nan] * 3, [1] * 6), "non-finite"),
        (([1] * 2, [1] * 3, [1] * 6), "shapes"),
        ((np.ones((3, 3)), [1] * 3, [1] * 6), "one row each"),
    ],
)
def test_senseless_noise_is_refused(arguments, said):
    with pytest.raises(InputError, match=said):
        Noise.from_sigmas(*arguments, count=4)


def test_noise_that_is_no_covariance_or_leaves_no_weights_is_refused(campaign):
    with pytest.raises(InputError, match="positive semidefinite"):
        Noise(-np.ones((2, 6, 6)), np.ones((2, 6)))
    exact = simulate(seed=1, factor=0.0)
    with pytest.raises(InputError, match="exact readings"):
        Noise.of(exact)
    nothing = Noise.from_sigmas([0] * 3, [0] * 3, [0] * 6, count=64)
    with pytest.raises(InputError, match="without any error"):
        fit(campaign, noise=nothing, weights="legs")
    shared = Noise.from_sigmas([0.1, 0, 0], [0] * 3, [0] * 6, count=64)
    with pytest.raises(InputError, match="exactly dependent"):
        fit(campaign, noise=shared, weights="joint")
