"""Hartigan's dip against its definition (a linear program), and its test on samples with one and two modes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from cpcal.calibration import dip, dip_p_value
from cpcal.common.errors import InputError


def least_distance_to_a_unimodal_distribution(x):
    """By definition: over all modes x_m, convex before and concave after, with a jump at the mode."""
    x, counts = np.unique(x, return_counts=True)
    n = len(x)
    value = np.cumsum(counts) / counts.sum()
    limit = value - counts / counts.sum()  # from the left
    slope = np.diff(np.eye(n), axis=0) / np.diff(x)[:, None]
    best = np.inf
    for m in range(n):
        before, after = np.eye(n)[: m + 1], np.eye(n)[m:]  # values at x_0..x_m (left limit at x_m) and at x_m..x_n-1
        zero = np.zeros((n, n))
        rows, bounds = [], []

        def demand(left, right, distance, bound, rows=rows, bounds=bounds):
            rows.append(np.concatenate([left, right, np.full((len(left), 1), distance)], axis=1))
            bounds.append(bound)

        demand(before, 0 * before, -1, limit[: m + 1])  # at most the left limit + D
        demand(-before[:m], 0 * before[:m], -1, -value[:m])  # at least the value - D
        demand(0 * after[1:], after[1:], -1, limit[m + 1 :])
        demand(0 * after, -after, -1, -value[m:])
        demand(np.eye(n)[[m]], -np.eye(n)[[m]], 0, [0])  # the jump goes up
        rise = -np.diff(np.eye(n), axis=0)
        demand(rise[:m], zero[:m], 0, np.zeros(m))
        demand(zero[: n - 1 - m], rise[m:], 0, np.zeros(n - 1 - m))
        bend = np.diff(slope, axis=0)
        demand(-bend[: max(m - 1, 0)], zero[: max(m - 1, 0)], 0, np.zeros(max(m - 1, 0)))
        demand(0 * bend[m:], bend[m:], 0, np.zeros(len(bend[m:])))
        found = linprog(
            np.eye(2 * n + 1)[-1], np.concatenate(rows), np.concatenate(bounds), bounds=[(-1, 2)] * (2 * n) + [(0, 1)]
        )
        best = min(best, float(found.fun))
    return best


@pytest.mark.parametrize("seed", range(24))
def test_the_dip_is_the_least_distance_to_a_unimodal_distribution(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 16))
    x = rng.normal(0, 1, count) + (seed % 3) * rng.choice([-1, 1], count)
    if seed % 4 == 3:
        x = np.round(x)  # equal readings
    assert dip(x) == pytest.approx(max(least_distance_to_a_unimodal_distribution(x), 1 / (2 * count)), abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-100, 100), min_size=1, max_size=40))
def test_the_dip_is_bounded_and_does_not_depend_on_order_place_or_scale(sample):
    x = np.round(np.array(sample), 3)
    found = dip(x)
    assert 1 / (2 * len(x)) - 1e-15 <= found <= max(0.25, 1 / (2 * len(x)))
    assert dip(x[::-1]) == found
    assert dip(8.0 * x) == pytest.approx(found, abs=1e-9)
    assert dip(-x) == pytest.approx(found, abs=1e-9)


def test_extremes_of_the_dip():
    assert dip(np.arange(50.0)) == pytest.approx(0.01)
    assert dip([0.0] * 30 + [1.0] * 30) == pytest.approx(0.25)
    assert dip([3.0] * 10) == pytest.approx(0.05)


def test_one_mode_is_seldom_rejected_and_two_nearly_always():
    """Level 0.05 on uniform samples, the worst case of one mode; far less on normal ones."""
    rng = np.random.default_rng(0)
    uniform = np.mean([dip_p_value(rng.random(100)) <= 0.05 for _ in range(400)])
    assert uniform == pytest.approx(0.05, abs=0.035)
    normal = np.mean([dip_p_value(rng.standard_normal(100)) <= 0.05 for _ in range(200)])
    assert normal <= 0.03
    signs = rng.choice([-1.0, 1.0], (100, 100))
    two = np.mean([dip_p_value(row) <= 0.05 for row in signs + 0.35 * rng.standard_normal((100, 100))])
    assert two > 0.95


def test_large_samples_are_compared_with_the_limit():
    rng = np.random.default_rng(1)
    assert dip_p_value(rng.random(3000)) > 0.01
    assert dip_p_value(rng.choice([-1.0, 1.0], 3000) + 0.7 * rng.standard_normal(3000)) <= 0.01


@pytest.mark.parametrize("sample", [[], [np.nan], [[1.0]]])
def test_no_dip_of_nothing(sample):
    with pytest.raises(InputError, match="sample"):
        dip(sample)
