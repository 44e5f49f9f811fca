"""Robots: the paper's Table 1, and refusals."""

import pickle

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.robot import DELTALAB, Robot, known_robot


def test_deltalab_is_the_papers_table_1():
    assert DELTALAB.legs == 6
    assert DELTALAB.parameters[3].tolist() == [20.0093, 269.2575, 0.0, 157.9880, 114.3013, 0.0, 345.0]
    assert np.abs(np.linalg.norm(DELTALAB.base, axis=1) - 270).max() < 0.1  # "a base of radius 270 mm"
    assert np.abs(np.linalg.norm(DELTALAB.mobile, axis=1) - 195).max() < 0.1


def test_robots_are_values():
    copy = Robot.from_parameters(DELTALAB.name, DELTALAB.parameters)
    assert copy == DELTALAB
    assert hash(copy) == hash(DELTALAB)
    assert pickle.loads(pickle.dumps(copy)) == DELTALAB
    assert Robot("other", copy.base, copy.mobile, copy.offset) != DELTALAB
    with pytest.raises(ValueError, match="read-only"):
        copy.base[0, 0] = 1.0


def test_the_registry():
    assert known_robot("DeltaLab").robot is DELTALAB
    with pytest.raises(InputError, match="did you mean 'deltalab'"):
        known_robot("delta-lab")
    with pytest.raises(InputError, match="choose one of 'deltalab'"):
        known_robot("xyz")


@pytest.mark.parametrize(
    ("base", "mobile", "offset", "count"),
    [
        ([[0, 0, 0]], [[0, 0]], [1], 1),
        ([[0, 0, 0]], [[0, 0, 0], [1, 1, 1]], [1, 2, 3], 2),
        ([[0, 0, float("nan")]], [[0, 0, 0]], [float("inf")], 2),
        ([], [], [], 3),
        ([[0, 0, 0], [0]], [["a", 0, 0]], [1], 2),
    ],
)
def test_senseless_robots_are_refused_with_every_problem(base, mobile, offset, count):
    with pytest.raises(InputError) as caught:
        Robot("r", base, mobile, offset)
    assert len(caught.value.problems) == count
