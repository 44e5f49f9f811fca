"""Projections of what certify found: they hold every solution, at the tolerance that they say, and survive a file."""

import dataclasses
import json
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog

import cpcal
from cpcal.models import PARAMETERS, model_residuals
from cpcal.questions import leg as one_leg
from cpcal.questions.bracket import prepared_leg
from cpcal.questions.leg import MARGIN, projections_of, range_eps
from cpcal.questions.question import Question
from cpcal.simulate import true_robot
from tests.changed import leg_with


@pytest.fixture(scope="module")
def exact():
    """Readings taken as exact, so that a point's eps is its largest residual."""
    campaign = cpcal.simulate(seed=1, joint_error=1.0, factor=0.0)
    return campaign, cpcal.certify(campaign, legs=[2], ranges=True, projections=True)


def holds(found, x):
    """Whether the box and every half-plane hold x, over the rationals."""
    value = dict(zip(PARAMETERS, map(Fraction, map(float, x)), strict=True))
    planes = [(s.parameters, plane) for s in found.projections for plane in s.half_planes]
    inside = all(Fraction(u) * value[p] + Fraction(v) * value[q] <= Fraction(c) for (p, q), (u, v, c) in planes)
    return inside and x in found.box


def test_they_hold_the_proved_point_and_the_solutions_farthest_from_it(exact):
    campaign, result = exact
    leg = result.legs[0]
    found = leg.ranges
    assert found.eps == MARGIN * leg.bracket.hi
    assert len(found.projections) == 7
    assert holds(found, leg.bracket.point)
    for pair in found.projections:
        for u, v, c in pair.half_planes[::5]:
            direction = np.zeros(7)
            direction[[PARAMETERS.index(name) for name in pair.parameters]] = u, v
            x = farthest(campaign, 2, np.array(leg.bracket.point), found.eps, direction)
            assert holds(found, x)
            # the sets are a few mm wide, and all but polyhedra: the bounds are nearly reached
            assert c - direction @ x < 0.02 * np.abs(direction) @ found.box.width


def farthest(campaign, leg, point, eps, direction):
    """A solution that lies far in a direction: by linear programs on the linearised equations, brought back to eps."""
    x = point
    for _ in range(4):
        steps = 1e-3 * np.eye(7)
        columns = [model_residuals(campaign, leg, x + h) - model_residuals(campaign, leg, x - h) for h in steps]
        jacobian, g = np.stack(columns, axis=1) / 2e-3, model_residuals(campaign, leg, x)
        rows = np.concatenate([jacobian, -jacobian])
        sides = np.concatenate([eps - g, eps + g])
        x = x + linprog(-direction / np.abs(direction).max(), rows, sides, bounds=[(-10, 10)] * 7).x
    inside, outside = 0.0, 1.0
    for _ in range(40):
        share = 0.5 * (inside + outside)
        reaches = np.abs(model_residuals(campaign, leg, point + share * (x - point))).max() < eps * (1 - 1e-9)
        inside, outside = (share, outside) if reaches else (inside, share)
    return point + inside * (x - point)


def test_they_say_more_than_the_box(exact):
    found = exact[1].legs[0].ranges
    box = found.box
    thinnest = min(
        (c - u * box.mid[i] - v * box.mid[j]) / (abs(u) * box.rad[i] + abs(v) * box.rad[j])
        for pair in found.projections
        for i, j in [[PARAMETERS.index(name) for name in pair.parameters]]
        for u, v, c in pair.half_planes
    )
    assert thinnest < 0.5


def test_noise_within_its_sets_leaves_the_truth_in(tmp_path):
    campaign = cpcal.simulate(seed=4, truncate=3.0)
    result = cpcal.certify(campaign, legs=[3], ranges=True, projections=True)
    leg = result.legs[0]
    assert leg.bracket.hi == leg.ranges.eps == 0.0
    assert holds(leg.ranges, true_robot(campaign).parameters[2])


def test_a_file_keeps_them_or_says_that_there_are_none(exact, tmp_path):
    result = exact[1]
    cpcal.save_result(result, tmp_path, exact[0])
    assert cpcal.load_result(tmp_path).legs == result.legs
    data = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    data["legs"][0]["ranges"]["information"]["projections"] = []
    (tmp_path / "result.json").write_text(json.dumps(data), encoding="utf-8")
    assert cpcal.load_result(tmp_path).legs[0].ranges.projections == ()


def with_options(result, **changes):
    return dataclasses.replace(result, options=dataclasses.replace(result.options, **changes))


def test_the_tolerance_fits_the_question(exact):
    result = exact[1]
    leg = result.legs[0]
    asked = with_options(result, eps=0.7)
    assert range_eps(asked.options, leg) == 0.7
    assert range_eps(asked.options, leg_with(leg, verdict=cpcal.Verdict.REFUTED)) is None
    assert range_eps(result.options, leg_with(leg, eps_hi=np.inf)) is None
    assert range_eps(result.options, leg) == MARGIN * leg.bracket.hi
    assert range_eps(with_options(result, tolerance=2.0 * leg.bracket.hi).options, leg) == 2.0 * leg.bracket.hi
    assert range_eps(with_options(result, tolerance=0.5 * leg.bracket.hi).options, leg) == MARGIN * leg.bracket.hi


def test_where_there_is_nothing_to_draw(exact):
    campaign, result = exact
    leg = result.legs[0]

    def drawn(ranges, **changes):
        question = Question(campaign=campaign, options=with_options(result, **changes).options)
        return projections_of(prepared_leg(question, leg.leg), ranges)

    assert drawn(leg.ranges, contractors=("hc4",)) == ()
    point = cpcal.Box(PARAMETERS, leg.bracket.point, leg.bracket.point)
    assert drawn(dataclasses.replace(leg.ranges, box=point)) == ()


def test_an_interrupt_keeps_what_is_there(exact, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    campaign, result = exact
    monkeypatch.setattr(one_leg, "projections_of", stop)
    found = cpcal.certify(campaign, legs=[2], ranges=True, projections=True, support="none")
    assert found.interrupted
    assert found.legs[0].ranges == dataclasses.replace(result.legs[0].ranges, projections=())


def test_none_is_made_unless_it_is_asked_for(exact):
    campaign, result = exact
    plain = cpcal.certify(campaign, legs=[2], ranges=True).legs[0].ranges
    assert plain == dataclasses.replace(result.legs[0].ranges, projections=())
    with pytest.raises(cpcal.InputError, match="ask for ranges too"):
        cpcal.certify(campaign, legs=[2], projections=True)
