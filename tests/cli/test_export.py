"""Parameters for a controller: both formats say the same, and what a damaged run says is not written."""

import json
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

import cpcal
from cpcal.cli.report import DrawingFrames, exported, frames_of_run
from cpcal.questions import recommendation
from cpcal.robot import rotation_matrix
from tests.cli.command import refused, run
from tests.remembered import verify_once


@pytest.fixture(scope="module")
def folder(small, tmp_path_factory):
    place = tmp_path_factory.mktemp("export")
    assert run("certify", small, "-o", place / "run", "--legs", "2", "--tolerance", "30").exit_code == 0
    return place


@pytest.fixture(scope="module")
def data(folder, small):
    return exported(cpcal.load_campaign(small), cpcal.load_result(folder / "run"))


@pytest.fixture(autouse=True)
def checked_once(monkeypatch):
    verify_once(monkeypatch)  # no process begins


def test_both_formats_say_the_same_also_beyond_the_basic_plane(data, folder, tmp_path, monkeypatch):
    text = "\U0001f916 \U00020000 \u00e9 \u4e2d \" \\ 'x'"
    named = {**data, "robot": text, "provenance": {**data["provenance"], text: text}}
    monkeypatch.setattr("cpcal.cli.report.exported", lambda *_: named)
    for name, read in (("toml", tomllib.loads), ("json", json.loads)):
        assert run("export", folder / "run", "-f", name, "-o", tmp_path / name).exit_code == 0
        assert read((tmp_path / name).read_text(encoding="utf-8")) == named


def test_a_format_that_does_not_go_with_the_run_is_refused(folder, tmp_path):
    said = refused("export", folder / "run", "-f", "urdf", "-o", tmp_path / "p")
    assert "option --format: is urdf -> of this run write one of toml, json" in said
    assert not any(tmp_path.iterdir())
    for name, read in (("toml", tomllib.loads), ("json", json.loads)):
        assert run("export", folder / "run", "-f", name, "-o", tmp_path / name).exit_code == 0
        assert read((tmp_path / name).read_text(encoding="utf-8"))["format"] == "cpcal-parameters/2"


def test_it_holds_what_the_run_proves_with_frame_and_provenance(folder, data):
    result = cpcal.load_result(folder / "run")
    leg, (written,) = result.legs[0], data["legs"]
    assert [p["recommended"] for p in written["parameters"].values()] == list(leg.recommended.point)
    assert (written["recommended"], written["largest_error"]) == (recommendation(result, leg), leg.recommended.largest)
    assert written["passes_from"] == leg.passes_from.eps
    assert [p["range_lo"] for p in written["parameters"].values()] == leg.ranges.box.lo.tolist()
    assert (written["range_eps"], written["verdict"], data["verdict"]) == (30.0, "pass", "pass")
    assert written["certificates"] == ["leg2.cert.jsonl", "leg2.recommended.cert.jsonl", "ranges-leg2.cert.jsonl"]
    assert "base frame" in data["frame"]
    assert data["provenance"]["campaign_sha256"] == result.campaign.sha256


def test_moved_ranges_hold_the_moved_points(data):
    rng = np.random.default_rng(1)
    turned = rotation_matrix(rng.standard_normal((2, 4)))
    frames = DrawingFrames((turned[0], rng.standard_normal(3)), (turned[1], rng.standard_normal(3)))
    lo = 100.0 * rng.standard_normal(7)
    hi = lo + rng.random(7)
    low, high = frames.box(lo, hi)
    for _ in range(100):
        x = lo + (hi - lo) * rng.integers(0, 2, 7)
        assert ((frames.point(x) >= low) & (frames.point(x) <= high)).all()
    assert frames.point(lo)[6] == lo[6]


def test_frames_of_another_study_move_nothing(folder):
    """Certified numbers would stand in frames that have nothing to do with them."""
    result = cpcal.load_result(folder / "run")
    other = SimpleNamespace(campaign_sha256="0" * 64)
    with pytest.raises(cpcal.InputError, match="frames of another study"):
        frames_of_run(result, other, "calibration")
