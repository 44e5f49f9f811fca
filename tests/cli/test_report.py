"""`cpcal report`: the page of a run again, and what is refused."""

import shutil

import pytest

from tests.cli.command import done, refused
from tests.remembered import verify_once


@pytest.fixture
def copy(genuine, small, tmp_path, monkeypatch):
    """A folder of campaign/ and run/, as the demo leaves them."""
    verify_once(monkeypatch)  # no process begins
    shutil.copytree(genuine, tmp_path / "run")
    shutil.copytree(small, tmp_path / "campaign")
    return tmp_path


def test_the_page_is_written_where_one_says_from_the_run_alone(copy, tmp_path):
    page, new = copy / "run" / "report.html", tmp_path / "new" / "page.html"
    before = page.read_bytes()
    page.unlink()
    done("report", copy / "run", "-o", new)
    assert new.read_bytes() == before
    assert not page.exists()
    done("report", copy / "run")
    (copy / "run" / "campaign.json").unlink()
    assert "campaign.json" in refused("report", copy / "run")


def test_no_run_and_no_file(copy):
    assert "holds neither result.json nor a certificate" in refused("report", copy / "campaign")
    assert "is a folder" in refused("report", copy / "run", "-o", copy)
    within = copy / "run" / "result.json" / "page.html"
    assert "page.html: cannot be written" in refused("report", copy / "run", "-o", within)
