"""Files that are made to hurt: refused in a sentence within seconds of processor time and 500 MB."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import pytest

from benchmarks import hostile_runs
from benchmarks.hostile_runs import CASES, MEGABYTES, ZERO, Measured, measured, target, weights
from cpcal.checker.files import WORK
from cpcal.files.folders import CAMPAIGN_NAME

SECONDS, PART = 5, 20  # a twentieth of the work, and what is no work: reading a campaign or a study


def checked(*arguments: object) -> Measured:
    """By a bare Python that is ended when it takes more than that."""
    return measured(*arguments, seconds=SECONDS, megabytes=MEGABYTES)


@pytest.mark.parametrize("name", CASES)
def test_work_without_end(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hostile_runs, "STEPS", hostile_runs.STEPS // PART)
    CASES[name](tmp_path)
    done = checked(target(tmp_path), "--work", WORK // PART)
    assert done.status == 1, done.said[-300:]
    assert "REFUSED" in done.said


def test_rows_of_a_leg_by_the_thousand(uncertain_proof: Any, tmp_path: Path) -> None:
    """Each with another reference reading."""
    lines = uncertain_proof.copy()
    step, signs = lines[-1], ["".join("-0+"[n // 3**j % 3] for j in range(7)) for n in range(3**7)]
    step["rows"] = [["lower", k, text] for k in range(16) for text in signs]
    step["bounds"] = [[7, "lo", ZERO, weights([[n, 1] for n in range(len(step["rows"]))])]]
    path = tmp_path / "hostile.cert.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    (tmp_path / CAMPAIGN_NAME).write_bytes((uncertain_proof.folder / CAMPAIGN_NAME).read_bytes())
    done = checked(path, "--work", WORK // PART)
    assert done.status == 1, done.said[-300:]


def test_endless_files(exact_proof: Any, tmp_path: Path) -> None:
    """Zeros without end are no regular file, a file of zeros is refused at its beginning, a pipe is not waited for."""
    zeros, pipe = tmp_path / "zeros.cert.jsonl", tmp_path / "pipe.cert.jsonl"
    with zeros.open("wb") as out:
        out.truncate(2 << 30)
    os.mkfifo(pipe)
    for path, status in ((Path("/dev/zero"), 2), (pipe, 2), (tmp_path / "missing", 2), (zeros, 1)):
        done = checked(path)
        assert done.status == status, done.said
    good = tmp_path / "leg1.cert.jsonl"
    good.write_text("".join(json.dumps(line) + "\n" for line in exact_proof.lines))
    for campaign, status in ((Path("/dev/zero"), 2), (pipe, 2), (zeros, 1), (good, 1)):
        done = checked(good, "--campaign", campaign)
        assert done.status == status, done.said
    (tmp_path / CAMPAIGN_NAME).symlink_to(zeros)
    (tmp_path / "result.json").symlink_to(zeros)
    assert checked(tmp_path).status == 1


CONTENTS = {
    "deep lists": b"[" * 200_000 + b"]" * 200_000,
    "deep objects": b'{"measurements":' * 100_000 + b"0" + b"}" * 100_000,
    "empty lists": b"[" + b"[]," * 5_000_000 + b"[]]",
    "short texts": b"[" + b'"ab",' * 3_000_000 + b'""]',
}


@pytest.mark.parametrize("name", CONTENTS)
def test_campaigns_that_are_none(name: str, exact_proof: Any, tmp_path: Path) -> None:
    content, lines = CONTENTS[name], exact_proof.copy()
    (tmp_path / CAMPAIGN_NAME).write_bytes(content)
    lines[0]["campaign"] = hashlib.sha256(content).hexdigest()
    path = tmp_path / "leg1.cert.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    done = checked(path)
    assert done.status == 1, done.said
    assert done.said.startswith(f"REFUSED: {CAMPAIGN_NAME}")
    assert len(done.said) < 200
    assert done.said.isascii()
