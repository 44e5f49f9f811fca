"""Next poses narrow what is not known, and the polytope they are chosen from agrees with the certified set."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cpcal.models.leg_set import SIZE
from cpcal.models.platform import pose_bounds
from cpcal.questions.next_measurement import CERTIFIED, DETERMINANT, Polytope, next_poses
from cpcal.robot import central_pose
from tests.models.known_robot import known

__all__ = ["known"]


def test_the_polytope_has_nearly_the_proved_ranges(known):
    one = known.sets[0]
    forms = np.random.default_rng(2).standard_normal((6, 7))
    middle, half = Polytope.about(known.campaign, one).ranges(forms)
    directions = np.zeros((6, SIZE))
    directions[:, :7] = forms
    proved = one.ranges(directions)
    assert middle == pytest.approx(proved.mid, abs=0.05 * proved.rad.max())
    assert half == pytest.approx(proved.rad, rel=0.05)


def test_each_pose_measured_narrows_the_worst_bound_that_is_expected(known):
    centre = central_pose(known.controller, np.full(6, 70.0))
    worst = type(centre)(centre.position[None], centre.quaternion[None])
    today = pose_bounds(worst, known.sets).position[0]
    found = next_poses(known.campaign, known.sets, worst, 4)
    assert [n.by for n in found] == [CERTIFIED] * 4 + [DETERMINANT] * 4
    for by in (CERTIFIED, DETERMINANT):
        expected = [n.expected for n in found if n.by == by]
        assert all(b <= a * (1.0 + 1e-9) for a, b in pairwise(expected))
        assert expected[-1] < today
