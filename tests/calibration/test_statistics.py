"""Repeated measurements: spread, outliers, averaged campaigns."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cpcal.calibration import averaged, campaign_deviations, deviations, mean_rotations, screen
from cpcal.common.errors import InputError
from cpcal.robot import quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product, rotation_vector
from cpcal.simulate import simulate


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
