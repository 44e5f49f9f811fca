"""`cpcal report`: the page of a run again, and what is refused."""

import json
import shutil

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.cli import app

runner = CliRunner()


def report(*arguments):
    return runner.invoke(app, ["report", *map(str, arguments)], prog_name="cpcal")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A folder of campaign/ and run/, as the demo leaves them, with one leg and exact readings."""
    folder = tmp_path_factory.mktemp("report")
    cpcal.save_campaign(cpcal.simulate(seed=1, joint_error=1.0, factor=0.0), folder / "campaign")
    options = ["--legs", "1", "-o", folder / "run"]
    outcome = runner.invoke(app, ["certify", str(folder / "campaign"), *map(str, options)], prog_name="cpcal")
    assert outcome.exit_code == 0
    return folder


@pytest.fixture
def copy(study, tmp_path):
    shutil.copytree(study, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_the_same_page_as_certify_wrote(copy):
    page = copy / "run" / "report.html"
    first, files = page.read_bytes(), sorted(page.parent.iterdir())
    page.unlink()
    outcome = report(copy / "run")
    assert outcome.exit_code == 0, outcome.stderr
    assert str(page) in outcome.stdout
    assert page.read_bytes() == first
    assert sorted(page.parent.iterdir()) == files


def test_the_run_has_polygons_and_one_without_still_has_its_page(copy):
    file, page = copy / "run" / "result.json", copy / "run" / "report.html"
    data = json.loads(file.read_text(encoding="utf-8"))
    assert len(data["legs"][0]["information"]["projections"]["pairs"]) == 7
    assert page.read_text(encoding="utf-8").count("Leg 1: polygon that holds") == 7
    data["legs"][0]["information"]["projections"] = None
    file.write_text(json.dumps(data), encoding="utf-8")
    assert report(copy / "run").exit_code == 0
    assert "polygon that holds" not in page.read_text(encoding="utf-8")


def test_the_campaign_is_found_from_within_the_run(copy, monkeypatch):
    monkeypatch.chdir(copy / "run")
    assert report(".", "-o", "other/page.html").exit_code == 0
    assert (copy / "run" / "other" / "page.html").is_file()


def test_campaign_and_file_of_ones_choice(copy, tmp_path):
    (copy / "campaign").rename(copy / "elsewhere")
    before = (copy / "run" / "report.html").read_bytes()
    (copy / "run" / "report.html").unlink()
    outcome = report(copy / "run", "--campaign", copy / "elsewhere", "-o", tmp_path / "new" / "page.html")
    assert outcome.exit_code == 0
    assert (tmp_path / "new" / "page.html").read_bytes() == before
    assert not (copy / "run" / "report.html").exists()


def refused(outcome, *texts):
    assert outcome.exit_code == 2
    assert outcome.stdout == ""
    assert outcome.stderr.startswith("cpcal: ")
    for text in texts:
        assert text in outcome.stderr


def test_without_a_campaign(copy):
    shutil.rmtree(copy / "campaign")
    assert report(copy / "run").exit_code == 0  # the run holds it
    (copy / "run" / "campaign.json").unlink()
    refused(report(copy / "run"), "campaign.json")


def test_another_campaign_is_refused_by_its_sha256(copy):
    cpcal.save_campaign(cpcal.simulate(seed=2), copy / "other")
    before = (copy / "run" / "report.html").read_bytes()
    refused(report(copy / "run", "--campaign", copy / "other"), "another campaign", "SHA-256")
    assert (copy / "run" / "report.html").read_bytes() == before


def test_no_run_and_no_file(copy):
    refused(report(copy / "campaign"), "result.json", "does not exist")
    refused(report(copy / "run", "-o", copy), "is a folder")
    refused(report(copy / "run", "-o", copy / "run" / "result.json" / "page.html"), "is not one")


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (("campaign", "sha256"), 5, "campaign.sha256 is no text"),
        (("campaign", "robot"), None, "robot"),
        (("options", "delta"), "wide", "options.delta is no number"),
        (("options", "eps"), [], "options.eps is no number"),
        (("options", "information", "center"), "left", "not known"),
        (("options", "information", "gap"), -1, "no relative gap"),
        (("model", "parameters"), ["x"] * 7, "model.parameters[0] is no object"),
        (("legs", 0, "bracket", "enclosure", "names"), list("tuvwxyz"), "has not the parameters"),
        (("legs", 0, "leg"), 99, "another list of legs"),
        (("legs", 0, "leg"), "\x1b[2J", "leg"),
        (("legs", 0, "bracket", "point"), [1.0], "point"),
        (("legs", 0, "bracket", "center"), [], "center"),
        (("legs", 0, "information", "work", "nodes"), "many", "nodes"),
        (("legs", 0, "support", "information", "ids"), [1], "support"),
        (("legs", 0, "information", "not_certified"), "proved", "not_certified is none of"),
        (("legs", 0, "bracket", "enclosure", "lo"), [2.0], "no box"),
        (("legs", 0, "information", "projections"), 5, "lacks or garbles"),
        (("legs", 0, "information", "projections", "eps"), "nan", "not finite"),
        (("legs", 0, "information", "projections", "box", "hi"), ["inf"] * 7, "not finite"),
        (("legs", 0, "information", "projections", "pairs", 0, "parameters"), ["a_x", "a_x"], "not two parameters"),
        (
            ("legs", 0, "information", "projections", "pairs", 0, "parameters"),
            ["a_x", "<b>"],
            "parameters that are not there",
        ),
        (("legs", 0, "information", "projections", "pairs", 0, "half_planes", 0), [0.0, 0.0, 1.0], "no half-plane"),
        (("legs", 0, "information", "projections", "pairs", 0, "half_planes", 0), [1.0], "lacks or garbles"),
    ],
)
def test_a_garbled_result_is_refused(copy, path, value, text):
    file = copy / "run" / "result.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    part = data
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = value
    file.write_text(json.dumps(data), encoding="utf-8")
    outcome = report(copy / "run")
    assert outcome.exit_code == 1
    assert "REFUSED" in outcome.stdout
    assert text in outcome.stdout
    assert "\x1b" not in outcome.output
