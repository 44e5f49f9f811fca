"""The command as a process: entry points, exit statuses, Ctrl-C, what a terminal shows, and how far a verb is."""

import dataclasses
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterable

import pytest
from rich.console import Console

import cpcal
from cpcal.cli.certify import show_result
from cpcal.cli.verbs import Line, Talk, line
from cpcal.models import PLAIN
from cpcal.solver.optimize.bound import Bracket
from cpcal.solver.search.search import Event
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
        "ranges-leg2.cert.jsonl",
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


def told_at(times: Iterable[float], every: float = 10.0) -> tuple[Line, list[str]]:
    """A line, and what it shows, by a clock that says these times."""
    told: list[str] = []
    clock = iter(times)
    return Line(told.append, every, lambda: float(next(clock))), told


def test_the_bracket_of_the_leg_at_work_is_told_every_ten_seconds() -> None:
    shown, told = told_at([0.0, 4.0, 9.9, 10.0, 12.0, 21.0])
    for k in range(5):
        shown.leg(2, Bracket(0.25, 0.5, k, 12, float(k)))
    assert told == [f"leg 2: eps in [0.2500000, 0.5000000] mm, {k} s, {k} boxes" for k in (2, 4)]


def test_a_terminal_shows_one_line_that_goes() -> None:
    file = io.StringIO()
    with line(Console(file=file, force_terminal=True, width=80)) as shown:
        shown._show("leg 1: eps >= 0.25 mm")
    assert "\x1b[?25h" in file.getvalue()  # the cursor is back
    assert file.getvalue().endswith("\x1b[2K")
    lines = io.StringIO()
    with line(Console(file=lines, width=80)) as shown:
        shown._show("leg 1: eps >= 0.25 mm")
    assert lines.getvalue() == "leg 1: eps >= 0.25 mm\n"


def test_what_is_counted_has_a_pace_that_leaves_out_what_was_done_before() -> None:
    shown, told = told_at([0.0, 1.0, 20.0])
    shown.count("images", 100, 200)
    shown.count("images", 140, 200)
    assert told == ["images: 140 of 200, 2.00 a second, 30 s left"]


def test_a_search_tells_its_rate_and_the_boxes_that_wait() -> None:
    shown, told = told_at(range(100_000), every=50.0)
    net = cpcal.Network()
    x = net.variable("x", 2, (-2, 2))
    net.add((x[0] * x[0] + x[1] * x[1]).within((1.0, 2.0)))
    events: list[Event] = []

    def both(event: Event) -> None:
        events.append(event)
        shown.searched(event)

    net.solve(width=0.3, progress=both)
    assert told
    assert all("boxes, " in text and "a second" in text and "pending" in text for text in told)
    assert events[-1].pending == 0
    assert events[0].pending == len(events[0].children)
