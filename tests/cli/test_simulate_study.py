"""`cpcal simulate --study`: what it writes and refuses."""

import pytest

from cpcal.files import load_study, save_study
from cpcal.simulate import simulate_study
from tests.cli.command import run


def test_a_study_of_the_given_options_is_written(tmp_path):
    options = ["--seed", 5, "--runs", 2, "--random-poses", 3, "--validation-runs", 2, "--images", 2]
    options += ["--joint-error", 0.5, "--noise", 0.5, "--truncate", 2, "--deviation", 0.5, "--stroke", 10, 130]
    options += [
        "--axis-offset",
        1,
        "--joint-offset",
        2,
        "--backlash",
        0.5,
        "--friction",
        0.1,
        "--sag",
        1,
        "--gain",
        0.01,
    ]
    outcome = run("simulate", "deltalab", "--study", "-o", tmp_path / "new" / "s", *options)
    assert outcome.exit_code == 0
    assert "256 rows for calibration, 12 for validation (seed 5)" in outcome.stdout
    expected = simulate_study(
        seed=5,
        runs=2,
        random_poses=3,
        validation_runs=2,
        images=2,
        joint_error=0.5,
        noise=0.5,
        truncate=2.0,
        deviation=0.5,
        stroke=(10.0, 130.0),
        axis_offset=1.0,
        joint_offset=2.0,
        backlash=0.5,
        friction=0.1,
        sag=1.0,
        gain=0.01,
    )
    assert load_study(tmp_path / "new" / "s") == expected
    save_study(expected, tmp_path / "same")
    for name in ("study.toml", "calibration.csv", "validation.csv"):
        assert (tmp_path / "same" / name).read_bytes() == (tmp_path / "new" / "s" / name).read_bytes()


def test_a_study_is_by_default_the_papers(tmp_path):
    outcome = run("simulate", "deltalab", "--study", "-o", tmp_path)
    assert outcome.exit_code == 0
    assert "704 rows for calibration, 640 for validation (seed 1)" in outcome.stdout
    assert load_study(tmp_path) == simulate_study(seed=1)
    assert run("simulate", "deltalab", "--study", "-o", tmp_path).exit_code == 2  # not empty


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["--sag", 1, "--images", 2], ["2 problems", "--images", "--sag", "add --study"]),
        (["--study", "--factor", 3, "--no-extremal"], ["2 problems", "--factor", "--extremal", "leave it out"]),
        (["--study", "--sag", -1, "--random-poses", 0], ["2 problems", "option sag", "option random_poses"]),
        (["--study", "--joint-offset", 400], ["imperfections"]),
        (["--study", "--gain", "much"], ["--gain"]),
    ],
)
def test_senseless_options_are_refused(tmp_path, arguments, texts):
    outcome = run("simulate", "deltalab", "-o", tmp_path / "s", *arguments)
    assert outcome.exit_code == 2
    assert all(text in outcome.stderr for text in texts)
    assert list(tmp_path.iterdir()) == []


def test_help_names_every_mechanism():
    text = run("simulate", "--help").stdout
    for name in ("--study", "--axis-offset", "--joint-offset", "--backlash", "--friction", "--sag", "--gain"):
        assert name in text
