"""A mutant is applied to a copy, once and where it belongs; the tests that it names must pass without it."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import mutants_of_code
from benchmarks.mutants_of_code import Mutant, MutantError, Outcome, main, misplaced, outcome, read, unchanged_failures

SMALLER = Mutant("ends", "room", "x <= 1", "x < 1", "an end is not compared", "tests/test_ends.py -k at_the_end")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    files = {
        "room/ends.py": "def small(x):\n    while x > 9:\n        x -= 1\n    return x <= 1\n",
        "tests/test_ends.py": "from room.ends import small\n\n\ndef test_at_the_end():\n    assert small(1)\n\n\n"
        "def test_inside():\n    assert small(0)\n\n\ndef test_wrong():\n    assert small(2)\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_mutant_is_noticed_by_the_test_that_it_names_and_by_no_other(tree: Path) -> None:
    assert outcome(SMALLER, tree, 60.0).noticed_by == "tests/test_ends.py::test_at_the_end"
    assert outcome(replace(SMALLER, tests="tests/test_ends.py -k inside"), tree, 60.0).noticed_by == ""
    assert "x <= 1" in (tree / "room" / "ends.py").read_text()  # what was changed is a copy


def test_what_does_not_end_in_time_is_an_error_and_nothing_that_was_noticed(tree: Path) -> None:
    endless = replace(SMALLER, pattern="x > 9", replacement="not __import__('time').sleep(0.1)")
    with pytest.raises(MutantError, match="an end is not compared: no end in 1 s"):
        outcome(endless, tree, 1.0)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"tests": "tests/test_ends.py -k nothing"}, "pytest ended with 5"),
        ({"replacement": "x < ("}, "pytest ended with 2"),
        ({"pattern": "x == 7"}, "nowhere below room"),
        ({"pattern": "x "}, r"3 times in room/ends\.py"),
        ({"below": "no_room"}, "nowhere below no_room"),
    ],
)
def test_a_mutant_that_does_not_fit_is_an_error_that_names_it(tree: Path, change: dict[str, str], reason: str) -> None:
    with pytest.raises(MutantError, match=f"an end is not compared: .*{reason}"):
        outcome(replace(SMALLER, **change), tree, 60.0)


def test_places_and_tests_that_are_gone_are_named_before_anything_runs(tree: Path) -> None:
    gone = replace(SMALLER, pattern="x == 7", tests="tests/test_gone.py")
    first, second = misplaced([SMALLER, gone], tree)
    assert "nowhere below room" in first
    assert "tests/test_gone.py is not there" in second
    (third,) = misplaced([replace(SMALLER, tests="tests/test_ends.py -k nobody")], tree)
    assert "a test called nobody is not there" in third


def test_a_test_that_fails_without_a_mutant_notices_nothing(tree: Path) -> None:
    (said,) = unchanged_failures([SMALLER, replace(SMALLER, tests="tests/test_ends.py")], tree, 60.0).values()
    assert said.startswith("tests/test_ends.py: pytest ends with 1 without a change")


def test_the_list_can_be_read_and_says_nothing_twice(tmp_path: Path) -> None:
    assert len(read()) >= 150
    assert misplaced(read()) == []  # a pattern moves with the line that it names
    entry = '[[room]]\nfalse = "a"\nbelow = "b"\npattern = "c"\nreplacement = "d"\ntests = "tests"\n'
    (tmp_path / "list.toml").write_text(2 * entry)
    with pytest.raises(MutantError, match="two mutants say the same: a"):
        read(tmp_path / "list.toml")


@pytest.mark.parametrize(("noticed", "status"), [(19, 0), (18, 1)])
def test_below_95_percent_the_exit_status_is_1(tree, monkeypatch, noticed, status):
    mutants = [replace(SMALLER, false=f"{k}") for k in range(20)]
    monkeypatch.setattr(mutants_of_code, "HERE", tree)
    monkeypatch.setattr(mutants_of_code, "read", lambda: mutants)
    monkeypatch.setattr(mutants_of_code, "misplaced", lambda mutants: [])
    monkeypatch.setattr(mutants_of_code, "unchanged_failures", lambda *_: {})
    monkeypatch.setattr(mutants_of_code, "outcome", lambda m, *_: Outcome(m, "a test" * (int(m.false) < noticed)))
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == status
    monkeypatch.setattr(mutants_of_code, "misplaced", lambda mutants: ["a pattern is gone"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
