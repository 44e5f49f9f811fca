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
    comparison = cpcal.compare(
        campaign, ["plain", "gain", "lateral"], legs=[1], tolerance=TOLERANCE, certificates=folder / "run"
    )
    cpcal.save_comparison(comparison, folder / "run")
    return folder


def test_a_sensor_gain_error_is_found_in_a_study(run: Path) -> None:
    comparison = cpcal.load_comparison(run / "run")
    entries = {entry.model: entry for entry in comparison.entries}
    assert entries["plain"].word(TOLERANCE) == "refuted"
    assert entries["lateral"].word(TOLERANCE) == "refuted"
    assert entries["gain"].word(TOLERANCE) == "not refuted"
    assert entries["gain"].eps_hi == 0.0  # the readings and a gain explain everything
    assert abs(entries["gain"].enclosure["s"].mid) > 0.01


def test_the_checker_proves_the_same(run: Path) -> None:
    for entry in cpcal.load_comparison(run / "run").entries:
        assert entry.certificate == f"{entry.model}-leg1.cert.jsonl"
        found = check(run / "run" / entry.certificate)
        claims = found.claims
        assert (found.leg, found.model) == (1, entry.model)
        assert found.unknowns == ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l", *entry.enclosure.names[7:], "eps")
        assert (claims.eps_lo, claims.eps_hi) == (entry.eps_lo, entry.eps_hi)
        assert (claims.eps_lo > TOLERANCE) == (entry.model != "gain")
        assert claims.point is not None
        assert claims.point.holds == tuple(range(found.count))
        for side, numbers in zip(claims.enclosure, (entry.enclosure.lo, entry.enclosure.hi), strict=True):
            assert side[:-1] == tuple(map(Fraction, map(float, numbers)))


def test_the_sentences_name_the_model(run: Path) -> None:
    outcome = CliRunner().invoke(app, ["verify", str(run / "run")])
    assert outcome.exit_code == 0, outcome.output
    lines = [line for line in outcome.output.splitlines() if line.startswith("gain-leg1")]
    assert "s in [-0.05, 0.05] satisfies all" in lines[0]
    assert "equations of leg 1 in the gain model with |g| < 0 mm for any readings" in lines[0]
    assert (
        "satisfies all 64 equations of leg 1 in the gain model with |g| <= 0 mm for some readings in their sets: PROVED"
        in lines[1]
    )
    assert "mm long, s in [-0.02" in lines[2]
    plain = [line for line in outcome.output.splitlines() if line.startswith("plain-leg1")]
    assert "equations of leg 1 with |g| <" in plain[0]
