"""The harness: whatever a method does, a run comes out."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest

from benchmarks import isolation
from benchmarks.isolation import Job
from benchmarks.problems import problem
from benchmarks.records import ANSWERED, FAILED, SKIPPED, TIMEOUT, UNDECIDED, Run
from benchmarks.runner import execute
from benchmarks.suites import MINIMISE, SUITES
from benchmarks.tables import contradictions
from benchmarks.tasks import Task

EASY = "leg1-e1-n64-d1"


def perform(method: str, limit: float = 60.0, **options: float) -> Run:
    return isolation.perform(Job(EASY, MINIMISE, f"tests.benchmarks.fakes:{method}", limit), **options)


@pytest.mark.parametrize(
    ("method", "status", "note"),
    [
        ("Good", ANSWERED, "minimise-1e-06"),
        ("Absent", SKIPPED, "is not installed"),
        ("Refusing", SKIPPED, "is not written for this"),
        ("Raising", FAILED, "ArithmeticError: a pivot is zero"),
        ("Crashing", FAILED, "segmentation fault"),
        ("GivingUp", UNDECIDED, "no idea"),
    ],
)
def test_whatever_happens_is_a_result(method: str, status: str, note: str) -> None:
    run = perform(method)
    assert run.status == status
    assert note in run.note


def test_a_limit_holds_for_who_ignores_it() -> None:
    began = time.monotonic()
    run = perform("Overrunning", limit=0.2)
    assert run.status == TIMEOUT
    assert run.seconds == 0.2
    assert time.monotonic() - began < 100.0


def test_a_process_that_is_never_ready_is_no_timeout_of_the_task() -> None:
    run = perform("Good", setup=0.01)
    assert run.status == FAILED
    assert "set-up" in run.note


def test_a_contractor_that_is_not_registered_is_skipped_and_the_reason_given() -> None:
    run = isolation.perform(Job(EASY, MINIMISE, "hc4,nosuch", 60.0))
    assert run.status == SKIPPED
    assert "nosuch" in run.note
    assert "hc4" not in run.note


def test_cpcal_answers_and_unknown_names_fail() -> None:
    entries = [(EASY, "refute-0.5", ("lifted", "tests.benchmarks.fakes:GivingUp"))]
    told: list[Run] = []
    results = execute("test", entries, limit=60.0, repeat=2, tell=told.append)
    assert [run.status for run in results.runs] == [ANSWERED, UNDECIDED, ANSWERED]  # who gives up is not asked again
    assert told == list(results.runs)
    first = results.runs[0]
    assert first.figures["nodes"] >= 1
    assert 0.0 < first.figures["eps"] < 0.5
    assert 0.0 < first.cpu < 60.0
    assert isolation.perform(Job("leg9", MINIMISE, "lifted", 60.0)).status == FAILED
    assert isolation.perform(Job("cable-a-linear", MINIMISE, "lifted", 60.0)).status == SKIPPED


def test_what_contradicts_a_proof_is_called_wrong() -> None:
    proved = Run("p", "t", "lifted", ANSWERED, figures={"lo": 1.0, "hi": 1.0})
    claims = Run("p", "t", "peer", ANSWERED, figures={"lo": 1.0 + 1e-7, "hi": 2.0}, note="optimal")
    too_good = Run("p", "t", "other", ANSWERED, figures={"lo": 0.5, "hi": 1.0 - 1e-6}, note="optimal")
    kept, flagged, doubted = contradictions([proved, claims, too_good])
    assert kept == proved
    assert flagged.note == "lower bound wrong by 1e-07 (relative); optimal"
    assert doubted.note == "point wrong by 1e-06 (relative); optimal"
    assert contradictions([claims]) == [claims]  # nothing is proved of this problem
    zero = Run("p", "t", "lifted", ANSWERED, figures={"lo": 0.0, "hi": 0.0})
    assert contradictions([zero, Run("p", "t", "peer", ANSWERED)])[0] == zero


def test_every_suite_speaks_of_problems_and_tasks_that_there_are(tmp_path_factory: pytest.TempPathFactory) -> None:
    for suite in SUITES.values():
        for name, task, methods in suite.entries:
            assert Task.named(task).name == task
            assert methods
            if name.startswith("leg"):
                assert problem(name).measurements >= 64


def test_names_that_mean_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="no problem is called"):
        problem("leg7-e1-n64-d1")
    with pytest.raises(ValueError, match="multiple of 64"):
        problem("leg1-e1-n65-d1")
    with pytest.raises(ValueError, match="no task is called"):
        Task.named("guess-1")


def test_the_tolerance_asked_about_is_on_the_safe_side_of_the_bracket() -> None:
    assert Task.named("refute-0.9").eps(1.0, 2.0) == 0.9
    assert Task.named("hull-1.1").eps(1.0, 2.0) == 2.2
    assert math.isclose(Task.named("sweep-10").eps(1.0, 2.0), 2.2)


def test_a_family_of_problems_is_found_by_its_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    metadata = tmp_path / "shapes-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: shapes\nVersion: 1.0\n", encoding="utf-8")
    points = "[cpcal.benchmark_problems]\ncircle = shapes:circle\n"
    (metadata / "entry_points.txt").write_text(points, encoding="utf-8")
    (tmp_path / "shapes.py").write_text("def circle(arguments, data): return (arguments, data)\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    assert problem("circle:2-x", tmp_path) == ("2-x", tmp_path)
    with pytest.raises(ValueError, match=r"no problem is called 'square'; .*circle:\.\.\."):
        problem("square")
