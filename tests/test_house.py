"""The house is kept in order: tests stand where what they test stands."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def place(folder: Path) -> str:
    return folder.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("folder", sorted({file.parent for file in (ROOT / "tests").rglob("test_*.py")}), ids=place)
def test_tests_follow_the_packages(folder: Path) -> None:
    """Each folder of tests is named as the folder that it tests; the checker's are parted by what a file claims."""
    kinds = {"valid", "forged", "malformed"}
    tested = folder.relative_to(ROOT / "tests")
    if tested.parts[:1] == ("checker",) and set(tested.parts[1:]) <= kinds:
        tested = Path("checker")
    outside = {Path(), Path("contractors"), Path("benchmarks")}
    assert tested in outside or (ROOT / "cpcal" / tested).is_dir()
