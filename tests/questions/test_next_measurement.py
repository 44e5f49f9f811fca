"""Next poses narrow what is not known; what is said of them is a first-order estimate."""

from itertools import pairwise

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.models.hand_eye import simulate_hand_eye
from cpcal.models.platform import Cells, cell_bounds
from cpcal.questions.next_measurement import Polytope, next_images, poses_to_measure
from cpcal.robot import central_pose
from tests.models.known_robot import known

__all__ = ["known"]


def test_each_pose_measured_narrows_the_worst_bound_that_is_expected(known):
    centre = central_pose(known.controller, np.full(6, 70.0))
    worst = type(centre)(centre.position[None], centre.quaternion[None])
    today = cell_bounds(Cells.of_poses(worst), known.sets)[1].position[0]
    polytopes = [Polytope.about(known.campaign, one) for one in known.sets]
    found = poses_to_measure(known.campaign, known.sets, polytopes, worst, 4)
    expected = [n.expected for n in found]
    assert len(expected) == 4
    assert all(b <= a * (1.0 + 1e-9) for a, b in pairwise(expected))
    assert expected[-1] < today


@pytest.fixture(scope="module")
def case():
    study = simulate_hand_eye(images=10, corners=(4, 3), pitch=60.0, seed=3).study
    rows = np.concatenate([study.poses.position, study.poses.quaternion], axis=1)
    away = {"away": [0.0, 0.0, 1e4, 1.0, 0.0, 0.0, 0.0]}
    return study, {f"c{k}": rows[k].tolist() for k in range(5, 10)} | away


def test_each_chosen_pose_narrows_the_widest_range_and_none_does_so_more(case):
    study, candidates = case
    known = study.part(np.arange(5))
    found = next_images(known, candidates, 2)
    assert found.unseen == ("away",)
    widest = [found.before.widest, *(one.widest for one in found.chosen)]
    assert all(after <= before * (1.0 + 1e-12) for before, after in pairwise(widest))  # the same but for rounding
    assert len({one.name for one in found.chosen}) == 2
    alone = [
        next_images(known, {name: candidates[name]}, 1).chosen[0].widest for name in ("c5", "c6", "c7", "c8", "c9")
    ]
    assert found.chosen[0].widest <= min(alone) * (1.0 + 1e-9)


def test_a_tolerance_that_nothing_meets_is_refused(case):
    with pytest.raises(InputError, match="tolerance"):
        next_images(case[0].part(np.arange(5)), case[1], 1, tolerance=0.01)


def test_more_poses_than_see_the_target_are_refused(case):
    with pytest.raises(InputError, match="seen from 5 of 6"):
        next_images(case[0].part(np.arange(5)), case[1], 6)
