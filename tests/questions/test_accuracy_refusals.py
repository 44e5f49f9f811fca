"""What a certificate of accuracy cannot be asked of is refused in one sentence, before any work."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import cpcal
from cpcal.models import PARAMETERS
from cpcal.questions.accuracy import certify_accuracy
from cpcal.robot import ROBOTS
from tests.report.made import made_leg, made_result


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
        result = dataclasses.replace(result, model=dataclasses.replace(result.model, name=model))
    with pytest.raises(cpcal.InputError) as caught:
        certify_accuracy(campaign, result, model_error=error)
    (problem,) = caught.value.problems
    return problem


def test_a_robot_with_another_number_of_legs_is_refused():
    for name, legs in (("planar-3rpr", 3), ("cogiro", 8)):
        problem = asked(name, range(1, legs + 1))
        assert (problem.where, problem.what) == ("robot", f"has {legs} legs")


def test_a_run_of_some_legs_is_refused_and_says_which_it_holds():
    problem = asked("deltalab", (2, 5))
    assert (problem.what, problem.remedy) == ("holds these legs only: 2, 5", "certify all six")


def test_a_run_of_another_model_is_refused():
    assert asked("deltalab", range(1, 7), "gain").what == "has the leg model 'gain'"


def test_a_model_error_beyond_the_lengths_of_legs_is_not_called_refuted():
    """Legs are taken to be longer than the error; parameters with shorter legs would be left out of the sets."""
    problem = asked("deltalab", range(1, 7), error=(1.0, 1.0, 5000.0, 1.0, 1.0, 1.0))
    assert (problem.where, problem.what[:33]) == ("model_error", "5000 mm is no error of leg 3, whi")
