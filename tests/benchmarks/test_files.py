"""Files of results: round trip, comparison, pages."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

from benchmarks.changes import compared, expectation, report
from benchmarks.commands import app, selected
from benchmarks.machine import machine
from benchmarks.records import ANSWERED, FAILED, SKIPPED, TIMEOUT, Results, Run, load, save

RUNS = (
    Run("p", "minimise-1e-06", "lifted", ANSWERED, 0.3, 0.2, {"lo": 1.0, "hi": 1.5, "nodes": 1.0, "programs": 60.0}),
    Run("p", "minimise-1e-06", "peer", ANSWERED, 0.5, 0.5, {"lo": -math.inf, "hi": 1.5, "nodes": 9.0}, "optimal"),
    Run("p", "minimise-1e-06", "lifted", ANSWERED, 0.1, 0.1, {"lo": 1.0, "hi": 1.5, "nodes": 1.0, "programs": 60.0}),
    Run("p", "minimise-1e-06", "peer", FAILED, note="licence | too small"),
    Run("p", "minimise-1e-06", "other", SKIPPED, note="not installed"),
    Run("p", "minimise-1e-06", "slow", TIMEOUT, 60.0, 59.0, {"nodes": 5.0}),
)


def results(*runs: Run) -> Results:
    return Results("test", "2026-01-31", 60.0, 2, {"processor": "some"}, runs or RUNS)


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    save(results(), tmp_path / "deep" / "r.json")
    back = load(tmp_path / "deep" / "r.json")
    assert repr(back) == repr(results())  # NaN differs from itself, its name does not


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    path.write_text("{}")
    with pytest.raises(ValueError, match="not of format"):
        load(path)
    path.write_text('{"format": "cpcal-benchmark/1", "runs": [{}]}')
    with pytest.raises(ValueError, match="lacks or garbles"):
        load(path)


def test_medians_and_failures() -> None:
    medians = results().medians()
    lifted = medians["p", "minimise-1e-06", "lifted"]
    assert (lifted.seconds, lifted.cpu) == pytest.approx((0.2, 0.15))
    assert medians["p", "minimise-1e-06", "peer"].status == FAILED


def test_a_comparison_flags_nodes_and_statuses_of_what_both_hold() -> None:
    moved = replace(RUNS[0], cpu=0.4, figures={**RUNS[0].figures, "nodes": 3})
    faster = replace(RUNS[-1], status=ANSWERED)
    found = compared(results(RUNS[0], *RUNS[4:]), results(moved, faster, RUNS[4]))
    assert [d.changes for d in found.pairs] == [["nodes 1 became 3"], ["timeout became answered"]]
    assert found.pairs[0].ratio == pytest.approx(2.0)
    assert not found.passed
    assert "2 compared, 2 changed, 0 missing, CPU time 2.00 times the old" in report(found)


def test_a_result_that_is_missing_or_was_not_asked_fails_the_comparison() -> None:
    old, lacking = results(RUNS[0], RUNS[1]), results(RUNS[0])
    skipped = results(RUNS[0], replace(RUNS[1], status=SKIPPED))
    for new in (lacking, skipped):
        found = compared(old, new)
        assert found.missing == (RUNS[1].key,)
        assert not found.passed
        assert "1 missing" in report(found)
    assert compared(lacking, old).passed  # more results are no failure


def test_programs_may_change_from_version_to_version_and_nodes_may_not() -> None:
    old = results(RUNS[0])
    more = replace(RUNS[0], figures={**RUNS[0].figures, "programs": 61.0})
    found = compared(old, results(more))
    assert found.passed
    assert "programs 60 became 61" in report(found)
    nodes = replace(RUNS[0], figures={**RUNS[0].figures, "nodes": 2.0})
    assert not compared(old, results(nodes)).passed


def test_a_comparison_says_where_each_side_was_made() -> None:
    sides = [replace(results(RUNS[0]), machine={"processor": name, "numpy": name}) for name in ("this", "that")]
    text = report(compared(*sides))
    assert "old: 2026-01-31, this, numpy this\nnew: 2026-01-31, that, numpy that\n" in text


def test_an_expectation_holds_nodes_and_no_times(tmp_path: Path) -> None:
    save(expectation(results()), tmp_path / "e.json")
    kept = load(tmp_path / "e.json")
    assert [run.key[2] for run in kept.runs] == ["lifted"]
    assert math.isnan(kept.runs[0].cpu)
    assert not compared(kept, results()).pairs[0].changes
    assert kept.machine == results().machine


def test_commands_make_pages_and_compare(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    save(results(), path)
    runner = CliRunner()
    assert runner.invoke(app, ["page", str(path)]).exit_code == 0
    text = path.with_suffix(".md").read_text()
    assert "licence \\| too small" in text
    assert "`other` was not asked: not installed" in text
    assert ElementTree.parse(path.with_suffix(".svg")).getroot().tag.endswith("svg")
    assert runner.invoke(app, ["compare", str(path), str(path)]).exit_code == 0
    other = tmp_path / "s.json"
    save(results(replace(RUNS[0], figures={"nodes": 2, "programs": 60})), other)
    assert runner.invoke(app, ["compare", str(path), str(other)]).exit_code == 1


def test_the_list_names_what_there_is() -> None:
    said = CliRunner().invoke(app, ["list"]).output
    for word in ("quick", "ablation", "minimise", "gurobi", "hc4"):
        assert word in said


def test_a_part_of_a_suite() -> None:
    entries = (("p", "a-1", ("x", "y")), ("q", "a-1", ("x",)), ("q", "b-1", ("x",)))
    assert selected(entries, None, ["q"], None) == [("q", "a-1", ("x",)), ("q", "b-1", ("x",))]
    assert selected(entries, ["z"], ["p"], None) == [("p", "a-1", ("z",))]
    assert selected(entries, ["z"], ["r"], ["b-1"]) == [("r", "b-1", ("z",))]


def test_the_machine_is_described_without_names_of_hosts_and_folders() -> None:
    facts = machine()
    assert {"processor", "python", "cpcal", "numpy"} <= facts.keys()
    assert not any("/" in value for value in facts.values())


def test_a_run_that_was_stopped_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    good = ["-m", "tests.benchmarks.fakes:Good", "-p", "leg1-e1-n64-d1", "-o", str(path), "--repeat", "1"]
    runner = CliRunner()
    assert runner.invoke(app, ["run", "spine", "-t", "certify-1e-06", *good]).exit_code == 0
    first = load(path).runs
    assert len(first) == 1
    asked = runner.invoke(app, ["run", "spine", "--resume", *good])
    assert asked.exit_code == 0
    assert load(path).runs[:1] == first
    assert [run.task for run in load(path).runs] == ["certify-1e-06", "minimise-1e-06"]
    assert runner.invoke(app, ["run", "nosuch"]).exit_code == 2
