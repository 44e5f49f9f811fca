"""Campaigns in memory: checked as a whole."""

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.robot import DELTALAB, Campaign, Uncertainty


def in_memory(**changes):
    values = {"position": np.zeros((3, 3)), "quaternion": np.tile([1.0, 0, 0, 0], (3, 1)), "length": np.zeros((3, 6))}
    how = {} if "uncertainty" in changes else {"exact": True}
    return Campaign.of(DELTALAB, **values | how | changes)


def test_every_problem_of_a_campaign_in_memory_is_reported_at_once():
    position = np.zeros((3, 3))
    position[1, 2] = np.nan
    quaternion = np.array([[1.0, 0, 0, 0], [1.0, 0.1, 0, 0], [0.0, 0, 0, 0]])
    with pytest.raises(InputError) as caught:
        in_memory(position=position, quaternion=quaternion, pose=["a", "a", "b/c"], run="111", length_radius=-1.0)
    message = str(caught.value)
    assert len(caught.value.problems) == 8
    for part in (
        "'b/c' cannot be a name",
        "measurement a/1: is given 2 times",
        "measurement a/1: its position is NaN",
        "measurement a/1: the quaternion has the norm 1.00498756, not 1",
        "measurement b/c/1: the quaternion is zero",
        "its length_radius is negative, NaN",
    ):
        assert part in message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros((0, 3)), "quaternion": np.zeros((0, 4)), "length": np.zeros((0, 6))}, "no meas"),
        ({"length": np.zeros((3, 5))}, r"has the shape \(3, 5\), not \(3, 6\)"),
        ({"quaternion": np.zeros((2, 4))}, "campaign quaternion"),
        ({"position_radius": np.zeros((2, 3))}, "campaign position_radius"),
        ({"run": ["1"]}, "has 1 names"),
        ({"pose": ["a", "b", "\ud800"]}, "cannot be a name"),
        ({"pose": ["a", "b", ""]}, "cannot be a name"),
        ({"pose": ["a", "b", 3]}, "cannot be a name"),
        ({"position": "abc"}, "numbers"),
        ({"position": 3.0}, "campaign position"),
        ({"provenance": {"a": 3}}, "printable"),
        ({"provenance": {"a": "\ud800"}}, "printable"),
        ({"uncertainty": Uncertainty([0, 0, 0], [0, 0, 0], [0] * 5, 3)}, "has 5 numbers for 6 legs"),
        ({"length": np.full((3, 6), np.inf)}, "infinite"),
        ({"quaternion": np.full((3, 4), 1e300)}, "the norm 2e\\+300"),
    ],
)
def test_what_makes_no_campaign_in_memory(changes, message):
    with pytest.raises(InputError, match=message):
        in_memory(**changes)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (([0, 0], [0, 0, 0], [0]), r"position: has the shape \(2,\)"),
        (([0, 0, -1], [0, 0, 0], [0]), "position: holds a number that is negative"),
        (([0, 0, 0], [0, 0, 0], [np.inf]), "length: holds a number that is negative, not finite"),
        (([1e308, 0, 0], [0, 0, 0], [0], 10.0), "position: holds a number that is negative, not finite or above"),
        (([0, 0, 0], [0, 0, 0], [0], -1.0), "factor: is -1.0"),
    ],
)
def test_senseless_uncertainties(arguments, reason):
    with pytest.raises(InputError, match=reason):
        Uncertainty(*arguments)
