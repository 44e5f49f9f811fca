"""What the tests of several verbs begin with."""

from __future__ import annotations

from pathlib import Path

import pytest

import cpcal


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign folder with exact readings, quick to certify; nobody writes into it."""
    folder = tmp_path_factory.mktemp("exact") / "campaign"
    cpcal.save_campaign(cpcal.simulate(seed=1, joint_error=1.0, factor=0.0), folder)
    return folder
