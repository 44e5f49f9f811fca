"""What a run states and no certificate holds: `verify` names it, and `export` does not write it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from tests.checker.forged.test_checker_run import uncertified
from tests.cli.test_tampering import FIRST, SMALL, certified, leg, stated, told, verify


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return certified(tmp_path_factory.mktemp("whole"), 1)


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "run"))


def test_ranges_that_are_not_certified_are_named_and_not_exported(run: Path) -> None:
    box = {"lo": [0.0] * 7, "hi": [0.0] * 7}
    leg(ranges=lambda old: {"certificate": None, "information": {"eps": old["eps"], "box": old["box"] | box}})(run)
    (run / "ranges-leg1.cert.jsonl").unlink()
    done = verify(run)
    assert done.exit_code == 0
    assert "leg 1: its ranges are NOT CERTIFIED" in done.output
    exported = json.loads(CliRunner().invoke(app, ["export", str(run), "--format", "json"]).output)
    first, second = (leg["parameters"]["a_x"] for leg in exported["legs"])
    assert "range_lo" not in first
    assert "range_lo" in second
    assert "range_eps" not in exported["legs"][0]


def test_numbers_that_are_not_certified_are_not_exported_as_if_they_were(run: Path) -> None:
    stated(lambda data: uncertified(data["legs"][0]))(run)
    told(not_certified="no certificate was asked for", eps_lo=0.0, eps_hi=0.0, point=[0.0] * 7)(run)
    stated(lambda data: data["options"]["information"].update(tolerance=1.0))(run)
    (run / FIRST).unlink()
    exported = json.loads(CliRunner().invoke(app, ["export", str(run), "--format", "json"]).output)
    first, second = exported["legs"]
    assert (exported["verdict"], first["verdict"]) == ("not certified", "not certified")
    assert first["not_certified"] == "no certificate was asked for"
    assert not {"eps_lo", "eps_hi"} & set(first)
    assert "certified" not in first["parameters"]["a_x"]
    assert "certified" in second["parameters"]["a_x"]


def test_legs_that_nobody_asked_about_are_named(run: Path) -> None:
    """A leg that fails could be left out of a run, and what is left would look like the robot."""
    sentence = "Not asked about, and not judged: leg 3, 4, 5, 6."
    assert sentence in verify(run).output
    assert CliRunner().invoke(app, ["report", str(run)]).exit_code == 0
    assert sentence in (run / "report.html").read_text(encoding="utf-8")
    exported = json.loads(CliRunner().invoke(app, ["export", str(run), "--format", "json"]).output)
    assert exported["missing_legs"] == [3, 4, 5, 6]


def test_an_eps_beyond_the_lengths_of_the_legs_is_refused(tmp_path: Path) -> None:
    """The model takes legs to be longer than eps: without one nothing is left to satisfy the equations."""
    arguments = ["certify", str(tmp_path / "campaign"), "-o", str(tmp_path / "new"), "--legs", "1"]
    cpcal.save_campaign(cpcal.simulate(seed=1, **SMALL), tmp_path / "campaign")
    done = CliRunner().invoke(app, [*arguments, "--eps", "2000", "--tolerance", "30"])
    assert done.exit_code == 2
    assert "2000 mm is no error of leg 1" in done.output
    assert not (tmp_path / "new" / "result.json").exists()
