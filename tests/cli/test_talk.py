"""How much a verb says: a short end, everything, nothing, a record; and help that can be tried."""

import json
import shlex
from typing import Any

import pytest
import typer

from cpcal.cli import app
from cpcal.cli.app import VERBS
from tests.cli.command import run


def test_a_run_of_six_legs_ends_with_at_most_twelve_lines_of_eighty_characters(campaign, tmp_path):
    outcome = run("certify", campaign, "-o", tmp_path / "r", "--tolerance", "0.55", "--log", tmp_path / "log.jsonl")
    assert outcome.exit_code == 1
    lines = outcome.stdout.splitlines()
    assert len(lines) <= 12
    assert [line[:6] for line in lines if line.startswith("Leg")] == [f"Leg {k}:" for k in range(1, 7)]
    assert all(len(line) <= 100 for line in lines if not line.startswith("Report"))
    assert "tolerance 0.55 mm: FAIL" in lines[0]
    records = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    assert {"began", "certify", "bracket", "kept", "leg", "written", "ended"} == {record["event"] for record in records}
    assert (records[0]["command"], records[-1]["status"]) == ("certify", 1)
    assert [record["leg"] for record in records if record["event"] == "leg"] == [1, 2, 3, 4, 5, 6]
    assert all(record["time"].endswith("+00:00") and record["level"] == "info" for record in records)


def test_verbose_shows_tables_with_their_frame_and_quiet_shows_nothing(campaign, tmp_path):
    loud = run("certify", campaign, "-o", tmp_path / "v", "--legs", "1", "-v").stdout
    for piece in (
        "eps_lo [mm]",
        "Parameters [mm]",
        "b_z",
        "in the base frame of the campaign's poses",
        "there exists a reading",
    ):
        assert piece in " ".join(loud.split())
    silent = run("certify", campaign, "-o", tmp_path / "q", "--legs", "1", "-q")
    assert (silent.exit_code, silent.stdout, silent.stderr) == (0, "", "")
    assert (tmp_path / "q" / "report.html").exists()


def test_a_log_holds_what_went_wrong(campaign, tmp_path):
    log = tmp_path / "log.jsonl"
    outcome = run("certify", campaign, "-o", tmp_path / "r", "--eps", "-1", "--log", log)
    assert outcome.exit_code == 2
    last = json.loads(log.read_text(encoding="utf-8").splitlines()[-1])
    assert (last["event"], last["kind"]) == ("failed", "InputError")
    assert run("certify", campaign, "-o", tmp_path / "r", "--log", tmp_path).exit_code == 2  # a folder


LONG = ("certify", "accuracy", "solve", "image detect", "image sets", "calibrate", "demo", "verify", "handeye certify")


@pytest.mark.parametrize("verb", LONG)
def test_every_verb_that_can_take_long_says_less_or_more_and_keeps_a_record(verb):
    text = run(*verb.split(), "--help").stdout
    assert all(option in text for option in ("--quiet", "-q", "--verbose", "-v", "--log"))


def test_a_quiet_verb_prints_nothing_and_its_record_says_how_it_ended(campaign, tmp_path):
    folder, log = tmp_path / "r", tmp_path / "log.jsonl"
    asked = (
        ("certify", campaign, "-o", folder, "--legs", "1", "--support", "none"),
        ("verify", folder),
        ("verify", folder, "--campaign", folder),  # no folder of a campaign: unusable
    )
    ended = []
    for arguments in asked:
        outcome = run(*arguments, "-q", "--log", log)
        assert outcome.stdout == ""
        ended.append(outcome.exit_code)
    records = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    assert [one["command"] for one in records if one["event"] == "began"] == ["certify", "verify", "verify"]
    assert [one.get("status", one.get("kind")) for one in records if one["event"] in ("ended", "failed")] == [
        0,
        0,
        "InputError",
    ]
    assert ended == [0, 0, 2]


def test_the_help_of_the_command_shows_no_type_of_a_flag():
    text = run("--help").stdout
    assert "--version" in text
    assert "<bool>" not in text


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_has_an_example_that_the_verb_understands_and_flags_have_no_type(verb):
    text = " ".join(run(*verb.split(), "--help").stdout.split())
    example = VERBS[verb].example
    assert f"Example: cpcal {example[:30]}" in text
    assert "<bool>" not in text
    command: Any = typer.main.get_command(app)
    arguments = shlex.split(example)
    context = None
    for name in verb.split():
        context = command.make_context(name, [name], parent=context, resilient_parsing=True)
        command, arguments = command.get_command(context, name), arguments[1:]
    command.make_context(verb, arguments, parent=context)


def test_several_models_end_with_a_line_a_leg(campaign, tmp_path):
    outcome = run("certify", campaign, "-o", tmp_path, "--model", "plain,gain", "--legs", "1", "--tolerance", "0.01")
    assert outcome.exit_code == 1
    lines = outcome.stdout.splitlines()
    assert len(lines) <= 12
    assert any(line.startswith("leg 1: plain ") and "fail" in line and "no model passes" in line for line in lines)
