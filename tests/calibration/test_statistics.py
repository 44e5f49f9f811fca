"""Repeated measurements: spread, outliers, shape of distributions, tolerance intervals, averaged campaigns."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.calibration import (
    Noise,
    averaged,
    campaign_deviations,
    describe,
    deviations,
    fit,
    half_widths,
    mean_rotations,
    readings_needed,
    screen,
    tolerance_half_width,
)
from cpcal.common.errors import InputError
from cpcal.files import load_campaign, save_campaign
from cpcal.robot import quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product, rotation_vector
from cpcal.simulate import simulate
from cpcal.simulate.campaigns import EULER_SIGMA, LENGTH_SIGMA, POSITION_SIGMA

SIGMA = np.concatenate([POSITION_SIGMA, np.radians(EULER_SIGMA), LENGTH_SIGMA])


@pytest.fixture(scope="module")
def repeated():
    """As in the paper: 64 configurations, 11 runs."""
    return simulate(seed=11, runs=11)


@pytest.fixture(scope="module")
def spread(repeated):
    return campaign_deviations(repeated)


def test_the_standard_deviations_of_the_simulated_sensors_come_back(spread):
    assert spread.channels[:7] == ("x", "y", "z", "rx", "ry", "rz", "L1")
    assert spread.freedom == 64 * 10
    assert_allclose(spread.sigma, SIGMA, rtol=4.5 / np.sqrt(2 * 640))


@pytest.mark.parametrize("runs", [2, 3, 11])
def test_the_divisor_makes_the_variance_unbiased_for_any_number_of_repeats(runs):
    rng = np.random.default_rng(runs)
    names = np.repeat(np.arange(5000), runs)
    found = deviations(names, rng.normal(0, 2.0, (len(names), 1)) + names[:, None])
    assert found.sigma[0] == pytest.approx(2.0, rel=0.03)
    assert found.errors.std() == pytest.approx(2.0, rel=0.03)
    assert np.mean(found.values**2) == pytest.approx(4.0 * (runs - 1) / runs, rel=0.05)


def test_deviations_are_centred_and_do_not_depend_on_order_or_offset():
    rng = np.random.default_rng(0)
    names, values = rng.integers(0, 10, 100), rng.normal(0, 1, (100, 3))
    found = deviations(names, values)
    for name in range(10):
        assert_allclose(found.values[names == name].mean(axis=0), 0.0, atol=1e-12)
    order = rng.permutation(100)
    moved = deviations(names[order], (values + names[:, None] * 7.0)[order])
    assert_allclose(moved.values, found.values[order], atol=1e-12)
    assert set(moved.names) == set(found.names)


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


def test_rotations_near_half_a_turn_are_averaged_as_well():
    q = quaternion_from_rotation_vector([[np.pi - 0.01, 0, 0], [-np.pi + 0.01, 0, 0]])
    mean = mean_rotations(q, np.zeros(2, dtype=np.int64), 1)[0]
    assert_allclose(np.abs(mean), [0, 1, 0, 0], atol=1e-12)


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
    score = screen(deviations(names, values)).scores
    clean = values - values  # distances from the medians, in true standard deviations
    for rows in np.split(np.arange(len(names)), 3000):
        clean[rows] = values[rows] - np.median(values[rows])
    ratio = score[60:][clean[60:] != 0] / clean[60:][clean[60:] != 0]
    usual = {2: 0.477, 3: None, 4: None, 11: None}[runs]
    assert_allclose(ratio, ratio.mean(), rtol=1e-9)
    if usual:  # |x1 - x2| / 2 has the median 0.6745 / sqrt 2
        assert ratio.mean() * usual == pytest.approx(0.477, rel=0.05)
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)


def test_a_channel_of_equal_readings_is_not_tested():
    values = np.zeros((20, 2))
    values[:, 0] = np.random.default_rng(0).normal(0, 1, 20)
    values[3, 1] = 1.0
    found = screen(deviations(np.arange(20) % 4, values, ["good", "stuck"]))
    assert found.untested == ("stuck",)
    assert "Not tested" in found.sentence


def test_the_distribution_of_normal_noise_is_said_to_be_normal_with_one_mode(spread):
    for channel in describe(spread):
        assert min(channel.dagostino, channel.shapiro) > 1e-4
        assert channel.extreme > 2.5 * channel.sigma
    assert "looks normal." in describe(spread)[0].sentence(level=1e-4)


def test_two_modes_and_heavy_tails_are_not_normal():
    rng = np.random.default_rng(1)
    names = np.repeat(np.arange(64), 11)
    backlash = rng.choice([-1.0, 1.0], 704) + rng.normal(0, 0.25, 704)
    heavy = rng.standard_t(2, 704)
    for found in describe(deviations(names, np.stack([backlash, heavy], axis=1), ["backlash", "heavy"])):
        assert found.shapiro < 1e-6
        assert found.sentence().endswith("; NOT NORMAL.")


def test_constant_channels_are_not_tested():
    (constant,) = describe(deviations(["a"] * 300, np.zeros((300, 1))))
    assert np.isnan(constant.dagostino)
    assert "not tested for normality" in constant.sentence()


@pytest.mark.parametrize(("coverage", "confidence", "count"), [(0.95, 0.95, 59), (0.99, 0.95, 299), (0.9, 0.9, 22)])
def test_the_number_of_readings_needed_is_that_of_wilks_tables(coverage, confidence, count):
    assert readings_needed(coverage, confidence) == count
    with pytest.raises(InputError, match=f"at least {count}"):
        tolerance_half_width(np.arange(count - 1), coverage, confidence)
    assert tolerance_half_width(np.arange(count), coverage, confidence) == count - 1.0


def test_the_number_of_readings_needed_holds_for_the_least_and_the_highest_coverage():
    assert readings_needed(0.5, 0.4) == 1
    nearly_all = readings_needed(1 - 1e-9, 0.95)
    assert nearly_all == pytest.approx(-np.log(0.05) * 1e9, rel=1e-6)


@pytest.mark.parametrize("count", [93, 150, 704])
@pytest.mark.parametrize("law", ["uniform", "skew"])
def test_tolerance_limits_cover_what_they_state_whatever_the_distribution(count, law):
    """1500 samples; by the probability transform the covered share is known exactly."""
    rng = np.random.default_rng(count)
    widths = 0
    for _ in range(1500):
        u = rng.random(count)
        sample = u if law == "uniform" else -np.log1p(-u)
        centred = sample - 0.5
        h = tolerance_half_width(centred, 0.95, 0.9)
        inside = (
            (min(0.5 + h, 1) - max(0.5 - h, 0)) if law == "uniform" else np.exp(-max(0.5 - h, 0)) - np.exp(-0.5 - h)
        )
        widths += inside >= 0.95
    slack = 3.5 * np.sqrt(0.09 / 1500)
    assert 0.9 - slack < widths / 1500 < 0.98  # order statistics come in steps: more than asked, not by much


def test_reading_sets_grow_from_tolerance_to_three_sigma_to_extreme_for_normal_noise(spread):
    sigma = half_widths(spread)
    assert_allclose(sigma, 3 * spread.sigma)
    tolerance = half_widths(spread, "tolerance", coverage=0.95, confidence=0.95)
    extreme = half_widths(spread, "extreme")
    assert (1.9 * spread.sigma < tolerance).all()
    assert (tolerance < sigma).all()
    assert (extreme > tolerance).all()
    assert (np.abs(spread.errors) <= extreme).all()


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


def test_half_widths_of_means_are_smaller_by_the_root_of_the_repeats_in_each_configuration(repeated, spread):
    rows = [k for k in range(len(repeated)) if not (k < 11 and k > 3)]  # the first configuration: 4 readings
    keep = np.isin(np.arange(len(repeated)), rows)
    mean = averaged(repeated, of="mean", keep=keep)
    sigma = campaign_deviations(repeated).without(np.flatnonzero(~keep).tolist()).sigma
    assert_allclose(mean.length_radius[0], 3 * sigma[6:] / np.sqrt(4), rtol=1e-9)
    assert_allclose(mean.length_radius[1], 3 * sigma[6:] / np.sqrt(11), rtol=1e-9)
    assert "of the means" in mean.provenance["averaged"]


def test_the_fit_of_the_means_states_the_errors_that_the_fit_of_all_readings_states(repeated):
    mean = averaged(repeated, of="mean")
    of_means = fit(mean, weights="joint", noise=Noise.of(mean))
    of_all = fit(repeated, weights="joint", noise=Noise.of(repeated))
    assert_allclose(of_means.standard_errors, of_all.standard_errors, rtol=0.1)
    assert np.max(np.abs(of_means.parameters - of_all.parameters) / of_all.standard_errors) < 0.5


@pytest.mark.parametrize("options", [{}, {"of": "mean"}, {"method": "extreme"}, {"method": "tolerance"}], ids=str)
def test_averaged_campaigns_survive_their_files(repeated, tmp_path, options):
    mean = averaged(repeated, **options)
    save_campaign(mean, tmp_path / "mean")
    assert load_campaign(tmp_path / "mean") == mean


def test_averaging_a_perfectly_repeatable_campaign_gives_it_back():
    exact = simulate(seed=1, runs=3, noise=0.0)
    mean = averaged(exact)
    assert_allclose(mean.position, exact.position[::3], atol=1e-12)
    assert_allclose(np.abs(np.sum(mean.quaternion * exact.quaternion[::3], axis=1)), 1.0)
    assert mean.position_radius.max() < 1e-12


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda c: campaign_deviations(simulate(seed=0)), "each of its 64 configurations once"),
        (lambda c: averaged(c, of="median"), "'single' or 'mean'"),
        (lambda c: averaged(c, "extreme", of="mean"), "no meaning with method"),
        (lambda c: averaged(c, "widest"), "'tolerance'"),
        (lambda c: averaged(c, factor=0.0), "factor"),
        (lambda c: averaged(c, keep=[True]), "704 truth values"),
        (lambda c: averaged(c, "tolerance", coverage=0.9999), "too few"),
        (lambda c: screen(campaign_deviations(c), threshold=-1), "threshold"),
        (lambda c: deviations(["a", "a"], [[1.0], [np.nan]]), "row 1"),
        (lambda c: deviations(["a", "a"], [1.0, 2.0]), r"\(N, C\)"),
        (lambda c: deviations(["a", "a"], [["x"], ["y"]]), "numbers"),
        (lambda c: deviations(["a", "a"], [[1.0], [2.0]], channels=["p", "q"]), "each channel"),
        (lambda c: tolerance_half_width(np.arange(100), coverage=95), "between 0 and 1"),
        (lambda c: tolerance_half_width([[1.0]]), "finite numbers"),
    ],
)
def test_bad_input_is_refused_with_a_remedy(repeated, call, said):
    with pytest.raises(InputError, match=said):
        call(repeated)
