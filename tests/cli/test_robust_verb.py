"""`cpcal certify --outliers` and `cpcal verify` on what it wrote."""

from __future__ import annotations

import json

import pytest

import cpcal
from cpcal.simulate import simulate
from tests.cli.command import done, run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    good = simulate(seed=1, extremal=False, random_poses=14, factor=0.0, noise=0.02, joint_error=0.05)
    length = good.length.copy()
    length[5, 0] += 2.0
    where = tmp_path_factory.mktemp("robust")
    made = cpcal.Campaign.of(good.robot, good.position, good.quaternion, length, pose=good.pose, exact=True)
    cpcal.save_campaign(made, where / "campaign")
    said = done("certify", where / "campaign", "-o", where / "out", "--outliers", "1", "--legs", "1")
    assert "r005/1" in said
    return where / "out"


def test_what_was_written_is_proved_again(folder):
    said = done("verify", folder)
    assert "leg 1, at most 1 wrong: PROVED, eps >= 0.0" in said  # not the 2 mm of the wrong one
    assert "leaving out r005/1" in said


def test_the_page_names_what_is_left_out(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    done("report", folder)
    assert (folder / "report.html").read_text(encoding="utf-8") == page
    assert "r005/1" in page
    assert "Whichever 1 measurements of a leg are wrong" in page


def test_a_bound_that_says_more_is_refused(folder):
    path = folder / "result.json"
    text = path.read_text()
    value = json.loads(text)
    value["legs"][0]["bracket"]["lo"] *= 1.01
    path.write_text(json.dumps(value))
    outcome = run("verify", folder)
    path.write_text(text)
    assert outcome.exit_code == 1
    assert "REFUSED" in outcome.output
