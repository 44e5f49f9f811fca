"""Least-squares fits against Monte Carlo and differences; repeated measurements: spread, outliers, averages."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import stdtrit

from cpcal.calibration import Noise, averaged, campaign_deviations, deviations, fit, mean_rotations, screen
from cpcal.common.errors import InputError
from cpcal.models import model_residuals
from cpcal.robot import (
    DELTALAB,
    LegEquations,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
    rotation_vector,
)
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


def of(names, values, channels="abc"):
    """Deviations of a table."""
    channels = channels[: values.shape[1]]
    return deviations(names.tolist(), values, channels, [f"row {k}" for k in range(len(values))])


@pytest.fixture(scope="module")
def repeated():
    """As in the paper: 64 configurations, 11 runs."""
    return simulate(seed=11, runs=11)


@pytest.fixture(scope="module")
def spread(repeated):
    return campaign_deviations(repeated)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_the_mean_rotation_moves_with_the_rotations_and_ignores_signs(seed):
    rng = np.random.default_rng(seed)
    centre, turn = (quaternion_from_rotation_vector(rng.normal(0, 1, 3)) for _ in range(2))
    offsets = rng.normal(0, 1e-3, (8, 3))
    offsets -= offsets.mean(axis=0)
    q = quaternion_product(quaternion_from_rotation_vector(offsets), centre) * rng.choice([-1, 1], (8, 1))
    group = np.zeros(8, dtype=np.int64)
    mean = mean_rotations(q, group, 1)[0]
    assert_allclose(rotation_vector(quaternion_product(mean, quaternion_conjugate(centre))), 0.0, atol=1e-8)
    turned = mean_rotations(quaternion_product(turn, q), group, 1)[0]
    remaining = quaternion_product(turned, quaternion_conjugate(quaternion_product(turn, mean)))
    assert_allclose(rotation_vector(remaining), 0.0, atol=1e-12)


def test_outliers_are_found_and_named_and_nothing_else(repeated):
    position, length = repeated.position.copy(), repeated.length.copy()
    position[5, 1] += 0.5
    length[100, 3] -= 0.2
    length[400:403, 0] += 0.3  # three of eleven
    wrong = replace(repeated, position=position, length=length)
    found = screen(campaign_deviations(wrong))
    assert found.rows == (5, 100, 400, 401, 402)
    assert found.names[0] == wrong.measurement_ids[5]
    assert found.keep.sum() == len(wrong) - 5
    assert "e00/6 (y: +" in found.sentence
    assert screen(campaign_deviations(repeated)).rows == ()
    assert "None of 704" in screen(campaign_deviations(repeated)).sentence


@pytest.mark.parametrize("runs", [2, 3, 4, 11])
def test_scores_are_in_standard_deviations_for_any_number_of_repeats(runs):
    rng = np.random.default_rng(runs)
    names = np.repeat(np.arange(3000), runs)
    values = rng.normal(0, 1.0, (len(names), 1))
    values[:50] += 1e3 * np.arange(50)[:, None]  # a minority, however wrong, does not move the scale
    score = screen(of(names, values)).scores
    clean = values - values  # distances from the medians, in true standard deviations
    for rows in np.split(np.arange(len(names)), 3000):
        clean[rows] = values[rows] - np.median(values[rows])
    ratio = score[60:][clean[60:] != 0] / clean[60:][clean[60:] != 0]
    assert_allclose(ratio, ratio.mean(), rtol=1e-9)
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)


def test_a_channel_of_equal_readings_is_not_tested():
    values = np.zeros((20, 2))
    values[:, 0] = np.random.default_rng(0).normal(0, 1, 20)
    values[3, 1] = 1.0
    found = screen(of(np.arange(20) % 4, values, ["good", "stuck"]))
    assert found.untested == ("stuck",)
    assert "Not tested" in found.sentence


def test_an_averaged_campaign_has_the_means_and_half_widths_of_single_readings(repeated, spread):
    mean = averaged(repeated)
    assert len(mean) == 64
    assert set(mean.run) == {"mean"}
    assert mean.pose == tuple(dict.fromkeys(repeated.pose))
    assert_allclose(mean.position[7], repeated.position[77:88].mean(axis=0), atol=1e-12)
    assert_allclose(mean.length[7], repeated.length[77:88].mean(axis=0), atol=1e-12)
    assert_allclose(np.linalg.norm(mean.quaternion, axis=1), 1.0)
    assert_allclose(mean.position_radius, np.tile(3 * spread.sigma[:3], (64, 1)))
    assert mean.uncertainty.factor == 3.0
    assert_allclose(mean.uncertainty.length, spread.sigma[6:])
    assert "single readings: 3 standard deviations" in mean.provenance["averaged"]
    of_mean = averaged(repeated, of="mean")
    assert_allclose(of_mean.length_radius, mean.length_radius / np.sqrt(11), rtol=1e-9)
    assert "of the means" in of_mean.provenance["averaged"]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda c: campaign_deviations(simulate(seed=0)), "each of its 64 configurations once"),
        (lambda c: averaged(c, of="median"), "'single' or 'mean'"),
        (lambda c: averaged(c, factor=0.0), "factor"),
    ],
)
def test_bad_input_is_refused_with_a_remedy(repeated, call, said):
    with pytest.raises(InputError, match=said):
        call(repeated)
