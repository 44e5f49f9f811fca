"""The whole certificate, from a run to its page: what is assumed stands first, what is proved holds."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.common.errors import InputError
from cpcal.models import PARAMETERS
from cpcal.questions.accuracy import (
    NamedPoses,
    certify_accuracy,
    growth,
    load_accuracy,
    save_accuracy,
    suggested_error,
)
from cpcal.report.accuracy_page import assumption, degrees_up, sentences, write_accuracy
from cpcal.robot import ROBOTS, central_pose, forward_kinematics
from tests.models.known_robot import ERROR, known
from tests.report.made import made_leg, made_result

__all__ = ["known"]


@pytest.fixture(scope="module")
def result(known):
    return cpcal.certify(known.campaign, delta=8.0, support="none", gap=0.5)


@pytest.fixture(scope="module")
def named(known):
    readings = np.random.default_rng(8).uniform(5.0, 135.0, (3, 6))
    centre = central_pose(known.controller, np.full(6, 70.0))
    return NamedPoses(("p1", "p2", "p3"), forward_kinematics(known.controller, readings, centre))


@pytest.fixture(scope="module")
def found(known, result, named):
    return certify_accuracy(known.campaign, result, poses=named, assume=ERROR)


def test_the_truth_is_inside_and_what_is_assumed_is_said_first(found):
    assert found.truth_known
    assert not found.violated
    assert all(pose.proved for pose in found.poses)
    assert all(e.stated and e.eps == ERROR and e.refuted_below <= ERROR for e in found.legs)
    assert assumption(found).startswith("ASSUMED: ")
    assert "0.02 mm" in assumption(found)
    proved = [s for s in sentences(found) if s.startswith("PROVED")]
    printed = float(re.search(r"within ([\d.]+) mm", proved[0])[1])
    assert printed >= max(pose.position_bound for pose in found.poses)


@given(st.floats(1e-9, 3.2))
def test_printed_degrees_are_never_less_than_the_angle(angle):
    pi = Fraction(3141592653589793, 10**15)  # a little less, so that this asks for a little more than the angle
    assert Fraction(degrees_up(angle)) * pi >= 180 * Fraction(angle)


def test_it_is_written_and_read_again_and_the_page_says_what_is_assumed_before_what_is_proved(found, tmp_path):
    save_accuracy(found, tmp_path)
    assert load_accuracy(tmp_path) == found
    page = write_accuracy(found, tmp_path).read_text()
    assert page.index("ASSUMED:") < page.index("PROVED under the assumption")


def test_a_truth_beyond_the_bound_is_shown_as_a_failed_assumption(found):
    worse = replace(found.poses[1], estimated=replace(found.poses[1].estimated, true_position=5.0))
    wrong = replace(found, poses=(found.poses[0], worse))
    assert [pose.name for pose in wrong.violated] == ["p2"]
    assert any(s.startswith("THE ASSUMPTION FAILS") for s in sentences(wrong))


def test_an_error_that_the_campaign_refutes_gives_no_bounds(found, result, named):
    legs = tuple(replace(leg, lo=(), hi=()) if leg.leg in (1, 4) else leg for leg in found.legs)
    refuted = replace(found, legs=legs, poses=())
    assert sentences(refuted) == [  # others may have it outside of the box
        "REFUTED: the campaign allows no parameters of leg 1, 4 within 8 mm of the center of the run with so small an "
        "error. Nothing is proved."
    ]
    assert "within 8 mm of the center of the run" in assumption(refuted)


def test_every_mistake_is_named_at_once(known, result):
    with pytest.raises(InputError) as caught:
        certify_accuracy(known.campaign, result, controller="mine", assume=(0.1, 0.2))
    assert {problem.where for problem in caught.value.problems} == {"controller", "model_error"}


def test_the_least_error_grows_with_the_poses_and_the_suggestion_is_above_it(known):
    poses, errors = growth([known.campaign], 1, center=known.controller.parameters[0], delta=8.0)
    assert poses[-1] == len(known.campaign)
    assert list(errors) == sorted(errors)
    assert suggested_error(errors) > errors[-1]


def asked(name, legs, model=None, error=None):
    """Of a run that the solver has not made: a campaign, and legs without anything proved."""
    known = ROBOTS[name]
    where = {"stroke": known.stroke} if known.workspace is None else {"workspace": known.workspace}
    campaign = cpcal.simulate(known.robot, seed=1, extremal=False, random_poses=4, factor=0.0, **where)
    box = cpcal.Box(PARAMETERS, np.zeros(7), np.ones(7))
    nominal = [tuple(row) for row in known.robot.parameters.tolist()]
    rest = (box, 0.0, (), 1, 1, 0.1)
    result = made_result(campaign, *(made_leg(leg, 0.0, 0.0, (0.0,) * 7, nominal[leg - 1], *rest) for leg in legs))
    if model is not None:
        result = replace(result, model=replace(result.model, name=model))
    with pytest.raises(cpcal.InputError) as caught:
        certify_accuracy(campaign, result, assume=error)
    (problem,) = caught.value.problems
    return problem


@pytest.mark.parametrize(
    ("name", "legs", "changes", "where", "what"),
    [
        ("planar-3rpr", 3, {}, "robot", "has 3 legs"),
        ("cogiro", 8, {}, "robot", "has 8 legs"),
        ("deltalab", (2, 5), {}, "run", "holds these legs only: 2, 5"),
        ("deltalab", 6, {"model": "gain"}, "run", "has the leg model 'gain'"),
        # legs are taken to be longer than the error; parameters with shorter legs would be left out of the sets
        (
            "deltalab",
            6,
            {"error": (1.0, 1.0, 5000.0, 1.0, 1.0, 1.0)},
            "model_error",
            "5000 mm is no error of leg 3, whi",
        ),
    ],
)
def test_what_it_cannot_be_asked_of_is_refused_before_any_work(name, legs, changes, where, what):
    problem = asked(name, legs if isinstance(legs, tuple) else range(1, legs + 1), **changes)
    assert problem.where == where
    assert problem.what.startswith(what)
