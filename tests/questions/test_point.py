"""Certification of given points: what is proved of each measurement, against exact arithmetic and sampled readings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cpcal
from cpcal.checker import check
from cpcal.models import fit_model, leg_model, leg_statement
from cpcal.robot import ModelChoice
from cpcal.simulate import true_robot
from cpcal.solver.certificate.float_rows import at_point, failing, holding

SMALL = {"extremal": False, "random_poses": 24}


@pytest.mark.parametrize("eps", [0.0, 0.5])
@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_verdicts_agree_with_exact_fractions(factor: float, eps: float) -> None:
    campaign = cpcal.simulate(seed=2, joint_error=10.0, factor=factor, **SMALL)
    x = fit_model(campaign, 3)
    found = cpcal.certify_point(campaign, 3, x, eps=eps)
    problem, at = leg_statement(campaign, 3).problem, at_point([*x, eps])
    for k, name in enumerate(campaign.measurement_ids):
        assert (holding(problem, at, k) is not None) == (name in found.holds)
        assert (failing(problem, at, k) is not None) == (name in found.fails)
    assert found.verified.fails > 0


@pytest.mark.parametrize("model", ["plain", "gain", "lateral"])
@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_the_certificate_says_the_same(factor: float, model: str, tmp_path: Path) -> None:
    cpcal.save_campaign(cpcal.simulate(seed=2, joint_error=10.0, factor=factor, **SMALL), tmp_path)
    campaign = cpcal.load_campaign(tmp_path)
    path = tmp_path / "point.cert.jsonl"
    x = fit_model(campaign, 2, leg_model(model))
    plain = cpcal.certify_point(campaign, 2, x, eps=0.3, model=model)
    found = cpcal.certify_point(campaign, 2, x, eps=0.3, certificate=path, model=model)
    assert (found.holds, found.fails) == (plain.holds, plain.fails)
    accepted = check(path)
    assert accepted.model == model
    assert accepted.claims.point is not None
    ids = campaign.measurement_ids
    assert tuple(ids[k] for k in accepted.claims.point.holds) == found.holds
    assert tuple(ids[k] for k in accepted.claims.point.fails) == found.fails
    assert found.holds
    assert found.fails


def test_what_float64_cannot_decide_neither_holds_nor_fails() -> None:
    """The point solves the one equation exactly, which outward rounding does not see."""
    robot = cpcal.Robot("one leg", [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [0.0])
    pose = [[0.0, 0.0, 300.1]], [[0.6, 0.0, 0.0, 0.8]]
    campaign = cpcal.Campaign.of(robot, *pose, [[300.1 - 300.0]], exact=True)
    found = cpcal.certify_point(campaign, 1, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 300.0])
    assert (found.holds, found.fails) == ((), ())
    assert found.verified.verdict is cpcal.Verdict.UNKNOWN
    assert "1 are undecided" in found.verified.sentence("It")


def test_points_of_models(tmp_path: Path) -> None:
    campaign = cpcal.simulate(seed=3, joint_error=0.0, factor=3.0, truncate=2.9, **SMALL)
    campaign = replace(campaign, length=campaign.length / 1.02, model=ModelChoice("gain", {}))
    x = [*true_robot(campaign).parameters[0], 0.02]
    assert cpcal.certify_point(campaign, 1, x).verified.verdict is cpcal.Verdict.PROVED  # as the campaign has it
    assert cpcal.certify_point(campaign, 1, x[:7], model="plain").verified.verdict is cpcal.Verdict.REFUTED
    with pytest.raises(cpcal.InputError, match="a point of the gain model is 8 finite numbers"):
        cpcal.certify_point(campaign, 1, x[:7])
    own = cpcal.LegModel("mine", "L + l + k", (cpcal.Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
    assert cpcal.certify_point(campaign, 1, x, model=own).verified.verdict is cpcal.Verdict.REFUTED
    with pytest.raises(cpcal.InputError, match="a user-defined model, has none"):
        cpcal.certify_point(campaign, 1, x, model=own, certificate=tmp_path / "none")
    with pytest.raises(cpcal.InputError) as refused:
        cpcal.certify_point(campaign, 9, x, model="gian", eps=-1.0)
    assert [p.where for p in refused.value.problems] == ["model", "leg", "eps"]


def test_an_error_as_large_as_the_leg_is_long_is_no_question() -> None:
    """The model takes legs to be longer than the error: at such a one every point would be called proved to fail."""
    campaign = cpcal.simulate(seed=1, **SMALL)
    x = campaign.robot.parameters[0]
    length = float(np.min(campaign.length[:, 0] - campaign.length_radius[:, 0])) + float(x[6])
    assert cpcal.certify_point(campaign, 1, x, eps=length - 1.0).verified.holds == len(campaign)
    with pytest.raises(cpcal.InputError, match="mm is no error of leg 1, which is "):
        cpcal.certify_point(campaign, 1, x, eps=length)
