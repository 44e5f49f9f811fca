"""eps = 0 in exact arithmetic: decided by the checker, which refuses what is not so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import cpcal
from cpcal.models import leg_statement
from cpcal.questions import Options, proved_sentence
from cpcal.simulate import true_robot
from cpcal.solver.certificate.float_rows import at_point, holding


def solves_exactly(campaign: cpcal.Campaign, leg: int, x: npt.ArrayLike) -> bool:
    """With eps = 0, in the checker's arithmetic."""
    problem, at = leg_statement(campaign, leg).problem, at_point([*np.asarray(x), 0.0])
    return all(holding(problem, at, k) is not None for k in problem.chosen)


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
    campaign = cpcal.Campaign.of(robot, *pose, [[height - 300.0]], exact=True)
    assert solves_exactly(campaign, 1, x)
    length = np.nextafter(campaign.length, toward)
    assert not solves_exactly(replace(campaign, length=length), 1, x)


def test_the_answer_says_that_it_is_exact() -> None:
    campaign = cpcal.simulate(seed=3, joint_error=0.0, factor=3.0, truncate=2.9)
    leg = cpcal.certify(campaign, legs=[1]).legs[0]
    assert leg.bracket.hi == 0.0
    assert "satisfies every equation exactly" in proved_sentence(Options(), leg)
    assert "for some readings: proved" in proved_sentence(Options(), leg)


def test_a_bracket_with_readings_closes_by_contraction_alone() -> None:
    """Boxes are not divided below the second-order effect of the readings: every small product counts there."""
    leg = cpcal.certify(cpcal.simulate(seed=7, joint_error=1.0), legs=[1]).legs[0]
    assert leg.bracket.hi - leg.bracket.lo < 1e-6 * leg.bracket.hi


def test_where_one_eps_is_asked_about_no_bound_below_it_is_stated() -> None:
    campaign = cpcal.simulate(seed=1, joint_error=1.0, factor=0.0, extremal=False, random_poses=16)
    best = cpcal.certify(campaign, legs=[1]).legs[0].bracket
    above = cpcal.certify(campaign, legs=[1], eps=1.2 * best.hi).legs[0].bracket
    assert (above.verdict, above.lo) == (cpcal.Verdict.PROVED, 0.0)
    below = cpcal.certify(campaign, legs=[1], eps=0.8 * best.lo).legs[0].bracket
    assert (below.verdict, below.lo) == (cpcal.Verdict.REFUTED, 0.8 * best.lo)
