"""The verbs, in one process: what they write, print and refuse, how much they say, and help that can be tried."""

from __future__ import annotations

import json
import shlex
from typing import Any

import pytest
import typer

import cpcal
from cpcal.cli import app
from cpcal.cli.app import VERBS
from cpcal.common.files import unwritable
from cpcal.files import campaign_sha256, load_study, save_campaign, save_study
from cpcal.simulate import simulate, simulate_study
from tests.cli.command import done, refused, run
from tests.robot.wrong_ways import WRONG_WAYS

# ------------------------------------------------------------------------------------------------------------------
# The verbs, in one process: what they write, print and refuse.


def squeezed(text):
    return " ".join(text.replace("│", " ").split())


@pytest.fixture(scope="module")
def certified(campaign, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "run"
    return folder, run("certify", campaign, "-o", folder, "--legs", "1")


def test_plugins_lists_the_contractors():
    outcome = run("plugins")
    assert outcome.exit_code == 0
    assert "lifted" in outcome.stdout
    assert "hc4" in outcome.stdout
    assert "cpcal.contractors" in outcome.stdout


COMMON = {"seed": 5, "runs": 2, "random_poses": 3, "noise": 0.5, "truncate": 2.0, "deviation": 0.5}
COMMON |= {"joint_error": 0.5, "stroke": (10.0, 130.0)}
OF_A_STUDY = {"validation_runs": 2, "images": 2, "axis_offset": 1.0, "joint_offset": 2.0, "backlash": 0.5}
OF_A_STUDY |= {"friction": 0.1, "sag": 1.0, "gain": 0.01}


def words_of(options):
    """Arguments of a function as options of the command."""
    for name, value in options.items():
        yield f"--{name.replace('_', '-')}"
        yield from value if isinstance(value, tuple) else (value,)


def test_simulate_writes_the_campaign_of_its_options(tmp_path):
    options, new = COMMON | {"factor": 2.0}, tmp_path / "new" / "c"
    assert "6 measurements" in done("simulate", "deltalab", "-o", new, "--no-extremal", *words_of(options))
    expected = cpcal.simulate(**options, extremal=False)
    assert campaign_sha256(cpcal.load_campaign(new)) == campaign_sha256(expected)


def test_a_study_of_the_given_options_is_written(tmp_path):
    options, new = COMMON | OF_A_STUDY, tmp_path / "new" / "s"
    said = done("simulate", "deltalab", "--study", "-o", new, *words_of(options))
    assert "256 rows for calibration, 12 for validation (seed 5)" in said
    expected = simulate_study(**options)
    assert load_study(new) == expected
    save_study(expected, tmp_path / "same")
    for name in ("study.toml", "calibration.csv", "validation.csv"):
        assert (tmp_path / "same" / name).read_bytes() == (new / name).read_bytes()


def test_simulate_refuses_a_folder_that_holds_something(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    refused = run("simulate", "deltalab", "-o", tmp_path)
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    assert run("simulate", "deltalab", "-o", tmp_path, "--force").exit_code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["campaign.toml", "measurements.csv", "mine.txt"]


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["puma"], ["no robot called 'puma'"]),
        (["deltalab", "--seed", "-1", "--runs", "0"], ["2 problems", "seed", "runs"]),
        (["deltalab", "--deviation", "1e5"], ["no pose found"]),
        (["deltalab", "--noise", "loud"], ["--noise"]),
        (["deltalab", "--sag", 1, "--images", 2], ["2 problems", "--images", "--sag", "add --study"]),
        (["deltalab", "--study", "--factor", 3, "--no-extremal"], ["2 problems", "--factor", "--extremal", "leave it"]),
        (["deltalab", "--study", "--sag", -1, "--random-poses", 0], ["2 problems", "option sag", "random_poses"]),
        (["deltalab", "--study", "--joint-offset", 400], ["imperfections"]),
        (["deltalab", "--study", "--gain", "much"], ["--gain"]),
    ],
)
def test_simulate_refuses_senseless_options(tmp_path, arguments, texts):
    outcome = run("simulate", *arguments, "-o", tmp_path / "c")
    assert outcome.exit_code == 2
    assert all(text in outcome.stderr for text in texts)
    assert list(tmp_path.iterdir()) == []


def test_certify_writes_and_prints_the_answer(certified):
    folder, outcome = certified
    assert outcome.exit_code == 0
    assert sorted(p.name for p in folder.iterdir()) == [
        "campaign.json",
        "leg1.cert.jsonl",
        "ranges-leg1.cert.jsonl",
        "report.html",
        "result.json",
    ]
    result = cpcal.load_result(folder)
    leg = result.legs[0]
    assert leg.bracket.verdict is cpcal.Verdict.PROVED
    text = squeezed(outcome.stdout)
    for piece in (
        "64 measurements",
        "Leg 1: fits to within ",
        "look at ",
        "next: state a tolerance",
        "for every measurement some reading in its set",
    ):
        assert piece in text
    assert str(folder / "report.html") in outcome.stdout
    assert outcome.stderr == ""  # no progress where no terminal is


def test_certify_replaces_an_earlier_run(campaign, tmp_path):
    outcome = run("certify", campaign, "-o", tmp_path, "--legs", "2", "--eps", "0.1")
    assert outcome.exit_code == 0  # "refuted" is an answer
    (tmp_path / "notes.txt").write_text("mine")
    assert run("certify", campaign, "-o", tmp_path, "--legs", "1", "--eps", "0.1").exit_code == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "leg2.cert.jsonl").exists()
    assert cpcal.load_result(tmp_path).legs[0].bracket.verdict is cpcal.Verdict.REFUTED
    assert "does not fit to within 0.1 mm" in outcome.stdout
    assert "cannot explain" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_limit_makes_a_leg_unknown(campaign, tmp_path):
    outcome = run("certify", campaign, "-o", tmp_path, "--legs", "1", "--time-limit", "1e-9")
    assert outcome.exit_code == 1
    assert "undecided" in outcome.stdout
    assert cpcal.load_result(tmp_path).legs[0].bracket.verdict is cpcal.Verdict.UNKNOWN


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["--legs", "0,9", "--delta", "nan", "--gap", "2"], ["4 problems", "leg 0", "leg 9", "delta", "gap"]),
        (["--legs", "one"], ["--legs"]),
        (["--contractors", "magic"], ["'magic'", "found: ", "hc4"]),
        (["--contractors", ","], ["at least one contractor"]),
        (["--center", "left"], ["--center"]),
        (["--arithmetic", "float32"], ["--arithmetic"]),
        (["--eps", "-1"], ["eps"]),
    ],
)
def test_certify_refuses_bad_options(campaign, tmp_path, arguments, texts):
    outcome = run("certify", campaign, "-o", tmp_path / "run", *arguments)
    assert outcome.exit_code == 2
    assert all(text in outcome.stderr for text in texts)
    assert outcome.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_certify_lists_every_problem_of_a_campaign(campaign, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    toml = (campaign / "campaign.toml").read_text(encoding="utf-8")
    lines = (campaign / "measurements.csv").read_text(encoding="utf-8").splitlines()
    (broken / "campaign.toml").write_text(toml + "\n[strange]\n", encoding="utf-8")
    lines[3] = lines[3].replace(lines[3].split(",")[2], "nan")
    lines[5] = lines[5].replace(lines[5].split(",")[2], "a\x1b[2Jb")
    (broken / "measurements.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    outcome = run("certify", broken, "-o", tmp_path / "run")
    assert outcome.exit_code == 2
    assert outcome.stderr.startswith("cpcal: 3 problems in the input:")
    assert "measurements.csv:4" in outcome.stderr
    assert "measurements.csv:6" in outcome.stderr
    assert "strange" in outcome.stderr
    assert "\x1b" not in outcome.stderr
    assert not (tmp_path / "run").exists()


def test_a_run_that_cannot_be_written_is_refused_at_once(campaign, tmp_path):
    (tmp_path / "file").write_text("")
    assert "run: cannot be written: Not a directory" in refused("certify", campaign, "-o", tmp_path / "file" / "run")


def test_an_answer_is_printed_even_if_the_disk_is_full(campaign, tmp_path, monkeypatch):
    def full(_result, folder):
        raise unwritable(folder, OSError(28, "No space left on device"))

    monkeypatch.setattr("cpcal.cli.certify.save_result", full)
    outcome = run("certify", campaign, "-o", tmp_path, "--legs", "1", "--eps", "0.1")
    assert outcome.exit_code == 2
    assert "Leg 1: does not fit to within 0.1 mm" in outcome.stdout
    assert "No space left" in outcome.stderr


@pytest.mark.parametrize(("tolerance", "status", "word"), [("50", 0, "pass"), ("0.01", 1, "fail")])
def test_a_tolerance_is_passed_or_failed(campaign, tmp_path, tolerance, status, word):
    outcome = run("certify", campaign, "-o", tmp_path, "--legs", "1", "--tolerance", tolerance)
    assert outcome.exit_code == status
    assert f"Leg 1: {word}, " in outcome.stdout
    assert f">{word}<" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert cpcal.load_result(tmp_path).options.tolerance == float(tolerance)


# ------------------------------------------------------------------------------------------------------------------
# How much a verb says: a short end, everything, nothing, a record; and help that can be tried.


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


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_has_an_example_that_the_verb_understands_and_flags_have_no_type(verb):
    text = " ".join(run(*verb.split(), "--help").stdout.split())
    example = VERBS[verb].example
    assert f"Example: cpcal {example[:30]}" in text
    assert "<bool>" not in text
    if verb in LONG:  # they say less or more, and keep a record
        assert all(option in text for option in ("--quiet", "-q", "--verbose", "-v", "--log"))
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


# ------------------------------------------------------------------------------------------------------------------
# `cpcal check`: what it prints, and its exit status.

TRUE = simulate(seed=2, random_poses=20)


def check(campaign, folder):
    save_campaign(campaign, folder)
    return run("check", folder)


def test_a_good_campaign_is_called_so_with_status_0(tmp_path):
    result = check(TRUE, tmp_path)
    assert result.exit_code == 0
    assert "84 measurements, 6 legs" in result.stdout
    assert "7 of 7" in result.stdout
    assert "Nothing looks wrong." in result.stdout


@pytest.mark.parametrize("way", ["quaternion scalar last", "one outlier"])
def test_a_finding_is_a_line_and_status_1(tmp_path, way):
    make, expected = WRONG_WAYS[way]
    result = check(make(TRUE), tmp_path)
    assert result.exit_code == 1
    (line,) = (line for line in result.stdout.splitlines() if line.startswith("! "))
    assert expected in line


def test_an_unusable_campaign_is_status_2(tmp_path):
    assert run("check", tmp_path / "none").exit_code == 2
