"""The command as a process: entry points, exit statuses, Ctrl-C, and what a terminal shows."""

import dataclasses
import io
import json
import os
import subprocess
import sys

import pytest
from rich.console import Console
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.cli.certify import show_result
from cpcal.cli.progress import ProgressLines, watch
from cpcal.legs import PLAIN
from cpcal.solver.optimize.minimum import Bracket

# A real signal, sent when leg 2 reports its first bracket. Runners may start us with SIGINT ignored.
_SIGNALLED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from contextlib import contextmanager
import cpcal.cli.certify

@contextmanager
def stop(legs, gap, console):
    def progress(leg, bracket):
        if leg == 2:
            os.kill(os.getpid(), signal.NAME)
    yield progress

cpcal.cli.certify.watch = stop
from cpcal.__main__ import main
main()
"""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "campaign"
    cpcal.save_campaign(cpcal.simulate(seed=1, joint_error=1.0, factor=0.0), folder)
    return folder


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
    assert "Leg 1: fits to within" in outcome.stdout
    assert "Interrupted" in outcome.stdout
    assert "Traceback" not in outcome.stderr
    data = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert data["information"]["interrupted"] is True
    assert [leg["leg"] for leg in data["legs"]] == [1, 2]
    assert "REFUSED" not in CliRunner().invoke(app, ["verify", str(tmp_path)]).output
    assert [leg["certificate"] for leg in data["legs"]] == ["leg1.cert.jsonl", "leg2.cert.jsonl"]
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "campaign.json",
        "checkpoint",
        "leg1.cert.jsonl",
        "leg2.cert.jsonl",
        "ranges-leg1.cert.jsonl",
        "report.html",
        "result.json",
    ]


def terminal():
    return Console(file=io.StringIO(), force_terminal=True, width=80, markup=False, highlight=False)


def written(console):
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_progress_shows_the_bracket_of_each_leg():
    console = terminal()
    with watch([1, 3], 1e-6, console) as progress:
        assert progress is not None
        progress(1, Bracket(0.25, float("inf"), 0, 12, 0.1))
        progress(1, Bracket(0.25, 0.5, 1, 34, 0.1))
        progress(3, Bracket(0.25, 0.25, 2, 56, 0.1))
        console.print("done")
    text = written(console)
    assert "leg 1" in text
    assert "eps in [0.2500000, 0.5000000] mm" in text
    assert "2 boxes" in text


def test_without_a_terminal_a_line_is_written_every_ten_seconds():
    console, now = Console(file=io.StringIO(), width=80), iter([0.0, 4.0, 9.9, 10.0, 12.0, 21.0])
    progress = ProgressLines(console, lambda: next(now))
    for k in range(5):
        progress(2, Bracket(0.25, 0.5, k, 12, float(k)))
    assert written(console).splitlines() == [
        f"leg 2: eps in [0.2500000, 0.5000000] mm, {k} s, {k} boxes" for k in (2, 4)
    ]
    with watch([1], 1e-6, Console(file=io.StringIO())) as quiet:
        assert isinstance(quiet, ProgressLines)


def test_hostile_names_and_narrow_terminals(campaign):
    measured = cpcal.load_campaign(campaign)
    result = cpcal.certify(measured, legs=[1], eps=0.1)
    hostile = dataclasses.replace(result, campaign=dataclasses.replace(result.campaign, robot="[bold]\x1b[2J:smile:"))
    console = terminal()
    console.width = 40
    show_result(console, measured, hostile, PLAIN, verbose=True)
    show_result(console, measured, hostile, PLAIN)
    text = written(console)
    assert "[bold]\\x1b[2J:smile:" in text
    assert "…" not in text  # no figure is cut off
    assert "does not explain" in " ".join(text.split())
    assert "does not fit to within 0.1 mm" in " ".join(text.split())
