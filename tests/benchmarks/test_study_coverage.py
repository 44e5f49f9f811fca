"""A small sample of the coverage study: what is stated holds the truth, or the study says that it does not."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.study_coverage import CASES, studied, table

SIZE = {"runs": 3, "validation_runs": 2, "random_poses": 8}


@pytest.mark.parametrize("case", ["shared servo noise", "outliers"])
def test_what_is_stated_holds_the_truth(case):
    found = [studied(case, seed, SIZE) for seed in range(2)]
    for name in found[0]["held"]:
        assert np.mean([one["held"][name] for one in found]) > 0.75
    assert not any(one["named"] or one["unexplained"] for one in found)


def test_where_it_does_not_the_study_says_so():
    found = studied("smooth model error", 0, SIZE)
    assert not found["explained"]
    assert found["unexplained"]


def test_the_table_has_a_row_for_each_case():
    rows = {case: [studied(case, 0, SIZE)] for case in list(CASES)[:1]}
    assert table(rows)[2].startswith("| perfect |")
