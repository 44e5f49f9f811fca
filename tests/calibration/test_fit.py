"""Least-squares fits: derivatives, known truths, what weights gain, covariances against Monte Carlo, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import stdtrit

from cpcal.calibration import Noise, fit
from cpcal.common.errors import InputError
from cpcal.models import model_residuals
from cpcal.robot import DELTALAB, LegEquations, quaternion_from_rotation_vector, quaternion_product, rotation_matrix
from cpcal.simulate import simulate, true_robot


@pytest.fixture(scope="module")
def campaign():
    return simulate(seed=3)


def truth(campaign):
    return true_robot(campaign).parameters


def redrawn(clean, noise, rng):
    """`clean` with readings drawn from `noise`, whose covariances may be full."""
    factor = np.linalg.cholesky(noise.pose)
    moved = np.einsum("kij,kj->ki", factor, rng.standard_normal((len(clean), 6)))
    turned = quaternion_product(quaternion_from_rotation_vector(moved[:, 3:]), clean.quaternion)
    length = clean.length + noise.length * rng.standard_normal(clean.length.shape)
    return replace(clean, position=clean.position + moved[:, :3], quaternion=turned, length=length)


def test_the_derivatives_are_those_of_finite_differences(campaign):
    equations = LegEquations.of(campaign)
    rng = np.random.default_rng(0)
    x, step = truth(campaign) + rng.normal(0, 3, (6, 7)), rng.normal(0, 1, (6, 7))
    move, turn = rng.normal(0, 1, (64, 3)), rng.normal(0, 1e-2, (64, 3))
    h = 1e-3

    def posed(t):
        rotation = rotation_matrix(quaternion_from_rotation_vector(t * turn)) @ equations.rotation
        return LegEquations(equations.position + t * move, rotation, equations.length).values(x)

    numeric = (equations.values(x + h * step) - equations.values(x - h * step)) / (2 * h)
    scale = np.abs(numeric).max()
    assert_allclose(np.einsum("knj,nj->kn", equations.by_parameters(x), step), numeric, atol=1e-8 * scale)
    analytic = np.einsum("knj,kj->kn", equations.by_pose(x), np.concatenate([move, turn], axis=1))
    assert_allclose(analytic, (posed(h) - posed(-h)) / (2 * h), atol=1e-8 * scale)


def test_the_equations_are_the_papers(campaign):
    g = LegEquations.of(campaign).values(DELTALAB.parameters)
    for leg in range(1, 7):
        assert_allclose(g[:, leg - 1], model_residuals(campaign, leg, DELTALAB.parameters[leg - 1]), atol=1e-12)


@pytest.mark.parametrize("weighted", [False, True])
def test_without_noise_every_fit_finds_the_true_parameters(weighted):
    exact = simulate(seed=5, noise=0.0)
    noise = Noise.from_sigmas([0.06, 0.02, 0.06], [2e-4] * 3, [0.01] * 6, count=64)
    found = fit(exact, weighted=weighted, noise=noise)
    assert_allclose(found.parameters, truth(exact), atol=1e-6)
    assert found.converged
    assert found.rank == 42
    assert found.svd[1][0] < 1e4 * found.svd[1][-1]


@pytest.mark.parametrize("weighted", [False, True])
def test_the_covariance_is_that_of_monte_carlo_between_legs_too(weighted):
    """120 campaigns, noise of the pose fully correlated: the errors, made white by the stated covariance, are white."""
    clean, rng = simulate(seed=7, noise=0.0), np.random.default_rng(2)
    mix = rng.normal(0, 1, (64, 6, 6)) * np.array([0.03, 0.03, 0.03, 1e-4, 1e-4, 1e-4])[:, None]
    noise = Noise(mix @ mix.transpose(0, 2, 1), np.full((64, 6), 0.01))
    legs = [1, 4]
    at_truth = fit(clean, legs=legs, weighted=weighted, noise=noise)
    white = np.linalg.inv(np.linalg.cholesky(at_truth.covariance))
    errors = [
        fit(redrawn(clean, noise, rng), legs=legs, weighted=weighted, noise=noise).parameters - truth(clean)[[0, 3]]
        for _ in range(120)
    ]
    drawn = np.array([white @ error.ravel() for error in errors])
    assert_allclose(np.cov(drawn.T), np.eye(14), atol=5 * np.sqrt(2 / 120))
    assert np.max(np.abs(drawn.mean(axis=0))) < 4.5 / np.sqrt(120)
    correlation = at_truth.covariance[:7, 7:] / np.outer(*at_truth.standard_errors)
    assert np.abs(correlation).max() > 0.05  # legs share the noise of their poses


def test_model_error_is_told_from_noise_in_the_sentence():
    for amplitude, said in ((0.0, "as expected"), (1.0, "DOES NOT EXPLAIN")):
        campaign = simulate(seed=2, joint_error=amplitude)
        found = fit(campaign, weighted=True, noise=Noise.of(campaign))
        assert said in found.sentence
        assert "converged" in found.sentence
        assert "Rank 42 of 42" in found.sentence
    assert (found.noise_ratio > 3).all()
    assert (found.source, found.explained, found.doubted) == ("residuals", False, True)
    assert fit(campaign).noise_ratio is None
    assert "not known" in fit(campaign).sentence


def test_too_few_poses_are_said_and_leave_parameters_undetermined():
    few = simulate(seed=1, extremal=False, random_poses=5)
    found = fit(few, noise=Noise.of(few))
    assert found.rank == 30
    assert "RANK-DEFICIENT, 30 of 42" in found.sentence
    assert np.isinf(found.standard_errors[found.undetermined]).all()
    assert np.abs(found.residuals).max() < 1e-6


def test_seven_poses_fit_exactly_and_tell_nothing_of_errors():
    seven = simulate(seed=1, extremal=False, random_poses=7)
    found = fit(seven)
    assert found.rank == 42
    assert np.abs(found.residuals).max() < 1e-5
    assert not np.isfinite(found.standard_errors).any()
    assert "no measurements are left" in found.sentence
    assert "cannot be said" in fit(seven, noise=Noise.of(seven)).sentence


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
        ({"weighted": True}, "noise: is missing"),
        ({"covariance": "noise"}, "noise: is missing"),
        ({"noise": Noise.from_sigmas([1] * 3, [1] * 3, [1] * 6, count=5)}, "is for"),
    ],
    ids=str,
)
def test_options_without_a_meaning_are_refused(campaign, options, said):
    with pytest.raises(InputError, match=said):
        fit(campaign, **options)


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


def test_noise_that_leaves_no_weights_is_refused(campaign):
    with pytest.raises(InputError, match="exact readings"):
        Noise.of(simulate(seed=1, factor=0.0))
    nothing = Noise.from_sigmas([0] * 3, [0] * 3, [0] * 6, count=64)
    with pytest.raises(InputError, match="without any error"):
        fit(campaign, noise=nothing, weighted=True)
    shared = Noise.from_sigmas([0.1, 0, 0], [0] * 3, [0] * 6, count=64)
    with pytest.raises(InputError, match="exactly dependent"):
        fit(campaign, noise=shared, weighted=True)


def test_nine_tenths_of_the_errors_are_within_the_quantile_of_the_standard_errors():
    inside = []
    for seed in range(20):
        campaign = simulate(seed=seed)
        found = fit(campaign, noise=Noise.of(campaign), covariance="residuals")
        quantile = stdtrit(found.freedom, 0.95)
        inside.append(np.abs(found.parameters - truth(campaign)) <= quantile * found.standard_errors)
    assert np.mean(inside) == pytest.approx(0.9, abs=0.03)


def test_of_few_measurements_residuals_are_as_large_as_their_noise_by_its_degrees_of_freedom():
    ratios = []
    for seed in range(25):
        few = simulate(seed=seed, extremal=False, random_poses=10)
        ratios.append(fit(few, noise=Noise.of(few)).noise_ratio)
    assert np.mean(np.square(ratios)) == pytest.approx(1.0, abs=0.25)  # 450 degrees of freedom
