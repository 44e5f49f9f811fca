"""`cpcal verify`: accepts what certify wrote, refuses what was touched."""

from __future__ import annotations

import json
import shutil

import pytest
from typer.testing import CliRunner

import cpcal
from benchmarks.genuine_runs import RUNS
from cpcal.checker import Refused, certificates_of
from cpcal.checker.files import A_FILE
from cpcal.cli import app
from cpcal.files.folders import save_campaign_json


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("verify")
    cpcal.save_campaign(cpcal.simulate(seed=4, joint_error=1.0, factor=0.0), folder / "campaign")
    done = CliRunner().invoke(app, ["certify", str(folder / "campaign"), "-o", str(folder / "run"), "--legs", "2"])
    assert done.exit_code == 0
    return folder / "run"


def test_a_fresh_run_is_proved(run):
    leg = cpcal.load_result(run).legs[0]
    assert leg.bracket.certificate == "leg2.cert.jsonl"
    done = CliRunner().invoke(app, ["verify", str(run)])
    assert done.exit_code == 0
    assert "PROVED" in done.output
    assert "REFUSED" not in done.output
    one = CliRunner().invoke(
        app, ["verify", str(run / leg.bracket.certificate), "--campaign", str(run.parent / "campaign")]
    )
    assert one.exit_code == 0


def test_a_bound_that_is_not_proved_is_refused(run, tmp_path):
    lines = (run / "leg2.cert.jsonl").read_text().splitlines()
    claims = json.loads(lines[1])
    claims["epsilon"]["lo"] = claims["cap"]
    lines[1] = json.dumps(claims)
    forged = tmp_path / "forged.cert.jsonl"
    forged.write_text("\n".join(lines) + "\n")
    shutil.copy(run / "campaign.json", tmp_path)
    done = CliRunner().invoke(app, ["verify", str(forged), "--campaign", str(run.parent / "campaign")])
    assert done.exit_code == 1
    assert "REFUSED" in done.output
    assert "still open below eps_lo" in done.output


def test_constraints_of_ones_own_need_no_campaign(tmp_path):
    net = cpcal.Network()
    x, t = net.variable("x", 2, (-4.0, 4.0)), net.variable("t", (), (0.0, 9.0))
    net.add(cpcal.norm(x - 3.0) <= t)
    net.add(cpcal.norm(x + 3.0) <= t)
    net.minimize(t, certificate=tmp_path / "own.cert.jsonl")
    done = CliRunner().invoke(app, ["verify", str(tmp_path / "own.cert.jsonl")])
    assert done.exit_code == 0
    assert "No point of the box satisfies all 2 constraints with t < 4.24" in done.output
    assert "Some point of the box satisfies all 2 constraints with t <= 4.24" in done.output


def test_another_campaign_is_refused(run, tmp_path):
    cpcal.save_campaign(cpcal.simulate(seed=5, joint_error=1.0, factor=0.0), tmp_path / "other")
    done = CliRunner().invoke(app, ["verify", str(run), "--campaign", str(tmp_path / "other")])
    assert done.exit_code == 1
    assert "another one" in done.output


@pytest.mark.parametrize("what", ["nothing", "empty"])
def test_nothing_to_check_is_unusable(tmp_path, what):
    (tmp_path / "empty").mkdir()
    done = CliRunner().invoke(app, ["verify", str(tmp_path / what)])
    assert done.exit_code == 2


@pytest.mark.parametrize(
    "asked",
    [
        ["--eps", "5"],
        ["--eps", "1e-3"],
        ["--eps", "5", "--support", "irreducible"],
        ["--support", "irreducible"],
        ["--tolerance", "5"],
        ["--method", "timeout", "--time-limit", "5", "--gap", "0.5"],
        ["--time-limit", "1e-3"],
        ["--contractors", "hc4,lifted"],
        ["--model", "gain"],
        ["--delta", "0"],
    ],
    ids=" ".join,
)
def test_whatever_was_asked_an_honest_run_is_accepted(asked, tmp_path):
    small = cpcal.simulate(seed=1, extremal=False, random_poses=12, joint_error=1.0, factor=0.0)
    cpcal.save_campaign(small, tmp_path / "campaign")
    words = ["certify", str(tmp_path / "campaign"), "-o", str(tmp_path / "run"), "--legs", "1", "--delta", "0.5"]
    done = CliRunner().invoke(app, [*words, "--gap", "1e-2", *asked])
    assert done.exit_code in (0, 1), done.output
    checked = CliRunner().invoke(app, ["verify", str(tmp_path / "run")])
    certified = cpcal.load_result(tmp_path / "run").legs[0].certified
    assert checked.exit_code == (0 if certified else 2), checked.output
    assert "REFUSED" not in checked.output
    assert CliRunner().invoke(app, ["report", str(tmp_path / "run")]).exit_code == 0


def test_a_refuted_tolerance_is_certified(run, tmp_path):
    arguments = ["certify", str(run.parent / "campaign"), "-o", str(tmp_path / "run"), "--legs", "1", "--eps", "0.1"]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    done = CliRunner().invoke(app, ["verify", str(tmp_path / "run"), "--campaign", str(run.parent / "campaign")])
    assert done.exit_code == 0
    assert "|g| <= 0.1 mm for any readings" in done.output


def test_all_certificates_of_a_folder_share_one_budget(tmp_path, monkeypatch):
    """Each by itself costs less than half of what they may cost together."""
    RUNS["fits"](tmp_path)
    run = tmp_path / "run"
    among = certificates_of(run)
    before = among.budget.left
    for name in among.names:
        among.accepted(name)
        assert before - among.budget.left >= A_FILE
    whole, legs = before - among.budget.left, among.campaign.legs
    monkeypatch.setattr("cpcal.checker.run.leg_work", lambda *_: -(-whole // legs))
    assert CliRunner().invoke(app, ["verify", str(run)]).exit_code == 0
    monkeypatch.setattr("cpcal.checker.run.leg_work", lambda *_: whole // legs - 1)
    done = CliRunner().invoke(app, ["verify", str(run)])
    assert done.exit_code == 1
    refused = [line for line in done.output.splitlines() if "takes more work than the" in line]
    assert [line.split(":")[0] for line in refused] == [max(among.names)]


def test_a_folder_that_names_many_files_is_refused_before_they_are_read(tmp_path):
    """A certificate of a hundred bytes counts as a millisecond, and the campaign is read once for all of them."""
    save_campaign_json(cpcal.simulate(seed=4, factor=0.0), tmp_path)
    for k in range(30):
        (tmp_path / f"{k}.cert.jsonl").write_text("{}\n")
    among = certificates_of(tmp_path, work=25 * A_FILE)
    for k, name in enumerate(sorted(among.names)):
        with pytest.raises(Refused, match="more work than" if k >= 24 else "format"):
            among.accepted(name)


def test_other_files_are_refused_with_a_campaign_that_is_none(tmp_path):
    RUNS["fits"](tmp_path)
    (tmp_path / "run" / "campaign.json").write_text("{}")
    done = CliRunner().invoke(app, ["verify", str(tmp_path / "run")])
    assert done.exit_code == 1
    assert "run: REFUSED, campaign.json: it holds another key than" in done.output
