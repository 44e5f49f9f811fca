"""eps = 0 in exact arithmetic: agrees with fractions, and refuses what is not so."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cpcal
from cpcal.calibration import solves_exactly
from cpcal.calibration.exact import Dyadic
from cpcal.simulate import true_robot

numbers = st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3)


def fractions(x: Dyadic) -> list[Fraction]:
    return [Fraction(int(m), 2**x.exponent) for m in x.mantissa.ravel()]


@given(numbers, numbers, numbers)
@settings(max_examples=50, deadline=None)
def test_dyadic_numbers_are_exact(a: list[float], b: list[float], c: list[float]) -> None:
    x, y, z = (Dyadic.of(v) for v in (a, b, c))
    exact = [Fraction(p) * Fraction(q) - Fraction(r) + Fraction(q) for p, q, r in zip(a, b, c, strict=True)]
    assert fractions(x * y - z + y) == exact
    assert sum(fractions(x)) == fractions(x.sum())[0]
    assert [f >= 0 for f in fractions(x - y)] == (x - y).nonnegative().tolist()


def truth(campaign: cpcal.Campaign) -> np.ndarray:
    robot = true_robot(campaign)
    assert robot is not None
    return robot.parameters[0]


def test_the_truth_within_its_sets_solves() -> None:
    campaign = cpcal.simulate(seed=5, joint_error=0.0, factor=3.0, truncate=2.9)
    x = truth(campaign)
    assert solves_exactly(campaign, 1, x)
    away = x.copy()
    away[6] += 5.0  # mm, more than any reading allows
    assert not solves_exactly(campaign, 1, away)


def test_one_bad_reading_is_enough_to_refuse() -> None:
    campaign = cpcal.simulate(seed=5, joint_error=0.0, factor=3.0, truncate=2.9)
    x = truth(campaign)
    length = campaign.length.copy()
    length[17, 0] += 3.0
    assert not solves_exactly(replace(campaign, length=length), 1, x)


@pytest.mark.parametrize("toward", [-np.inf, np.inf])
def test_one_unit_in_the_last_place_decides(toward: float) -> None:
    """b = 0 and a leg along z: v is (0, 0, P_z), so exact readings are solved by L + l = P_z and nothing else."""
    robot = cpcal.Robot("one leg", [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [0.0])
    x = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0]
    height = 300.1
    pose = [[0.0, 0.0, height]], [[0.6, 0.0, 0.0, 0.8]]
    campaign = cpcal.Campaign.from_arrays(robot, *pose, [[height - 300.0]], exact=True)
    assert solves_exactly(campaign, 1, x)
    length = np.nextafter(campaign.length, toward)
    assert not solves_exactly(replace(campaign, length=length), 1, x)


def test_the_answer_says_that_it_is_exact() -> None:
    campaign = cpcal.simulate(seed=3, joint_error=0.0, factor=3.0, truncate=2.9)
    leg = cpcal.certify(campaign, legs=[1]).legs[0]
    assert leg.eps_hi == 0.0
    assert "not refuted" in leg.status
    assert "exact arithmetic" in leg.status
