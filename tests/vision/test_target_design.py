"""The designer of targets: its criterion against noise and against its own definition, its limits, its determinism."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import cpcal.vision.target as module
from cpcal.common.errors import InputError
from cpcal.vision.target import DELTALAB_TARGET, design_target, separation, two_diagonals

OLD = two_diagonals(
    "by hand",
    (-185.0, -60.0, -30.0, 20.0, 45.0, 70.0, 185.0),
    (-185.0, -100.0, -75.0, 115.0, 140.0, 185.0),
    side=280.0,
    pitch=25.0,
    radius=6.0,
)


def cross_ratio(a, b, c, d):
    """(AC / BC) : (AD / BD) of four points of a line by their coordinates; every projection keeps it."""
    return ((c - a) * (d - b)) / ((c - b) * (d - a))


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(module, "_GENERATIONS", 300)
    monkeypatch.setattr(module, "_CHAINS", 40)


def log_and_gradient(four):
    log = np.log(cross_ratio(*four))
    steps = 1e-5 * np.eye(4)
    sides = [[np.log(cross_ratio(*(np.array(four) + sign * step))) for sign in (1, -1)] for step in steps]
    return log, np.linalg.norm([(plus - minus) / 2e-5 for plus, minus in sides])


def apart(one, other):
    (x, gx), (y, gy) = log_and_gradient(one), log_and_gradient(other)
    return abs(x - y) / np.hypot(gx, gy)


def fours(row):
    for start in range(len(row) - 3):
        yield row[start : start + 4]
    for start, missing in itertools.product(range(len(row) - 4), (1, 2, 3)):
        yield np.delete(row[start : start + 5], missing)


def least_separation(target):
    """The criterion as its docstring has it, dot by dot."""
    rows = [np.linalg.norm(target.dots[list(line)] - target.dots[line[0]], axis=1) for line in target.lines]
    signatures = [four for row in rows for four in (row[:4], row[-4:])]
    others = [four for row in rows for four in fours(row)]
    on_row = {i for line in target.lines for i in line}
    grid = np.array([dot for i, dot in enumerate(target.dots) if i not in on_row])
    turned = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0)
    for axis, plane in itertools.product((0, 1), (grid, grid @ turned)):
        for value in np.unique(np.round(plane[:, 1 - axis], 3)):
            line = np.sort(plane[np.round(plane[:, 1 - axis], 3) == value, axis])
            others += list(fours(line))
    return min(apart(one, other) for one in signatures for other in others if not np.array_equal(one, other))


def test_the_criterion_is_what_its_docstring_says():
    small = two_diagonals("s", (-60.0, -31.0, -9.0, 22.0, 55.0), (-58.0, -20.0, 40.0, 63.0), 100.0, 25.0, 3.0)
    assert separation(small).least == pytest.approx(least_separation(small), rel=1e-6)
    assert separation(DELTALAB_TARGET).least == pytest.approx(least_separation(DELTALAB_TARGET), rel=1e-6)


def test_the_default_target_is_told_apart_far_better_than_one_made_by_hand():
    assert separation(DELTALAB_TARGET).least > 2.0
    assert separation(OLD).least < 0.1
    assert len(separation(DELTALAB_TARGET).signatures) == 4


def test_the_sensitivity_is_that_to_noise():
    row = np.linalg.norm(DELTALAB_TARGET.dots[[0, 1, 2, 3]] - DELTALAB_TARGET.dots[0], axis=1)
    noisy = row + 0.02 * np.random.default_rng(0).standard_normal((20_000, 4))
    value, square = module._log_cross_ratio(row)
    logs = np.log([cross_ratio(*four) for four in noisy])
    assert logs.mean() == pytest.approx(value, abs=1e-4)
    assert logs.std() == pytest.approx(0.02 * np.sqrt(square), rel=0.03)


def test_it_does_not_depend_on_where_and_how_large_the_target_is_drawn():
    moved = replace(DELTALAB_TARGET, dots=DELTALAB_TARGET.dots[:, ::-1] * [-1.0, 1.0] + [30.0, -7.0])
    assert separation(moved).least == pytest.approx(separation(DELTALAB_TARGET).least)
    larger = replace(DELTALAB_TARGET, dots=3.0 * DELTALAB_TARGET.dots, radius=18.0)
    assert separation(larger).least == pytest.approx(3.0 * separation(DELTALAB_TARGET).least)


def test_a_designed_target_keeps_its_limits(quick):
    target = design_target(
        "mine", side=200.0, pitch=30.0, radius=4.0, least_gap=9.0, off_rows=3.0, bright=False, seed=4
    )
    assert separation(target).least > 0.5
    assert [len(line) for line in target.lines] == [7, 6]
    assert (target.name, target.radius, target.bright) == ("mine", 4.0, False)
    gaps = np.linalg.norm(target.dots[:, None] - target.dots, axis=2)[np.triu_indices(len(target.dots), 1)]
    assert gaps.min() >= 2.0 * 4.0 + 9.0 - 1e-9
    assert np.abs(target.dots).max() <= 100.0 + 1e-9
    rows, ticks = target.dots[:13], np.unique(np.round(target.dots[13:], 6))
    assert np.abs(rows[..., None] - ticks).min() >= 3.0 - 1e-9
    places = rows[:, 0] * np.sqrt(2.0)
    np.testing.assert_allclose(places, np.round(places), atol=1e-9)


def test_the_same_seed_gives_the_same_target_and_another_one_another(quick):
    assert design_target(seed=3) == design_target(seed=3)
    assert design_target(seed=3) != design_target(seed=4)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"side": 40.0}, "no room"),
        ({"radius": 11.0}, "no room"),
        ({"off_rows": 13.0}, "no room"),
        ({"side": 130.0, "radius": 3.0, "least_gap": 14.0}, "no room"),
        ({"step": 0.0}, "is 0.0"),
        ({"pitch": -1.0}, "is -1.0"),
        ({"side": np.inf}, "is inf"),
        ({"least_gap": np.nan}, "is nan"),
    ],
)
def test_what_cannot_be_designed_is_refused(quick, changed, said):
    with pytest.raises(InputError, match=said):
        design_target(**changed)


def test_a_target_without_rows_has_no_separation():
    with pytest.raises(InputError, match="no identifying rows"):
        separation(two_diagonals("grid", (), (), 100.0, 20.0, 4.0))
