"""`cpcal accuracy` and `cpcal report` from a run on disk to its page; what they cannot use they refuse."""

import dataclasses
import shutil

import pytest

import cpcal
from cpcal.checker.__main__ import main
from cpcal.questions.accuracy import load_accuracy, save_accuracy
from cpcal.simulate import simulate
from tests.cli.command import done, refused
from tests.remembered import verify_once

ERROR = 0.02  # mm: the joint error's amplitude, so the assumption holds


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A certified run of few poses: the one slow thing here, for the verb checks its certificates."""
    where = tmp_path_factory.mktemp("accuracy")
    campaign = simulate(seed=3, extremal=False, random_poses=12, noise=0.0, factor=0.0, joint_error=ERROR)
    cpcal.save_campaign(campaign, where / "campaign")
    done("certify", where / "campaign", "-o", where / "run", "--delta", "8", "--support", "none")
    (where / "poses.csv").write_text("pose,x,y,z,qw,qx,qy,qz\nhome,0,0,360,1,0,0,0\naside,20,-10,365,1,0,0,0\n")
    return where


def asked(folder, *arguments):
    return ("accuracy", folder / "run", "-o", folder / "out", *arguments)


def test_the_first_line_is_what_is_assumed_and_what_is_proved_holds_the_truth_and_is_verified(folder):
    said = done(*asked(folder, "--poses", folder / "poses.csv", "--assume", ERROR))
    first, second, *rest = said.splitlines()
    assert first.startswith("Simulated: the tool (origin of the mobile frame) is off by at most: ")
    assert second.startswith("ASSUMED: ")
    assert any(line.startswith("PROVED under the assumption: at 2 of 2 poses") for line in rest)
    out = folder / "out"
    assert "Next poses" in (out / "accuracy.html").read_text()
    assert len(list(out.glob("set-leg*.cert.jsonl"))) == 6
    assert "2 of 2 poses: PROVED, every pose within +-20.0 mm and +-0.1 rad that the legs allow" in done("verify", out)
    assert main([str(out)]) == 0  # the checker alone
    page, new = out / "accuracy.html", folder / "page.html"
    done("report", out, "-o", new)
    assert new.read_bytes() == page.read_bytes()
    found = load_accuracy(out)
    save_accuracy(dataclasses.replace(found, delta=80.0), out)
    page.unlink()
    assert "states another delta" in done("report", out, status=1)
    assert not page.exists()
    assert "accuracy.json: REFUSED, states another delta than is proved" in done("verify", out, status=1)


def test_the_answers_of_two_commands_in_one_folder_are_refused_by_both_doors(folder, tmp_path):
    both = shutil.copytree(folder / "run", tmp_path / "both")
    (both / "accuracy.json").write_text("{}")
    assert main([str(both)]) == 1
    assert "result.json and accuracy.json are the answers of two commands" in done("verify", both, status=1)


def test_half_a_workspace_and_a_run_that_is_not_one_are_refused(folder, tmp_path):
    refused("accuracy", tmp_path, "-o", tmp_path / "o", "--workspace", "x=0,y=0,z=400")
    assert "lacks z" in refused(*asked(folder, "--workspace", "x=0,y=0", "--assume", "much"))


def test_a_damaged_certificate_of_the_run_is_refused(folder):
    path = folder / "run" / "leg2.cert.jsonl"
    kept = path.read_text()
    path.write_text(kept[:-30])
    said = refused(*asked(folder, "--poses", folder / "poses.csv"))
    path.write_text(kept)
    assert "is refused" in said


@pytest.fixture
def copy(genuine, small, tmp_path, monkeypatch):
    """A folder of campaign/ and run/, as the demo leaves them."""
    verify_once(monkeypatch)  # no process begins
    shutil.copytree(genuine, tmp_path / "run")
    shutil.copytree(small, tmp_path / "campaign")
    return tmp_path


def test_the_page_is_written_where_one_says_from_the_run_alone(copy, tmp_path):
    page, new = copy / "run" / "report.html", tmp_path / "new" / "page.html"
    before = page.read_bytes()
    page.unlink()
    done("report", copy / "run", "-o", new)
    assert new.read_bytes() == before
    assert not page.exists()
    done("report", copy / "run")
    (copy / "run" / "campaign.json").unlink()
    assert "campaign.json" in refused("report", copy / "run")


def test_no_run_and_no_file(copy):
    assert "holds neither result.json nor a certificate" in refused("report", copy / "campaign")
    assert "is a folder" in refused("report", copy / "run", "-o", copy)
    within = copy / "run" / "result.json" / "page.html"
    assert "page.html: cannot be written" in refused("report", copy / "run", "-o", within)
