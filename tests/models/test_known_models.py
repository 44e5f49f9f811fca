"""Leg models of other packages: found by entry point, in this process and in every other one."""

import os
import subprocess
import sys

import pytest

import cpcal
from cpcal.models import built_in, leg_model

MODULE = """
from cpcal import LegModel, Parameter
stretched = LegModel("stretched", "L + l + k", (Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
misnamed = stretched
shadowing = LegModel("plain", "L + l + k", (Parameter("k", "mm", 1.0),), lambda measured, x: x["k"])
"""
POINTS = """[cpcal.leg_models]
stretched = others:stretched
broken = absent:model
other = others:misnamed
plain = others:shadowing
"""


@pytest.fixture
def other_package(tmp_path, monkeypatch):
    """A folder on sys.path that holds an installed package with four leg models, only one of which is usable."""
    metadata = tmp_path / "others-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    (tmp_path / "others.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_an_entry_point_makes_a_model_known_by_its_name(other_package):
    model = leg_model("stretched")
    assert model.parameters[7:] == ("k",)
    assert not built_in(model)


def test_a_broken_or_misnamed_entry_point_is_refused_with_what_it_names(other_package):
    with pytest.raises(cpcal.PluginError, match=r"leg model 'broken' \(absent:model\) does not load"):
        leg_model("broken")
    with pytest.raises(cpcal.PluginError, match=r"'other' \(others:misnamed\) is no cpcal.LegModel of that name"):
        leg_model("other")


def test_no_package_takes_the_place_of_a_model_of_cpcal(other_package):
    assert built_in(leg_model("plain"))


def test_an_unknown_name_lists_those_there_are(other_package):
    with pytest.raises(cpcal.InputError, match="plain, gain, linear, lateral, broken, other, sag, stretched,"):
        leg_model("streched")


def test_a_report_in_another_process_has_all_figures_of_a_provided_model(other_package, tmp_path):
    campaign = cpcal.simulate(seed=1, factor=0.0, joint_error=1.0)
    cpcal.save_campaign(campaign, tmp_path / "campaign")
    cpcal.save_result(cpcal.certify(campaign, legs=[1], model="stretched"), tmp_path / "run", campaign)
    environment = {**os.environ, "PYTHONPATH": str(other_package)}
    command = [sys.executable, "-m", "cpcal", "report", str(tmp_path / "run"), "--campaign", str(tmp_path / "campaign")]
    for variables, drawn in ((environment, True), (dict(os.environ), False)):
        subprocess.run(command, env=variables, check=True, capture_output=True)
        page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
        assert ("residuals of the proved point over the measurements" in page) is drawn
        assert ("the leg model &#39;stretched&#39; is not known here" in page) is not drawn
