"""A run that Python saves holds its campaign, as one of the command line does."""

import shutil

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.files import load_campaign_json

CAMPAIGN = cpcal.simulate(seed=1, extremal=False, random_poses=8, joint_error=1.0, factor=0.0)


@pytest.fixture(scope="module")
def result():
    return cpcal.certify(CAMPAIGN, legs=[1], delta=0.5, eps=5.0, support="none")


def test_a_saved_run_needs_nothing_else_wherever_it_is_moved(result, tmp_path):
    cpcal.save_result(result, tmp_path / "run", CAMPAIGN)
    run = shutil.move(tmp_path / "run", tmp_path / "elsewhere")
    assert cpcal.load_result(run) == result
    assert load_campaign_json(run) == CAMPAIGN
    assert CliRunner().invoke(app, ["report", str(run)]).exit_code == 0


def test_a_result_is_not_saved_without_its_campaign(result, tmp_path):
    with pytest.raises(cpcal.InputError, match=r"campaign\.json"):
        cpcal.save_result(result, tmp_path / "run")
    with pytest.raises(cpcal.InputError, match="another campaign"):
        cpcal.save_result(result, tmp_path / "run", cpcal.simulate(seed=2))
    assert not (tmp_path / "run").exists()
    cpcal.save_result(result, tmp_path / "run", CAMPAIGN)
    other = cpcal.certify(cpcal.simulate(seed=2), legs=[1], delta=0.5, eps=5.0, support="none")
    with pytest.raises(cpcal.InputError, match="another campaign"):
        cpcal.save_result(other, tmp_path / "run")
    assert cpcal.load_result(tmp_path / "run") == result
