"""The classic problems: each file is read, and has its entry from the literature; the quick ones agree with it."""

import pytest

from benchmarks.solver_problems import PROBLEMS, literature, page, run


def test_each_problem_has_its_entry_from_the_literature() -> None:
    assert sorted(path.stem for path in PROBLEMS.glob("*.bch")) == sorted(literature())
    assert len(literature()) >= 40


@pytest.mark.parametrize("name", ["himmelblau_gradient", "kin1", "no_real_solution", "hs071", "branin", "ex7_2_1"])
def test_a_problem_agrees_with_the_literature(name: str) -> None:
    row = run(name, 600.0)
    assert row.complete, row
    assert row.name in page([row], 600.0)
    assert "Misses: none" in page([row], 600.0)
