"""The leg model `sag`, by its entry point: its equation, and what it finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cpcal
from cpcal.calibration.diagnosis import mid_range, sag_shape
from cpcal.models import built_in, fit_model, leg_model, model_residuals
from cpcal.robot import Pose, leg_vectors


@pytest.fixture(scope="module")
def exact():
    return cpcal.simulate(seed=1, factor=0.0, deviation=0.0, noise=0.0)


def bent(campaign, c):
    """The same poses read by the sensors of legs that sag by c mm: longer by what is lost."""
    length, robot = campaign.length.copy(), campaign.robot
    vector = leg_vectors(robot, Pose(campaign.position, campaign.quaternion))
    for _ in range(30):
        shape = sag_shape(vector, length + robot.offset, robot.offset + mid_range(length), np.array([0.0, 0.0, 1.0]))
        length = campaign.length + c * shape
    return replace(campaign, length=length)


def test_it_comes_by_its_entry_point():
    model = leg_model("sag")
    assert (model.name, model.parameters[-1]) == ("sag", "c")
    assert not built_in(model)


def test_its_equation_holds_for_legs_that_sag(exact):
    heavy, model = bent(exact, 2.0), leg_model("sag")
    x = np.append(heavy.robot.parameters[2], 2.0)
    assert np.abs(model_residuals(heavy, 3, x, model)).max() < 1e-9
    assert np.abs(model_residuals(heavy, 3, np.append(x[:7], 0.0), model)).max() > 1.0


def test_its_fit_finds_the_sag(exact):
    assert fit_model(bent(exact, 2.0), 3, leg_model("sag"))[-1] == pytest.approx(2.0, abs=1e-4)


def test_proofs_enclose_it(exact):
    found = cpcal.compare(bent(exact, 2.0), ["plain", "sag"], legs=[3], tolerance=0.1)
    assert [cpcal.verdict_of(result, result.legs[0]).word for result in found.values()] == ["fail", "not compared"]
    assert found["sag"].legs[0].bracket.hi <= 0.1
    assert 2.0 in found["sag"].legs[0].bracket.enclosure["c"]
