"""Runs of the room are verified many times, each with something else edited: certificates are judged once."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cpcal.checker import check
from cpcal.handeye import verify_chain
from tests.remembered import remembered

Verify = Callable[[Path], list[tuple[bool, str]]]


@pytest.fixture(scope="package", autouse=True)
def judged_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verify_chain, "check", remembered(check))
        yield


@pytest.fixture
def refused(tmp_path: Path) -> Callable[..., bool]:
    """Whether a run (a folder) is refused when the content of one of its JSON files was changed."""

    def judge(run: Path, name: str, change: Callable[[Any], object], verify: Verify) -> bool:
        shutil.copytree(run, tmp_path / "run")
        path = tmp_path / "run" / name
        data = json.loads(path.read_text())
        change(data)
        path.write_text(json.dumps(data))
        return not all(accepted for accepted, _ in verify(tmp_path / "run"))

    return judge
