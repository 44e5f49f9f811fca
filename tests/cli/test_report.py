"""`cpcal report`: the page of a run again, and what is refused."""

import json
import shutil

import pytest

import cpcal
from tests.cli.command import done, refused
from tests.remembered import verify_once


@pytest.fixture
def copy(genuine, small, tmp_path, monkeypatch):
    """A folder of campaign/ and run/, as the demo leaves them."""
    verify_once(monkeypatch)  # no process begins
    shutil.copytree(genuine, tmp_path / "run")
    shutil.copytree(small, tmp_path / "campaign")
    return tmp_path


def test_the_same_page_as_certify_wrote(copy):
    page = copy / "run" / "report.html"
    first, files = page.read_bytes(), sorted(page.parent.iterdir())
    page.unlink()
    assert str(page) in done("report", copy / "run")
    assert page.read_bytes() == first
    assert sorted(page.parent.iterdir()) == files


def test_the_run_has_polygons_and_one_without_still_has_its_page(copy):
    file, page = copy / "run" / "result.json", copy / "run" / "report.html"
    data = json.loads(file.read_text(encoding="utf-8"))
    assert len(data["legs"][0]["ranges"]["information"]["projections"]) == 7
    assert page.read_text(encoding="utf-8").count("Leg 1: polygon that holds") == 7
    data["legs"][0]["ranges"]["information"]["projections"] = []
    file.write_text(json.dumps(data), encoding="utf-8")
    done("report", copy / "run")
    assert "Leg 1: polygon that holds" not in page.read_text(encoding="utf-8")


def test_the_campaign_is_found_from_within_the_run(copy, monkeypatch):
    monkeypatch.chdir(copy / "run")
    done("report", ".", "-o", "other/page.html")
    assert (copy / "run" / "other" / "page.html").is_file()


def test_campaign_and_file_of_ones_choice(copy, tmp_path):
    (copy / "campaign").rename(copy / "elsewhere")
    before = (copy / "run" / "report.html").read_bytes()
    (copy / "run" / "report.html").unlink()
    done("report", copy / "run", "--campaign", copy / "elsewhere", "-o", tmp_path / "new" / "page.html")
    assert (tmp_path / "new" / "page.html").read_bytes() == before
    assert not (copy / "run" / "report.html").exists()


def test_without_a_campaign(copy):
    shutil.rmtree(copy / "campaign")
    done("report", copy / "run")  # the run holds it
    (copy / "run" / "campaign.json").unlink()
    assert "campaign.json" in refused("report", copy / "run")


def test_another_campaign_is_refused_by_its_sha256(copy):
    cpcal.save_campaign(cpcal.simulate(seed=2), copy / "other")
    before = (copy / "run" / "report.html").read_bytes()
    said = refused("report", copy / "run", "--campaign", copy / "other")
    assert "is another campaign than the run's: its SHA-256" in said
    assert (copy / "run" / "report.html").read_bytes() == before


def test_no_run_and_no_file(copy):
    assert "holds neither result.json nor a certificate" in refused("report", copy / "campaign")
    assert "is a folder" in refused("report", copy / "run", "-o", copy)
    within = copy / "run" / "result.json" / "page.html"
    assert "page.html: cannot be written" in refused("report", copy / "run", "-o", within)
