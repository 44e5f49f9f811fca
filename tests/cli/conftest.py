"""What the tests of several verbs begin with: campaigns and runs that are quick to certify; nobody writes into them."""

from pathlib import Path

import pytest

import cpcal
from tests.cli.command import run

SMALL = {"joint_error": 10.0, "factor": 0.0, "extremal": False, "random_poses": 12}


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign folder of 64 exact readings."""
    folder = tmp_path_factory.mktemp("exact") / "campaign"
    cpcal.save_campaign(cpcal.simulate(seed=1, joint_error=1.0, factor=0.0), folder)
    return folder


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign folder of 12 exact readings."""
    folder = tmp_path_factory.mktemp("small") / "campaign"
    cpcal.save_campaign(cpcal.simulate(seed=1, **SMALL), folder)
    return folder


@pytest.fixture(scope="session")
def genuine(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two legs of it."""
    return certified(small, tmp_path_factory.mktemp("genuine") / "run")


def certified(campaign: Path, folder: Path, *options: str) -> Path:
    """A run of two legs in a folder."""
    done = run("certify", campaign, "-o", folder, "--legs", "1,2", "--delta", "2", *options)
    assert done.exit_code in (0, 1), done.output
    return folder
