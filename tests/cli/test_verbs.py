"""The verbs, in one process: what they write, print and refuse."""

import json

import pytest

import cpcal
from cpcal.common.files import unwritable
from cpcal.files import campaign_sha256
from tests.cli.command import run


def squeezed(text):
    return " ".join(text.replace("│", " ").split())


@pytest.fixture(scope="module")
def certified(campaign, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "run"
    return folder, run("certify", campaign, "-o", folder, "--legs", "1")


def test_version():
    outcome = run("--version")
    assert outcome.exit_code == 0
    assert outcome.stdout == f"cpcal {cpcal.__version__}\n"


def test_plugins_lists_the_contractors():
    outcome = run("plugins")
    assert outcome.exit_code == 0
    assert "lifted" in outcome.stdout
    assert "hc4" in outcome.stdout
    assert "cpcal.contractors" in outcome.stdout


def test_help_documents_the_exit_statuses():
    outcome = run("certify", "--help")
    assert outcome.exit_code == 0
    text = squeezed(outcome.stdout)
    for piece in (
        "Exit status: 0 every leg answered",
        "1 some leg undecided",
        "2 unusable input",
        "130 interrupted",
    ):
        assert piece in text
    assert "THERE EXISTS a reading in its set" in text


def test_simulate_writes_the_campaign_of_its_options(tmp_path):
    options = ["--seed", 5, "--runs", 2, "--random-poses", 3, "--no-extremal", "--joint-error", 1]
    options += ["--factor", 2, "--noise", 0.5, "--truncate", 2, "--deviation", 0.5, "--stroke", 10, 130]
    outcome = run("simulate", "deltalab", "-o", tmp_path / "new" / "c", *options)
    assert outcome.exit_code == 0
    assert "6 measurements" in outcome.stdout
    expected = cpcal.simulate(
        seed=5,
        runs=2,
        random_poses=3,
        extremal=False,
        joint_error=1.0,
        factor=2.0,
        noise=0.5,
        truncate=2.0,
        deviation=0.5,
        stroke=(10.0, 130.0),
    )
    assert campaign_sha256(cpcal.load_campaign(tmp_path / "new" / "c")) == campaign_sha256(expected)


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


def test_json_is_the_file_and_nothing_else(campaign, tmp_path):
    outcome = run("certify", campaign, "-o", tmp_path, "--legs", "2", "--json")
    assert outcome.exit_code == 0
    assert outcome.stdout == (tmp_path / "result.json").read_text(encoding="utf-8")
    assert json.loads(outcome.stdout)["legs"][0]["leg"] == 2
    assert outcome.stderr == ""


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
    outcome = run("certify", campaign, "-o", tmp_path / "file" / "run")
    assert outcome.exit_code == 2
    assert "is not one" in outcome.stderr


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
