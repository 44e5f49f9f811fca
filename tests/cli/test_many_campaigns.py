"""Many campaigns as one run: each as if it were alone, the worst first, one that is bad stops no other."""

import csv
import json
import sys

import pytest

import cpcal
from cpcal.checker import check_run
from cpcal.files.run_folder import locked
from cpcal.solver.execution.stopping import Reason, also_asked_by
from tests.cli.command import run

OPTIONS = ["--legs", "1,2", "--delta", "0.5", "--gap", "1e-2"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("many")
    for seed in (1, 2, 3):
        small = cpcal.simulate(seed=seed, joint_error=1.0 * seed, factor=0.0, extremal=False, random_poses=12)
        cpcal.save_campaign(small, folder / f"day{seed}")
    (folder / "empty").mkdir()
    return folder


def certified(folders, runs, *names, more=()):
    return run("certify", *(folders / name for name in names), "-o", runs, *OPTIONS, *more)


def rows(runs):
    with (runs / "summary.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def done(folders, tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    said = certified(folders, runs, "day1", "day2", "day3", more=["--log", str(runs / "log.jsonl")])
    assert said.exit_code == 0, said.output
    return runs, said.output


def test_each_campaign_is_a_run_that_is_proved(done):
    runs, _ = done
    for name in ("day1", "day2", "day3"):
        assert {path.name for path in (runs / name).iterdir()} >= {"result.json", "campaign.json", "report.html"}
        assert all(leg.refused is None and leg.accepted is not None for leg in check_run(runs / name))


def test_a_campaign_has_the_certificates_that_it_has_alone(folders, done, tmp_path):
    assert certified(folders, tmp_path / "alone", "day2").exit_code == 0
    for path in (tmp_path / "alone").glob("*.cert.jsonl"):
        assert path.read_bytes() == (done[0] / "day2" / path.name).read_bytes()


def test_the_summary_is_sorted_by_the_worst_leg(done):
    runs, said = done
    worst = {}
    for row in rows(runs):
        worst.setdefault(row["run"], float(row["eps_lo_mm"]))
    assert len(worst) == 3
    assert list(worst.values()) == sorted(worst.values(), reverse=True)
    for row in rows(runs):
        leg = next(leg for leg in cpcal.load_result(runs / row["run"]).legs if leg.leg == int(row["leg"]))
        assert (float(row["eps_lo_mm"]), float(row["eps_hi_mm"])) == (leg.bracket.lo, leg.bracket.hi)
    page = (runs / "summary.html").read_text(encoding="utf-8")
    assert [page.index(f">{name}</a>") for name in worst] == sorted(page.index(f">{name}</a>") for name in worst)
    assert said.index(next(iter(worst))) < said.index(list(worst)[-1])
    assert page.count("Simulated: ") == 3
    assert run("verify", runs).exit_code == 0
    words = {row["run"]: row["verdict"] for row in reversed(rows(runs))}  # of the worst leg, which stands first
    for name in worst:
        assert f"  {name}: {words[name]}, leg " in said or f"  {name}: FAIL, leg " in said


def test_the_log_tells_of_each_with_the_rate_and_what_is_left(done):
    lines = [json.loads(line) for line in (done[0] / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    told = [line for line in lines if line["event"] == "campaign"]
    assert sorted(line["campaign"] for line in told) == ["day1", "day2", "day3"]
    assert [line["done"] for line in told] == [1, 2, 3]
    assert told[-1]["left"] == 0.0


def test_one_that_cannot_be_used_is_named_and_stops_no_other(folders, tmp_path):
    said = certified(folders, tmp_path, "day1", "empty")
    assert said.exit_code == 2
    assert "empty" in said.output
    assert [row["run"] for row in rows(tmp_path)] == ["day1", "day1"]
    assert "empty: " in (tmp_path / "summary.html").read_text(encoding="utf-8")


def test_a_stopped_run_goes_on_with_what_is_missing(folders, tmp_path):
    begun = []

    def source():
        done = (tmp_path / "day1" / "result.json").exists()
        begun.append(done)
        return Reason.INTERRUPTED if done else None

    with also_asked_by(source):
        said = certified(folders, tmp_path, "day1", "day2", "day3")
    assert said.exit_code == 130, said.output
    assert "2 not begun" in said.output
    before = (tmp_path / "day1" / "result.json").stat().st_mtime_ns
    assert certified(folders, tmp_path, "day1", "day2", "day3", more=["--resume"]).exit_code == 0
    assert (tmp_path / "day1" / "result.json").stat().st_mtime_ns == before
    assert len(rows(tmp_path)) == 6


def test_a_campaign_that_was_at_work_goes_on_from_its_legs(folders, done, tmp_path, monkeypatch):
    source = lambda: Reason.INTERRUPTED if any(tmp_path.glob("day1/checkpoint/*.answer")) else None  # noqa: E731
    with also_asked_by(source):
        assert certified(folders, tmp_path, "day1", "day2").exit_code == 130
    assert [leg.leg for leg in cpcal.load_result(tmp_path / "day1").legs] == [1]
    asked, module = [], sys.modules["cpcal.questions.ask"]
    ask = module.certify_leg

    def asking(question, leg):
        asked.append(leg)
        return ask(question, leg)

    monkeypatch.setattr(module, "certify_leg", asking)
    assert certified(folders, tmp_path, "day1", "day2", more=["--resume"]).exit_code == 0
    assert asked == [2, 1, 2]
    assert not any(tmp_path.glob("*/checkpoint"))
    for name in ("day1", "day2"):
        for path in (tmp_path / name).glob("*.cert.jsonl"):
            assert path.read_bytes() == (done[0] / name / path.name).read_bytes()


def test_two_of_one_name_are_refused(folders, tmp_path):
    said = certified(folders, tmp_path, "day1", "../" + folders.name + "/day1")
    assert said.exit_code == 2
    assert "is the name of two campaigns" in said.output


def test_a_folder_that_another_run_writes_into_is_left_alone(folders, tmp_path):
    with locked(tmp_path / "day1"):
        said = certified(folders, tmp_path, "day1", "day2")
    assert said.exit_code == 2
    assert "is being written by another run of cpcal" in said.output
    assert not (tmp_path / "day1" / "checkpoint").exists()
    assert {row["run"] for row in rows(tmp_path)} == {"day2"}
    with locked(tmp_path):
        said = certified(folders, tmp_path, "day1", "day2")
    assert said.exit_code == 2
    assert "is being written by another run of cpcal" in said.output
