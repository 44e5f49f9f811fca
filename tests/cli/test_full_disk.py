"""A disk that fills up costs what does not fit, and never an answer, a checkpoint or what was there before."""

import resource
import tempfile
from io import StringIO

import pytest

import cpcal
from cpcal.common.errors import OutputError
from cpcal.common.files import draft_name, unwritable
from cpcal.questions import Uncertified, ask
from cpcal.solver.execution.checkpoint_file import FOLDER
from tests.cli.command import run

OPTIONS = ["--legs", "1,2", "--delta", "0.5"]


def certified(campaign, folder, *options, largest=None):
    """`cpcal certify` while no file that is written may have more bytes than that."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    if largest is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, hard))
    try:
        return run("certify", campaign, "-o", folder, *OPTIONS, *options)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_answers_are_printed_and_kept_where_the_run_cannot_be_written(small, tmp_path):
    assert certified(small, tmp_path).exit_code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    full = certified(small, tmp_path, "--gap", "1e-2", largest=100_000)
    assert full.exit_code == 2
    assert "Leg 2: Fails below" in full.stdout
    assert "File too large" in full.stderr
    assert "Traceback" not in full.stderr
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    assert sorted(path.name for path in (tmp_path / FOLDER).iterdir()) == ["leg1.answer", "leg2.answer"]
    resumed = certified(small, tmp_path, "--gap", "1e-2", "--resume")
    assert resumed.exit_code == 0, resumed.stderr
    assert not (tmp_path / FOLDER).exists()


class Full(StringIO):
    """A file on a disk on which no byte can be written any more."""

    def write(self, text):
        raise OSError(28, "No space left on device")


def full(path, content):
    raise unwritable(path, OSError(28, "No space left on device"))


@pytest.mark.parametrize("what", ["steps", "certificate"])
def test_a_certificate_that_cannot_be_written_costs_no_answer(small, tmp_path, monkeypatch, what):
    measured = cpcal.load_campaign(small)
    whole = cpcal.certify(measured, legs=[2], delta=0.5, certificates=tmp_path / "whole").legs[0]
    if what == "steps":
        there = tempfile.TemporaryFile
        monkeypatch.setattr(
            tempfile, "TemporaryFile", lambda mode="w+b", **given: Full() if mode == "w+" else there(mode, **given)
        )
    else:
        monkeypatch.setattr(ask, "write_file", full)
    leg = cpcal.certify(measured, legs=[2], delta=0.5, certificates=tmp_path / "full").legs[0]
    assert (leg.bracket.lo, leg.bracket.hi, leg.bracket.point) == (
        whole.bracket.lo,
        whole.bracket.hi,
        whole.bracket.point,
    )
    assert leg.not_certified is Uncertified.UNWRITTEN
    assert not leg.certified


def test_a_full_disk_is_no_fault_of_the_input_and_names_what_was_to_be_written(tmp_path):
    with pytest.raises(
        OutputError, match=r"problem with the output:\n .*/run/report\.html: cannot be written: No space"
    ):
        raise unwritable(tmp_path / "run" / draft_name() / "report.html", OSError(28, "No space left on device"))
