"""`check_data` names what is wrong with a campaign and finds nothing in good ones."""

import numpy as np
import pytest

import cpcal
from benchmarks.wrong_ways import WRONG_WAYS
from cpcal.robot import known_robot
from cpcal.simulate import simulate

TRUE = simulate(seed=2, random_poses=20, joint_error=0.5)


QUICK = (
    *("fixed axes for turned ones", "target shifted", "tracker frame", "metres and scalar last", "Euler order"),
    *("degrees for radians", "all in metres", "offset missing", "rows shifted", "uncertainties too large"),
    *("duplicate rows", "one outlier", "one wrong pose", "constant pose", "sigma in degrees"),
)


@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=[] if way in QUICK else pytest.mark.nightly) for way in WRONG_WAYS]
)
def test_every_wrong_way_to_enter_data_is_named(way):
    make, expected = WRONG_WAYS[way]
    found = cpcal.check_data(make(TRUE))
    assert len(found.findings) == 1
    assert expected in found.findings[0]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("joint_error", [0.0, 2.0])
def test_good_campaigns_have_no_findings(seed, joint_error):
    found = cpcal.check_data(simulate(seed=seed, joint_error=joint_error, factor=3.0 * (seed % 2)))
    assert found.good
    assert [leg.rank for leg in found.legs] == [7] * 6


def test_what_a_planar_robot_cannot_show_is_named_as_open():
    planar = known_robot("planar-3rpr")
    found = cpcal.check_data(simulate(planar.robot, seed=1, random_poses=20, workspace=planar.workspace))
    (finding,) = found.findings
    assert "Legs 1, 2, 3: " in finding
    assert "leave 2 of 7 parameters open: a_z, b_z." in finding
    assert found.legs[0].undetermined == ("a_z", "b_z")


def test_outliers_come_worst_first_and_are_counted():
    length = TRUE.length.copy()
    length[np.arange(8), 1] += np.linspace(5.0, 12.0, 8)
    changed = cpcal.check_data(cpcal.Campaign.of(TRUE.robot, TRUE.position, TRUE.quaternion, length, exact=True))
    said = changed.findings
    assert said[0].startswith("p7/1: leg 2 reads ")
    assert len(said) == 6
    assert said[-1] == "3 more measurements are as far off."


def test_few_poses_leave_parameters_open():
    few = simulate(seed=1, extremal=False, random_poses=5)
    found = cpcal.check_data(few)
    assert all(" parameters open: " in finding for finding in found.findings)
    assert all(leg.rank < 7 for leg in found.legs)
