"""Given points and fits as solutions: what is proved of each measurement, against exact arithmetic and samples."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cpcal
from cpcal.checker import check
from cpcal.cli.verify import checked_certificates
from cpcal.models import fit_model, leg_model, leg_statement
from cpcal.questions import calibrate_study
from cpcal.questions.points import certify_fits, fits_of
from cpcal.robot import ModelChoice
from cpcal.simulate import simulate_study, true_robot
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


@pytest.fixture(scope="module")
def found():
    return calibrate_study(simulate_study(seed=3, runs=3, validation_runs=2, random_poses=5, sag=2.0))


@pytest.fixture(scope="module")
def folder(found, tmp_path_factory):
    return tmp_path_factory.mktemp("fits") / "fits"


@pytest.fixture(scope="module")
def fits(found, folder):
    return certify_fits(found.campaign, found.record, folder, legs=[5, 2])


def test_both_fits_are_verified_with_certificates(found, fits, folder):
    accepted = checked_certificates(folder)
    assert fits_of(folder, found.campaign, [2, 5], accepted) == fits
    assert sorted(accepted) == [f"{name}.leg{leg}.cert.jsonl" for name in ("x_c", "x_c_sigma") for leg in (2, 5)]
    for verified, fit in ((fits["x_c"], found.x_c), (fits["x_c_sigma"], found.x_c_sigma)):
        assert [leg.leg for leg in verified] == [2, 5]
        for leg in verified:
            alone = cpcal.certify_point(found.campaign, leg.leg, fit.parameters[leg.leg - 1])
            assert (leg.verified, leg.point) == (alone.verified, alone.point)
            assert leg.verified.verdict is cpcal.Verdict.REFUTED


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda run: (run / "x_c.leg2.cert.jsonl").unlink(), "it is missing"),
        (lambda run: shutil.copy(run / "x_c.leg2.cert.jsonl", run / "x_c.leg1.cert.jsonl"), "is called so"),
        (lambda run: shutil.copy(run / "x_c.leg2.cert.jsonl", run / "x_c.leg5.cert.jsonl"), "is called so"),
        (lambda run: (run / "x_c.leg2.cert.jsonl").write_text(""), "it is empty"),
        (lambda run: [path.unlink() for path in run.glob("*.jsonl")], "it is missing"),
    ],
)
def test_a_folder_that_was_touched_is_refused(found, fits, folder, tmp_path, change, reason):
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    change(run)
    with pytest.raises(cpcal.InputError, match=reason):
        fits_of(run, found.campaign, [2, 5], checked_certificates(run))


def test_a_point_of_another_model_or_of_some_measurements_is_no_fit(found, fits, folder, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    at = [*fits["x_c"][0].point, 0.0]
    path = run / "x_c.leg2.cert.jsonl"
    cpcal.certify_point(found.campaign, 2, at, model="gain", certificate=path)
    with pytest.raises(cpcal.InputError, match="is called so"):
        fits_of(run, found.campaign, [2, 5], checked_certificates(run))


def test_another_campaign_is_refused(found, fits, folder, tmp_path):
    other = cpcal.simulate(seed=2)
    with pytest.raises(cpcal.InputError, match="is called so"):
        fits_of(folder, other, [2, 5], checked_certificates(folder))
    with pytest.raises(cpcal.InputError, match="another campaign"):
        certify_fits(other, found.record, tmp_path)
