"""The whole way: an imperfection that was switched on in a study is found by comparing models of the legs."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.calibration import calibrate_study
from cpcal.checker import check
from cpcal.cli import app
from cpcal.simulate import simulate_study

TOLERANCE = 0.3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a campaign of uncertain readings, two percent of gain in them, and what comparing found."""
    folder = tmp_path_factory.mktemp("study")
    study = simulate_study(seed=1, runs=4, validation_runs=2, random_poses=8, gain=0.02)
    cpcal.save_campaign(calibrate_study(study).campaign, folder / "campaign")
    campaign = cpcal.load_campaign(folder / "campaign")
    assert campaign.position_radius.all()
    models = ["plain", "gain", "lateral"]
    found = cpcal.compare(campaign, models, legs=[1], delta=30.0, tolerance=TOLERANCE, certificates=folder / "run")
    for model, result in found.items():
        cpcal.save_result(result, folder / "run" / model)
    return folder


def test_a_sensor_gain_error_is_found_in_a_study(run: Path) -> None:
    found = {model: cpcal.load_result(run / "run" / model) for model in ("plain", "gain", "lateral")}
    assert [cpcal.verdict_of(result, result.legs[0]).word for result in found.values()] == ["fail", "pass", "fail"]
    bracket = found["gain"].legs[0].bracket
    assert bracket.hi == 0.0  # the readings and a gain explain everything
    assert abs(bracket.enclosure["s"].mid) > 0.01


@pytest.mark.parametrize("model", ["plain", "gain", "lateral"])
def test_the_checker_proves_the_same(run: Path, model: str) -> None:
    bracket = cpcal.load_result(run / "run" / model).legs[0].bracket
    assert bracket.certificate == "leg1.cert.jsonl"
    found = check(run / "run" / model / bracket.certificate)
    claims = found.claims
    assert (found.leg, found.model) == (1, model)
    assert found.unknowns == ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l", *bracket.enclosure.names[7:], "eps")
    assert (claims.eps_lo, claims.eps_hi) == (bracket.lo, bracket.hi)
    assert claims.eps_lo is not None
    assert (claims.eps_lo > TOLERANCE) == (model != "gain")
    assert claims.point is not None
    assert claims.point.holds == tuple(range(found.count))
    assert claims.enclosure is not None
    for side, numbers in zip(claims.enclosure, (bracket.enclosure.lo, bracket.enclosure.hi), strict=True):
        assert side[:-1] == tuple(map(Fraction, map(float, numbers)))


def test_the_sentences_name_the_model(run: Path) -> None:
    outcome = CliRunner().invoke(app, ["verify", str(run / "run")])
    assert outcome.exit_code == 0, outcome.output
    output = outcome.output.splitlines()
    runs = {name: output[output.index(f"{name}:") :] for name in ("plain", "gain")}
    lines = [line for line in runs["gain"] if line.startswith("leg1.cert")]
    assert "s in [-0.05, 0.05] satisfies all" in lines[0]
    assert "equations of leg 1 in the gain model with |g| < 0 mm for any readings" in lines[0]
    assert (
        "satisfies all 64 equations of leg 1 in the gain model with |g| <= 0 mm for some readings in their sets: PROVED"
        in lines[1]
    )
    assert "mm long, s in [-0.02" in lines[2]
    plain = [line for line in runs["plain"] if line.startswith("leg1.cert")]
    assert "equations of leg 1 with |g| <" in plain[0]
