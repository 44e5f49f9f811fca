"""The verbs, in one process: what they write, print and refuse, how much they say, and help that can be tried."""

import shlex
from typing import Any

import pytest
import typer

import cpcal
from benchmarks.wrong_ways import WRONG_WAYS
from cpcal.cli import app
from cpcal.cli.app import VERBS
from cpcal.common.files import unwritable
from cpcal.files import campaign_sha256, save_campaign
from cpcal.simulate import simulate
from tests.cli.command import done, refused, run

# `cpcal simulate`, `plugins` and `check`.

COMMON = {"seed": 5, "runs": 2, "random_poses": 3, "noise": 0.5, "deviation": 0.5, "joint_error": 0.5}
OF_A_STUDY = {"validation_runs": 2, "images": 2, "axis_offset": 1.0, "backlash": 0.5}
OF_A_STUDY |= {"sag": 1.0, "gain": 0.01}


def words_of(options):
    """Arguments of a function as options of the command."""
    for name, value in options.items():
        yield from (f"--{name.replace('_', '-')}", value)


def test_simulate_writes_the_campaign_of_its_options(tmp_path):
    options, new = COMMON | {"factor": 2.0}, tmp_path / "new" / "c"
    assert "6 measurements" in done("simulate", "deltalab", "-o", new, "--no-extremal", *words_of(options))
    expected = cpcal.simulate(**options, extremal=False)
    assert campaign_sha256(cpcal.load_campaign(new)) == campaign_sha256(expected)


@pytest.mark.parametrize("verb", [("simulate", "deltalab"), ("demo",)])
def test_a_folder_that_holds_something_is_refused(tmp_path, verb):
    (tmp_path / "mine.txt").write_text("precious")
    assert "--force" in refused(*verb, "-o", tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    if verb != ("demo",):
        done(*verb, "-o", tmp_path, "--force")
        assert sorted(p.name for p in tmp_path.iterdir()) == ["campaign.toml", "measurements.csv", "mine.txt"]


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["puma"], ["no robot called 'puma'"]),
        (["deltalab", "--seed", "-1", "--runs", "0"], ["2 problems", "seed", "runs"]),
        (["deltalab", "--deviation", "1e5"], ["no pose found"]),
        (["deltalab", "--sag", 1, "--images", 2], ["2 problems", "--images", "--sag", "add --study"]),
        (["deltalab", "--study", "--factor", 3, "--no-extremal"], ["2 problems", "--factor", "--extremal", "leave it"]),
        (["deltalab", "--study", "--gain", "much"], ["--gain"]),
    ],
)
def test_simulate_refuses_senseless_options(tmp_path, arguments, texts):
    said = refused("simulate", *arguments, "-o", tmp_path / "c")
    assert all(text in said for text in texts)
    assert list(tmp_path.iterdir()) == []


TRUE = simulate(seed=2, random_poses=20)


@pytest.mark.parametrize("way", ["none", "quaternion scalar last", "one outlier"])
def test_a_campaign_is_called_good_or_each_finding_is_a_line_and_status_1(tmp_path, way):
    make, expected = WRONG_WAYS.get(way, (lambda campaign: campaign, None))
    save_campaign(make(TRUE), tmp_path)
    said = done("check", tmp_path, status=0 if expected is None else 1)
    findings = [line for line in said.splitlines() if line.startswith("! ")]
    if expected is None:
        assert findings == []
        assert all(text in said for text in ("84 measurements, 6 legs", "Nothing looks wrong."))
    else:
        (line,) = findings
        assert expected in line
    refused("check", tmp_path / "none")


# `cpcal certify`.


def test_certify_writes_and_prints_the_answer_and_replaces_an_earlier_run(campaign, tmp_path):
    said = done("certify", campaign, "-o", tmp_path, "--legs", "2", "--eps", "0.1")  # "refuted" is an answer
    assert "No parameters fit to within 0.1 mm" in said
    assert "No parameters fit" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert cpcal.load_result(tmp_path).legs[0].bracket.verdict is cpcal.Verdict.REFUTED
    (tmp_path / "notes.txt").write_text("mine")
    outcome = run("certify", campaign, "-o", tmp_path, "--legs", "1")
    assert (outcome.exit_code, outcome.stderr) == (0, "")  # no progress where no terminal is
    certificates = {f"{name}.cert.jsonl" for name in ("leg1", "leg1.passes", "leg1.recommended", "ranges-leg1")}
    names = {"campaign.json", "notes.txt", "report.html", "result.json", *certificates}
    assert {p.name for p in tmp_path.iterdir()} == names
    assert cpcal.load_result(tmp_path).legs[0].bracket.verdict is cpcal.Verdict.PROVED
    pieces = ("Simulated: DeltaLab Table of Stewart: 64 measurements", "Leg 1: Fails below ")
    text = " ".join(outcome.stdout.split())
    for piece in (*pieces, "no parameters do. Passes: ", str(tmp_path / "report.html")):
        assert piece in text


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["--legs", "0,9", "--delta", "nan", "--gap", "2"], ["4 problems", "leg 0", "leg 9", "delta", "gap"]),
        (["--legs", "one"], ["--legs"]),
        (["--contractors", "magic"], ["'magic'", "found: ", "hc4"]),
        (["--contractors", ","], ["at least one contractor"]),
        (["--center", "left"], ["--center"]),
        (["--eps", "-1"], ["eps"]),
    ],
)
def test_certify_refuses_bad_options(campaign, tmp_path, arguments, texts):
    said = refused("certify", campaign, "-o", tmp_path / "run", *arguments)
    assert all(text in said for text in texts)
    assert list(tmp_path.iterdir()) == []


def test_certify_lists_every_problem_of_a_campaign(campaign, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    toml = (campaign / "campaign.toml").read_text(encoding="utf-8")
    lines = (campaign / "measurements.csv").read_text(encoding="utf-8").splitlines()
    (broken / "campaign.toml").write_text(toml + "\n[strange]\n", encoding="utf-8")
    for k, cell in ((3, "nan"), (5, "a\x1b[2Jb")):
        lines[k] = lines[k].replace(lines[k].split(",")[2], cell)
    (broken / "measurements.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    said = refused("certify", broken, "-o", tmp_path / "run")
    assert said.startswith("cpcal: 3 problems in the input:")
    assert all(text in said for text in ("measurements.csv:4", "measurements.csv:6", "strange"))
    assert "\x1b" not in said
    assert not (tmp_path / "run").exists()


def test_a_run_that_cannot_be_written_is_refused_at_once_or_its_answer_is_printed(campaign, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    assert "run: cannot be written: Not a directory" in refused("certify", campaign, "-o", tmp_path / "file" / "run")

    def full(_result, folder):
        raise unwritable(folder, OSError(28, "No space left on device"))

    monkeypatch.setattr("cpcal.cli.certify.save_result", full)
    outcome = run("certify", campaign, "-o", tmp_path / "run", "--legs", "1", "--eps", "0.1")
    assert outcome.exit_code == 2
    assert "Leg 1: does not fit" in outcome.stdout
    assert "No space left" in outcome.stderr


# How much a verb says: a short end, everything, nothing; and help that can be tried.


def test_a_run_of_six_legs_ends_with_a_line_for_each_that_passes_and_two_for_each_other(campaign, tmp_path):
    outcome = run("certify", campaign, "-o", tmp_path / "r", "--tolerance", "0.55")
    assert outcome.exit_code == 1, outcome.output
    lines = outcome.stdout.splitlines()  # a slow machine tells its progress on stderr
    legs = [line for line in lines if line.startswith("Leg")]
    assert [line[:6] for line in legs] == [f"Leg {k}:" for k in range(1, 7)]
    assert len(lines) == 3 + 2 * 6 - sum(": pass" in line for line in legs)
    assert all(len(line) <= 110 for line in lines[1:-2])
    assert "tolerance 0.55 mm: FAIL" in lines[0]
    assert ">fail<" in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")


def test_a_quiet_verb_prints_nothing_but_errors(campaign, tmp_path):
    folder = tmp_path / "r"
    asked = (
        (("certify", campaign, "-o", folder, "--legs", "1", "--support", "none"), 0),
        (("verify", folder), 0),
        (("verify", folder, "--campaign", folder), 2),  # no folder of a campaign: unusable
        (("certify", campaign, "-o", tmp_path / "other", "--eps", "-1"), 2),
    )
    for arguments, status in asked:
        outcome = run(*arguments, "-q")
        assert (outcome.stdout, outcome.exit_code) == ("", status)
        assert bool(outcome.stderr) == bool(status)
    assert (folder / "report.html").exists()


LONG = ("certify", "accuracy", "solve", "image detect", "image sets", "calibrate", "demo", "verify", "handeye certify")


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_has_an_example_that_the_verb_understands_and_flags_have_no_type(verb):
    text = " ".join(done(*verb.split(), "--help").split())
    example = VERBS[verb].example
    assert f"Example: cpcal {example[:30]}" in text
    assert "<bool>" not in text
    if verb in LONG:  # they say less or more
        assert all(option in text for option in ("--quiet", "-q", "--verbose", "-v"))
    command: Any = typer.main.get_command(app)
    arguments = shlex.split(example)
    context = None
    for name in verb.split():
        context = command.make_context(name, [name], parent=context, resilient_parsing=True)
        command, arguments = command.get_command(context, name), arguments[1:]
    command.make_context(verb, arguments, parent=context)


def test_plugins_lists_the_contractors():
    said = done("plugins")
    assert all(name in said for name in ("lifted", "hc4", "cpcal.contractors"))
