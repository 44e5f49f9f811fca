"""`cpcal check`: what it prints, and its exit status."""

import pytest
from typer.testing import CliRunner

from cpcal.cli.app import app
from cpcal.files import save_campaign
from cpcal.simulate import simulate
from tests.robot.wrong_ways import WRONG_WAYS

TRUE = simulate(seed=2, random_poses=20)


def check(campaign, folder):
    save_campaign(campaign, folder)
    return CliRunner().invoke(app, ["check", str(folder)])


def test_a_good_campaign_is_called_so_with_status_0(tmp_path):
    result = check(TRUE, tmp_path)
    assert result.exit_code == 0
    assert "84 measurements, 6 legs" in result.stdout
    assert "7 of 7" in result.stdout
    assert "Nothing looks wrong." in result.stdout


@pytest.mark.parametrize("way", ["quaternion scalar last", "one outlier"])
def test_a_finding_is_a_line_and_status_1(tmp_path, way):
    make, expected = WRONG_WAYS[way]
    result = check(make(TRUE), tmp_path)
    assert result.exit_code == 1
    (line,) = (line for line in result.stdout.splitlines() if line.startswith("! "))
    assert expected in line


def test_an_unusable_campaign_is_status_2(tmp_path):
    assert CliRunner().invoke(app, ["check", str(tmp_path / "none")]).exit_code == 2
