"""The command as a process: entry points, exit statuses, Ctrl-C, and what a terminal shows."""

import dataclasses
import io
import json
import os
import subprocess
import sys

import pytest
from rich.console import Console

import cpcal
from cpcal.cli.certify import show_result
from cpcal.cli.verbs import Talk
from cpcal.models import PLAIN
from tests.cli.command import run

# A real signal, sent when leg 2 reports its first bracket. Runners may start us with SIGINT ignored.
_SIGNALLED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import cpcal.cli.verbs

def stop(line, leg, bracket):
    if leg == 2:
        os.kill(os.getpid(), signal.NAME)

cpcal.cli.verbs.Line.leg = stop
from cpcal.__main__ import main
main()
"""


def process(*arguments):
    environment = os.environ | {"COLUMNS": "100"}
    return subprocess.run(
        [sys.executable, *map(str, arguments)], capture_output=True, text=True, timeout=60, env=environment
    )


def test_module_entry_point_and_status_of_bad_input(tmp_path):
    outcome = process("-m", "cpcal", "certify", tmp_path / "absent", "-o", tmp_path / "run")
    assert outcome.returncode == 2
    assert outcome.stdout == ""
    assert outcome.stderr.startswith("cpcal: 1 problem in the input:")
    assert "Traceback" not in outcome.stderr


@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_leaves_what_is_proved(campaign, tmp_path, name, status):
    code = _SIGNALLED.replace("NAME", name)
    outcome = process("-c", code, "certify", campaign, "-o", tmp_path, "--legs", "1,2,3")
    assert outcome.returncode == status, outcome.stderr
    assert "Leg 1: Fails below" in outcome.stdout
    assert "Interrupted" in outcome.stdout
    assert "Traceback" not in outcome.stderr
    data = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert data["information"]["interrupted"] is True
    assert [leg["leg"] for leg in data["legs"]] == [1, 2]
    assert "REFUSED" not in run("verify", tmp_path).output
    assert [leg["bracket"]["certificate"] for leg in data["legs"]] == ["leg1.cert.jsonl", "leg2.cert.jsonl"]
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "campaign.json",
        "checkpoint",
        *(f"leg{leg}.{of}cert.jsonl" for leg in (1, 2) for of in ("", "passes.", "recommended.")),
        "ranges-leg1.cert.jsonl",
        "report.html",
        "result.json",
    ]


def test_hostile_names_and_narrow_terminals(campaign, monkeypatch):
    measured = cpcal.load_campaign(campaign)
    result = cpcal.certify(measured, legs=[1], eps=0.1)
    hostile = dataclasses.replace(result, campaign=dataclasses.replace(result.campaign, robot="[bold]\x1b[2J:smile:"))
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=40, markup=False, highlight=False)
    monkeypatch.setattr(Talk, "console", lambda *_, **__: console)
    for verbose in (True, False):
        show_result(Talk(verbose=verbose), measured, hostile, PLAIN)
    text = file.getvalue()
    assert "\x1b[2J" not in text
    assert "…" not in text  # no figure is cut off
    assert "does not fit" in " ".join(text.split())
