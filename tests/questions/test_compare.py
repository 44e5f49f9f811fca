"""Comparisons: a gain error is found, nothing is found where nothing is, larger models are never worse."""

import re
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.checker.__main__ import PROVED, REFUSED, main
from cpcal.cli import app
from cpcal.files import campaign_sha256
from cpcal.report import write_report
from cpcal.report.run_page import comparison_section, write_comparison
from cpcal.simulate import true_robot
from tests.changed import with_gain

GAIN, TOLERANCE = 0.01, 0.3


@pytest.fixture(scope="module")
def exact():
    return with_gain(cpcal.simulate(seed=1, factor=0.0), GAIN)


@pytest.fixture(scope="module")
def uncertain():
    return with_gain(cpcal.simulate(seed=1, factor=3.0, truncate=2.9), GAIN)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("compared")


@pytest.fixture(scope="module")
def found(exact, folder):
    cpcal.save_campaign(exact, folder / "campaign")
    models = ("plain", "gain", "lateral")
    return cpcal.compare(exact, models, tolerance=TOLERANCE, legs=[1, 4], delta=30.0, certificates=folder / "run")


@pytest.fixture(scope="module")
def found_uncertain(uncertain):
    return cpcal.compare(uncertain, tolerance=TOLERANCE, legs=[2])


def leg_of(found, model, number):
    return next(leg for leg in found[model].legs if leg.leg == number)


def test_a_gain_error_refutes_the_plain_model_where_the_gain_model_stands(found):
    for number in (1, 4):
        plain, gain = (leg_of(found, name, number) for name in ("plain", "gain"))
        assert plain.bracket.lo > TOLERANCE >= gain.bracket.hi
        assert gain.bracket.enclosure["s"].mid == pytest.approx(GAIN, abs=2e-3)  # noise is not in the sets
        assert cpcal.verdict_of(found["plain"], plain).word == "fail"
        assert cpcal.verdict_of(found["gain"], gain).word == "pass"


def test_the_truth_is_in_the_enclosure_of_the_gain_model(found_uncertain, uncertain):
    plain, gain = (leg_of(found_uncertain, name, 2).bracket for name in ("plain", "gain"))
    assert plain.lo > TOLERANCE
    assert gain.hi == 0.0
    truth = np.append(true_robot(uncertain).parameters[1], GAIN)
    assert tuple(truth) in gain.enclosure
    assert not plain.enclosure.names[7:]


@pytest.mark.parametrize("kind", ["found", "found_uncertain"])
def test_nested_models_never_have_a_larger_eps(request, kind):
    comparison = request.getfixturevalue(kind)
    for result in comparison.values():
        for leg in result.legs:
            assert leg.bracket.lo <= leg.bracket.hi
            assert leg.bracket.lo <= leg_of(comparison, "plain", leg.leg).bracket.hi


def test_what_has_no_certificate_is_said_to_be_unchecked(uncertain, tmp_path):
    own = cpcal.LegModel("own", "L + l + k", (cpcal.Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
    comparison = cpcal.compare(uncertain, ["plain", own], tolerance=0.05, legs=[1], certificates=tmp_path, gap=1e-3)
    leg = comparison["own"].legs[0]
    assert leg.bracket.certificate is None
    assert leg.not_certified == "with uncertain readings a user-defined model has no certificate"
    certificates = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.jsonl"))
    assert certificates == [f"plain/leg1{kind}.cert.jsonl" for kind in ("", ".passes", ".recommended")]
    assert [row[5] for row in comparison_section(comparison).parts[0].tables[0].rows] == ["leg1.cert.jsonl", "none"]
    assert "which were not compared with the campaign" in write_comparison(comparison, tmp_path).read_text("utf-8")


def test_ctrl_c_leaves_what_is_proved(exact, monkeypatch, tmp_path):
    """The second leg is interrupted before it has an answer."""
    once = cpcal.certify.__globals__["certify_leg"]

    def stopped(question, leg):
        if leg == 2:
            raise KeyboardInterrupt
        return once(question, leg)

    monkeypatch.setitem(cpcal.certify.__globals__, "certify_leg", stopped)
    comparison = cpcal.compare(exact, ["plain", "gain"], legs=[1, 2, 3])
    assert [(model, result.interrupted) for model, result in comparison.items()] == [("plain", True)]
    assert [leg.leg for leg in comparison["plain"].legs] == [1]
    cpcal.save_campaign(exact, tmp_path / "c")
    words = ["certify", str(tmp_path / "c"), "-o", str(tmp_path / "r"), "--model", "plain,gain", "--legs", "1,2"]
    assert CliRunner().invoke(app, words).exit_code == 130
    assert "Interrupted" in (tmp_path / "r" / "compare.html").read_text(encoding="utf-8")
    assert {path.parent.name for path in (tmp_path / "r").glob("*/result.json")} == {"plain"}


def test_the_command(exact, tmp_path):
    cpcal.save_campaign(exact, tmp_path / "campaign")
    words = ["certify", str(tmp_path / "campaign"), "-o", str(tmp_path / "run"), "--legs", "1", "--tolerance", "0.3"]
    outcome = CliRunner().invoke(app, [*words, "--model", "plain,gain"])
    assert outcome.exit_code == 0, outcome.output
    assert re.search(r"leg 1: plain 0\.\d+ fail, gain 0\.\d+ pass; next: accept gain", outcome.output)
    comparison = {model: cpcal.load_result(tmp_path / "run" / model) for model in ("plain", "gain")}
    assert {result.campaign.sha256 for result in comparison.values()} == {campaign_sha256(exact)}
    page = (tmp_path / "run" / "compare.html").read_text(encoding="utf-8")
    for row in comparison_section(comparison).parts[0].tables[0].rows:
        assert all((cell if isinstance(cell, str) else cell.words) in page for cell in row)
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"plain", "gain", "compare.html"}
    names = {path.name for path in (tmp_path / "run" / "gain").iterdir()}
    files = {f"leg1{kind}.cert.jsonl" for kind in ("", ".passes", ".recommended")}
    assert names == {"campaign.json", "result.json", "report.html", *files}
    assert main([str(tmp_path / "run")]) == PROVED
    verified = CliRunner().invoke(app, ["verify", str(tmp_path / "run"), "--campaign", str(tmp_path / "campaign")])
    assert verified.exit_code == 0
    assert "leg1.cert.jsonl: leg 1, model gain, all 64 measurements" in verified.output
    cpcal.save_campaign(cpcal.simulate(seed=2), tmp_path / "other")
    other = CliRunner().invoke(app, ["verify", str(tmp_path / "run"), "--campaign", str(tmp_path / "other")])
    assert other.exit_code == 1
    assert "gain/campaign.json: REFUSED, the campaign is another one" in other.output
    result = tmp_path / "run" / "gain" / "result.json"
    result.write_text(result.read_text("utf-8").replace('"lo": ', '"lo": 1', 1), encoding="utf-8")
    assert main([str(tmp_path / "run")]) == REFUSED
    bad = CliRunner().invoke(app, [*words, "--model", "plain,gian,plain"])
    assert bad.exit_code == 2
    assert "2 problems" in bad.output
    strange = CliRunner().invoke(app, [*words, "--model", "plain,gain", "--eps", "1"])
    assert (strange.exit_code, "option --eps: has no meaning with several models" in strange.output) == (2, True)


def test_a_user_defined_model_is_given_to_what_draws_its_result(exact, tmp_path):
    own = cpcal.LegModel("own", "L + l + k", (cpcal.Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
    drawn = cpcal.certify(exact, legs=[1], model=own, ranges=True)
    page = write_report(exact, drawn, tmp_path, own).read_text(encoding="utf-8")
    assert "residuals over the measurements, and the band" in page
    for wrong in (replace(own, name="other"), replace(own, extra=(cpcal.Parameter("j", "mm", 1.0),))):
        with pytest.raises(cpcal.InputError, match="is not the result's"):
            write_report(exact, drawn, tmp_path, wrong)
