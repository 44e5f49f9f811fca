"""Least-squares fits: derivatives, known truths, what weights and losses gain, covariances against Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cpcal.calibration import LegEquations, Noise, fit, least_squares
from cpcal.calibration.leg_equations import _DERIVATIVES, LOSSES, pseudo_residuals
from cpcal.legs import residuals
from cpcal.robot import DELTALAB, Campaign, quaternion_from_rotation_vector, quaternion_product, rotation_matrix
from cpcal.simulate import simulate, true_robot

ALL = range(1, 7)


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


@pytest.mark.parametrize("form", ["f", "g"])
def test_the_derivatives_are_those_of_finite_differences(campaign, form):
    equations = LegEquations.of(campaign, ALL, form)
    rng = np.random.default_rng(0)
    x, step = truth(campaign) + rng.normal(0, 3, (6, 7)), rng.normal(0, 1, (6, 7))
    move, turn, longer = rng.normal(0, 1, (64, 3)), rng.normal(0, 1e-2, (64, 3)), rng.normal(0, 1, (64, 6))
    h = 1e-3

    def read(t):
        rotation = rotation_matrix(quaternion_from_rotation_vector(t * turn)) @ equations.rotation
        return LegEquations(equations.position + t * move, rotation, equations.length + t * longer, form).values(x)

    numeric = (equations.values(x + h * step) - equations.values(x - h * step)) / (2 * h)
    scale = np.abs(numeric).max()
    assert_allclose(np.einsum("knj,nj->kn", equations.by_parameters(x), step), numeric, atol=1e-8 * scale)
    analytic = np.einsum("knj,kj->kn", equations.by_pose(x), np.concatenate([move, turn], axis=1))
    analytic = analytic + equations.by_length(x) * longer
    assert_allclose(analytic, (read(h) - read(-h)) / (2 * h), atol=1e-8 * scale)


def test_the_equations_are_the_papers(campaign):
    x = DELTALAB.parameters
    g, f = (LegEquations.of(campaign, ALL, form).values(x) for form in ("g", "f"))
    for leg in ALL:
        assert_allclose(g[:, leg - 1], residuals(campaign, leg, x[leg - 1]), atol=1e-12)
    total = campaign.length + x[:, 6]
    assert_allclose(f, g * (g + 2 * total), rtol=1e-9)


@pytest.mark.parametrize("form", ["f", "g"])
@pytest.mark.parametrize("weights", ["none", "legs", "joint"])
@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_without_noise_every_fit_finds_the_true_parameters(form, weights, loss):
    exact = simulate(seed=5, noise=0.0)
    noise = Noise.from_sigmas([0.06, 0.02, 0.06], [2e-4] * 3, [0.01] * 6, count=64)
    found = fit(exact, form=form, weights=weights, noise=noise, loss=loss)
    assert_allclose(found.parameters, truth(exact), atol=1e-6)
    assert found.converged
    assert found.rank == 42
    assert found.condition < 1e4


def test_least_squares_is_the_unweighted_fit_of_g_and_some_legs_do_as_all(campaign):
    everything = fit(campaign)
    assert_allclose(fit(campaign, legs=[5, 2]).parameters, everything.parameters[[4, 1]], atol=1e-12)
    assert_allclose(least_squares(campaign, 4), everything.parameters[3], atol=1e-6)
    gradient = np.einsum(
        "kn,knj->nj", everything.residuals, LegEquations.of(campaign, ALL).by_parameters(everything.parameters)
    )
    assert_allclose(gradient, 0.0, atol=1e-8)


def test_weighted_f_and_g_agree_where_the_unweighted_do_not():
    campaign = simulate(seed=4)
    noise = Noise.of(campaign)
    for weights in ("legs", "joint"):
        f, g = (fit(campaign, form=form, weights=weights, noise=noise) for form in ("f", "g"))
        assert np.max(np.abs(f.parameters - g.parameters) / g.standard_errors) < 0.3
        assert_allclose(f.standard_errors, g.standard_errors, rtol=0.01)
    f, g = (fit(campaign, form=form) for form in ("f", "g"))
    assert np.max(np.abs(f.parameters - g.parameters) / g.standard_errors) > 0.3


def test_weights_reduce_the_variance_in_theory_and_in_fact():
    """Camera noise that dominates and varies from pose to pose; 20 campaigns."""
    clean, rng = simulate(seed=6, noise=0.0), np.random.default_rng(1)
    spread = rng.uniform(0.2, 3.0, (64, 1))
    noise = Noise.from_sigmas(spread * [0.06, 0.02, 0.06], spread * np.full(3, 2e-4), [0.01] * 6, count=64)
    campaigns = [redrawn(clean, noise, rng) for _ in range(20)]
    stated, seen = {}, {}
    for weights in ("none", "legs", "joint"):
        fits = [fit(c, weights=weights, noise=noise) for c in campaigns]
        stated[weights] = np.diagonal(fits[0].covariance)
        seen[weights] = np.mean([(found.parameters - truth(clean)) ** 2 for found in fits])
    assert (stated["joint"] < stated["legs"]).all()
    assert stated["joint"].mean() < 0.8 * stated["legs"].mean() < 0.8 * 0.9 * stated["none"].mean()
    assert seen["joint"] < seen["legs"] < seen["none"]


@pytest.mark.parametrize("weights", ["none", "legs", "joint"])
def test_the_covariance_is_that_of_monte_carlo_between_legs_too(weights):
    """200 campaigns, noise of the pose fully correlated: the errors, made white by the stated covariance, are white."""
    clean, rng = simulate(seed=7, noise=0.0), np.random.default_rng(2)
    mix = rng.normal(0, 1, (64, 6, 6)) * np.array([0.03, 0.03, 0.03, 1e-4, 1e-4, 1e-4])[:, None]
    noise = Noise(mix @ mix.transpose(0, 2, 1), np.full((64, 6), 0.01))
    legs = [1, 4]
    at_truth = fit(clean, legs=legs, weights=weights, noise=noise)
    white = np.linalg.inv(np.linalg.cholesky(at_truth.covariance))
    errors = [
        (fit(redrawn(clean, noise, rng), legs=legs, weights=weights, noise=noise).parameters - truth(clean)[[0, 3]])
        for _ in range(200)
    ]
    drawn = np.array([white @ error.ravel() for error in errors])
    assert_allclose(np.cov(drawn.T), np.eye(14), atol=5 * np.sqrt(2 / 200))
    assert np.max(np.abs(drawn.mean(axis=0))) < 4.5 / np.sqrt(200)
    correlation = at_truth.covariance[:7, 7:] / np.outer(*at_truth.standard_errors)
    assert np.abs(correlation).max() > 0.05  # legs share the noise of their poses


@pytest.mark.parametrize(
    "options",
    [
        {"form": "f", "covariance": "residuals"},
        {"weights": "legs"},
        {"weights": "joint"},
    ],
    ids=str,
)
def test_intervals_cover_the_true_parameters_as_often_as_they_state(options):
    """20 seeds by 42 parameters."""
    inside = []
    for seed in range(20):
        campaign = simulate(seed=seed)
        lower, upper = fit(campaign, noise=Noise.of(campaign), **options).interval(0.9)
        inside.append((lower <= truth(campaign)) & (truth(campaign) <= upper))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize("loss", [loss for loss in LOSSES if loss != "linear"])
def test_a_robust_loss_shrugs_off_gross_errors_that_spoil_the_plain_fit(loss):
    campaign = simulate(seed=8)
    length = campaign.length.copy()
    length[[3, 20, 41]] += 5.0
    wrong = replace(campaign, length=length)
    plain, robust = fit(wrong), fit(wrong, loss=loss)
    error = [np.sqrt(np.mean((found.parameters - truth(campaign)) ** 2)) for found in (plain, robust)]
    assert error[1] < 0.2 * error[0]
    assert error[1] < 2 * np.sqrt(np.mean(robust.standard_errors**2))
    assert "loss" in robust.sentence


def test_the_errors_of_a_robust_fit_are_those_of_monte_carlo():
    clean, rng = simulate(seed=9, noise=0.0), np.random.default_rng(3)
    scores = []
    for _ in range(60):
        noise = 0.05 * rng.standard_t(3, (64, 6))
        found = fit(replace(clean, length=clean.length + noise), loss="huber")
        scores.append((found.parameters - truth(clean)) / found.standard_errors)
    assert np.std(scores) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_losses_derivatives_are_those_that_scipy_minimises(loss):
    from scipy.optimize import least_squares as scipy_fit

    z = np.array([0.01, 0.5, 0.9, 1.1, 4.0, 50.0])
    first, second = _DERIVATIVES[loss](z)
    h = 1e-6
    assert_allclose((_DERIVATIVES[loss](z + h)[0] - _DERIVATIVES[loss](z - h)[0]) / (2 * h), second, atol=1e-8)
    for value, slope in zip(z, first, strict=True):  # cost = rho(r^2) / 2, so its gradient by r is rho' r
        found = scipy_fit(lambda r: r, [np.sqrt(value)], loss=loss, max_nfev=1)
        assert found.grad[0] == pytest.approx(slope * np.sqrt(value))
    r = np.array([[-1.0], [2.0]])
    assert_allclose(pseudo_residuals(r, "linear", np.ones(1)), r)


def test_model_error_is_told_from_noise_in_the_sentence():
    for amplitude, said in ((0.0, "as expected"), (1.0, "DOES NOT EXPLAIN")):
        campaign = simulate(seed=2, joint_error=amplitude)
        found = fit(campaign, weights="joint", noise=Noise.of(campaign))
        assert said in found.sentence
        assert "converged" in found.sentence
        assert "Rank 42 of 42" in found.sentence
    assert (found.noise_ratio > 3).all()
    assert fit(campaign).noise_ratio is None
    assert "not known" in fit(campaign).sentence


def test_the_noise_ratio_of_nine_measurements_is_about_one():
    # of 24 legs with two degrees of freedom each, so that a divisor N, not N - 7, would give 2 / 9
    squares = []
    for seed in range(4):
        campaign = simulate(seed=seed, extremal=False, random_poses=9)
        squares.append(fit(campaign, noise=Noise.of(campaign)).noise_ratio ** 2)
    assert 0.55 < np.mean(squares) < 1.6


def test_too_few_poses_are_said_and_leave_parameters_undetermined():
    few = simulate(seed=1, extremal=False, random_poses=5)
    found = fit(few, noise=Noise.of(few))
    assert found.rank == 30
    assert found.condition == np.inf
    assert "RANK-DEFICIENT, 30 of 42" in found.sentence
    assert np.isinf(found.standard_errors[found.undetermined]).all()
    lower, upper = found.interval()
    assert (lower[found.undetermined] == -np.inf).all()
    assert (upper[found.undetermined] == np.inf).all()
    assert np.abs(found.residuals).max() < 1e-6


def test_poses_that_never_turn_leave_joint_centres_undetermined_but_not_the_offset():
    """With R = 1 everywhere only b - a matters: rank 4 a leg, and l is determined all the same."""
    rng = np.random.default_rng(4)
    position = np.array([0, 0, 360]) + rng.uniform(-60, 60, (40, 3))
    vectors = position[:, None] + DELTALAB.mobile - DELTALAB.base
    length = np.linalg.norm(vectors, axis=-1) - DELTALAB.offset + rng.normal(0, 0.01, (40, 6))
    campaign = Campaign.of(DELTALAB, position, [[1, 0, 0, 0]] * 40, length, exact=True)
    found = fit(campaign)
    assert found.rank == 24
    assert found.undetermined[:, :6].all()
    assert not found.undetermined[:, 6].any()
    assert np.isfinite(found.standard_errors[:, 6]).all()
    assert "they do not determine a_x of leg 1" in found.sentence


def test_seven_poses_fit_exactly_and_tell_nothing_of_errors():
    seven = simulate(seed=1, extremal=False, random_poses=7)
    found = fit(seven)
    assert found.rank == 42
    assert np.abs(found.residuals).max() < 1e-5
    assert not np.isfinite(found.standard_errors).any()
    assert "no measurements are left" in found.sentence
    assert "cannot be said" in fit(seven, noise=Noise.of(seven)).sentence
