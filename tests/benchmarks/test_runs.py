"""The harness: whatever a method does, a run comes out; files of results are read and written as pages."""

import math
from io import StringIO
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks import runs
from benchmarks.__main__ import SUITES, app, contradictions
from benchmarks.methods import work
from benchmarks.problems import problem
from benchmarks.runs import (
    ANSWERED,
    FAILED,
    MINIMISE,
    SKIPPED,
    TIMEOUT,
    UNDECIDED,
    Job,
    Results,
    Run,
    Task,
    execute,
    load,
    perform,
    save,
)

EASY = "leg1-e1-n64-d1"
RUNS = (
    Run("p", MINIMISE, "lifted", ANSWERED, 0.3, 0.2, {"lo": 1.0, "hi": 1.5, "nodes": 1.0, "programs": 60.0}),
    Run("p", MINIMISE, "peer", ANSWERED, 0.5, 0.5, {"lo": -math.inf, "hi": 1.5, "nodes": 9.0}, "optimal"),
    Run("p", MINIMISE, "lifted", ANSWERED, 0.1, 0.1, {"lo": 1.0, "hi": 1.5, "nodes": 1.0, "programs": 60.0}),
    Run("p", MINIMISE, "peer", FAILED, note="licence | too small"),
    Run("p", MINIMISE, "other", SKIPPED, note="not installed"),
    Run("p", MINIMISE, "slow", TIMEOUT, 60.0, 59.0, {"nodes": 5.0}),
)


def job(method: str, limit: float = 60.0) -> Job:
    return Job(EASY, MINIMISE, f"tests.benchmarks.fakes:{method}", limit)


@pytest.mark.parametrize(
    ("method", "status", "note"),
    [
        ("Good", ANSWERED, "minimise"),
        ("Absent", SKIPPED, "is not installed"),
        ("Refusing", SKIPPED, "is not written for this"),
        ("Raising", FAILED, "ArithmeticError: a pivot is zero"),
        ("GivingUp", UNDECIDED, "no idea"),
    ],
)
def test_whatever_happens_is_a_result(method: str, status: str, note: str) -> None:
    run = work(job(method), StringIO())
    assert run.status == status
    assert note in run.note


@pytest.mark.parametrize(
    ("method", "options", "status", "note"),
    [
        ("Good", {}, ANSWERED, ""),
        ("Crashing", {}, FAILED, "segmentation fault"),
        ("Overrunning", {}, TIMEOUT, "killed"),
        ("Good", {"setup": 0.01}, FAILED, "set-up"),  # never ready: no timeout of the task
    ],
)
def test_a_process_tells_its_run_or_how_it_ended(method, options, status, note):
    run = perform(job(method, 0.2 if status == TIMEOUT else 60.0), **options)
    assert run.status == status
    assert note in run.note


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """No process begins."""
    monkeypatch.setattr(runs, "perform", lambda job: work(job, StringIO()))


@pytest.mark.usefixtures("here")
def test_who_gives_up_is_not_asked_again() -> None:
    told: list[Run] = []
    entries = [(EASY, MINIMISE, tuple(job(name).method for name in ("Good", "GivingUp")))]
    results = execute("test", entries, limit=60.0, repeat=2, tell=told.append)
    assert [run.status for run in results.runs] == [ANSWERED, UNDECIDED, ANSWERED]
    assert told == list(results.runs)


@pytest.mark.usefixtures("here")
def test_cpcal_answers_and_unknown_names_fail() -> None:
    (run,) = execute("test", [(EASY, "refute-0.5", ("lifted",))], limit=60.0, repeat=1).runs
    assert run.status == ANSWERED
    assert run.figures["nodes"] >= 1
    assert 0.0 < run.figures["eps"] < 0.5
    assert 0.0 < run.cpu < 60.0
    missing = work(Job(EASY, MINIMISE, "hc4,nosuch", 60.0), StringIO())
    assert (missing.status, missing.note) == (SKIPPED, "no contractor is registered as nosuch")
    assert work(Job("leg9", MINIMISE, "lifted", 60.0), StringIO()).status == FAILED
    assert work(Job("cable-a-linear", MINIMISE, "lifted", 60.0), StringIO()).status == SKIPPED


def test_what_contradicts_a_proof_is_called_wrong() -> None:
    proved = Run("p", "t", "lifted", ANSWERED, figures={"lo": 1.0, "hi": 1.0})
    claims = Run("p", "t", "peer", ANSWERED, figures={"lo": 1.0 + 1e-7, "hi": 2.0}, note="optimal")
    too_good = Run("p", "t", "other", ANSWERED, figures={"lo": 0.5, "hi": 1.0 - 1e-6}, note="optimal")
    kept, flagged, doubted = contradictions([proved, claims, too_good])
    assert kept == proved
    assert flagged.note == "lower bound wrong by 1e-07 (relative); optimal"
    assert doubted.note == "point wrong by 1e-06 (relative); optimal"
    assert contradictions([claims]) == [claims]  # nothing is proved of this problem


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


def results(*given: Run) -> Results:
    return Results("test", "2026-01-31", 60.0, 2, {"processor": "some"}, given or RUNS)


def test_what_is_saved_is_loaded_and_other_files_are_refused(tmp_path: Path) -> None:
    save(results(), tmp_path / "deep" / "r.json")
    assert repr(load(tmp_path / "deep" / "r.json")) == repr(results())  # NaN differs from itself, its name does not
    path = tmp_path / "r.json"
    path.write_text("{}")
    with pytest.raises(ValueError, match="not of format"):
        load(path)
    path.write_text('{"format": "cpcal-benchmark/1", "runs": [{}]}')
    with pytest.raises(ValueError, match="lacks or garbles"):
        load(path)


def test_every_suite_speaks_of_problems_and_tasks_that_there_are() -> None:
    for suite in SUITES.values():
        for name, task, methods in suite.entries:
            assert Task.named(task).value > 0.0
            assert methods
            if name.startswith("leg"):
                assert problem(name).measurements >= 64
    for name in ("leg7-e1-n64-d1", "leg1-e1-n65-d1"):
        with pytest.raises(ValueError, match=r"no problem is called|multiple of 64"):
            problem(name)


@pytest.mark.usefixtures("here")
def test_a_part_of_a_suite_is_run_written_and_made_a_page(tmp_path: Path) -> None:
    path, runner = tmp_path / "r.json", CliRunner()
    good = ["-m", "tests.benchmarks.fakes:Good", "-p", EASY, "-o", str(path), "--repeat", "1"]
    assert runner.invoke(app, ["run", "spine", "-t", "certify-1e-06", *good]).exit_code == 0
    assert [run.task for run in load(path).runs] == ["certify-1e-06"]
    save(results(), path)
    assert runner.invoke(app, ["page", str(path)]).exit_code == 0
    text = path.with_suffix(".md").read_text()
    assert "licence \\| too small" in text
    assert "`other` was not asked: not installed" in text
    said = runner.invoke(app, ["list"]).output
    assert all(word in said for word in ("quick", "spine", "minimise", "gurobi", "hc4"))
