"""A certify that is killed, whenever: `verify` says unfinished, or accepts the whole answers of one run."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.files import campaign_sha256
from cpcal.files.run_folder import LOCK_NAME

OPTIONS = ("--legs", "1,2", "--delta", "0.5", "--gap", "1e-2")


def started(campaign: Path, run: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "cpcal", "certify", str(campaign), "-o", str(run), *OPTIONS]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def digest(run: Path) -> str:
    return str(json.loads((run / "result.json").read_text(encoding="utf-8"))["campaign"]["sha256"])


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("campaigns")
    for seed in (1, 2):
        small = cpcal.simulate(seed=seed, joint_error=1.0, factor=0.0, extremal=False, random_poses=12)
        cpcal.save_campaign(small, folder / str(seed))
    return [folder / "1", folder / "2"]


def test_a_killed_run_leaves_no_mixture(campaigns: list[Path], tmp_path: Path) -> None:
    run, moments = tmp_path / "run", random.Random(7)
    began = time.monotonic()
    assert started(campaigns[0], run).wait(60) == 0
    whole, old = time.monotonic() - began, digest(run)
    for _ in range(5):
        process = started(campaigns[1], run)
        time.sleep(moments.uniform(0.3, 1.0) * whole)
        process.send_signal(signal.SIGKILL)
        process.wait(60)
        said = CliRunner().invoke(app, ["verify", str(run)])
        assert "Traceback" not in said.output
        assert "REFUSED" not in said.output
        if (run / "result.json").exists():
            assert said.exit_code == 0, said.output
            assert digest(run) in (old, campaign_sha256(cpcal.load_campaign(campaigns[1])))
        else:
            assert said.exit_code == 2, said.output
    assert started(campaigns[1], run).wait(60) == 0  # the dead hold no lock
    assert digest(run) == campaign_sha256(cpcal.load_campaign(campaigns[1]))
    assert {p.name for p in run.iterdir()} >= {"result.json", "campaign.json", "report.html"}
    assert not [p for p in run.iterdir() if p.name.startswith(".") and p.name != LOCK_NAME]


def test_a_link_in_a_drafts_place_is_not_followed(
    campaigns: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even one who guesses the draft's name cannot have a file outside overwritten."""
    run, outside = tmp_path / "run", tmp_path / "outside"
    run.mkdir()
    outside.mkdir()
    (outside / "result.json").write_text("precious", encoding="utf-8")
    os.symlink(outside, run / f".{'0' * 24}.draft")
    monkeypatch.setattr("cpcal.files.run_folder.draft_name", lambda *_: f".{'0' * 24}.draft")
    done = CliRunner().invoke(app, ["certify", str(campaigns[0]), "-o", str(run), *OPTIONS])
    assert done.exit_code == 2, done.output
    assert [p.name for p in outside.iterdir()] == ["result.json"]
    assert (outside / "result.json").read_text(encoding="utf-8") == "precious"
