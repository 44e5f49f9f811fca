"""eps = 0 in exact arithmetic: decided by the checker, which refuses what is not so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import cpcal
from cpcal.models import leg_statement
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


def test_the_truth_solves_and_one_bad_reading_or_a_wrong_offset_does_not() -> None:
    campaign = cpcal.simulate(seed=5, joint_error=0.0, factor=3.0, truncate=2.9)
    x, length = truth(campaign), campaign.length.copy()
    assert solves_exactly(campaign, 1, x)
    assert not solves_exactly(campaign, 1, x + 5.0 * np.eye(7)[6])
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


def test_a_bracket_with_readings_closes_by_contraction_alone() -> None:
    """Boxes are not divided below the second-order effect of the readings: every small product counts there."""
    leg = cpcal.certify(cpcal.simulate(seed=7, joint_error=1.0), legs=[1]).legs[0]
    assert leg.bracket.hi - leg.bracket.lo < 1e-6 * leg.bracket.hi
