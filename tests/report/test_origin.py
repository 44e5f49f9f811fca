"""The command on the page asks the same question again; versions are named."""

import dataclasses
import shlex

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app
from cpcal.common.codec import encoded
from cpcal.report.run_page import command
from tests.changed import leg_with


@pytest.fixture(scope="module")
def few_poses():
    return cpcal.simulate(seed=1, joint_error=1.0, factor=0.0, extremal=False, random_poses=14)


@pytest.mark.parametrize(
    "asked",
    [
        {"legs": [2], "eps": 0.1, "model": "gain", "tolerance": 0.5, "time_limit": 60.0, "support": "none"},
        {"legs": [3], "delta": 12.5, "center": "nominal", "gap": 1e-3, "contractors": ("hc4", "lifted")},
    ],
)
def test_the_command_repeats_the_run(few_poses, tmp_path, asked):
    result = cpcal.certify(few_poses, certificates=tmp_path / "ours", ranges=True, **asked)  # as the command does
    cpcal.save_campaign(few_poses, tmp_path / "c")
    places = {"CAMPAIGN": str(tmp_path / "c"), "RUN": str(tmp_path / "run")}
    words = [places.get(word, word) for word in shlex.split(command(result))]
    assert words.pop(0) == "cpcal"
    assert CliRunner().invoke(app, words, prog_name="cpcal").exit_code in (0, 1)
    again = cpcal.load_result(tmp_path / "run")

    def answers(found):  # without what differs from run to run, and the names of files
        return [encoded(leg_with(leg, seconds=0.0, ranges=None)) for leg in found.legs]

    assert answers(again) == answers(result)
    assert dataclasses.replace(again, legs=()) == dataclasses.replace(result, legs=())
