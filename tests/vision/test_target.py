"""Targets as values: what makes one, what every projection keeps, and the default one."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.vision.target import DELTALAB_TARGET, Target, off_line, resized, two_diagonals

ROW = np.array([[0.0, 0.0], [10.0, 10.0], [30.0, 30.0], [45.0, 45.0], [0.0, 20.0]])


def cross_ratio(a, b, c, d):
    """(AC / BC) : (AD / BD) of four points of a line by their coordinates; every projection keeps it."""
    return ((c - a) * (d - b)) / ((c - b) * (d - a))


def log_and_gradient(four):
    log = np.log(cross_ratio(*four))
    steps = 1e-5 * np.eye(4)
    sides = [[np.log(cross_ratio(*(np.array(four) + sign * step))) for sign in (1, -1)] for step in steps]
    return log, np.linalg.norm([(plus - minus) / 2e-5 for plus, minus in sides])


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
    logs = np.array([log_and_gradient(four) for four in others])
    own = np.array([log_and_gradient(four) for four in signatures])
    apart = np.abs(own[:, None, 0] - logs[:, 0]) / np.hypot(own[:, None, 1], logs[:, 1])
    same = [[np.array_equal(one, other) for other in others] for one in signatures]
    return np.where(same, np.inf, apart).min()


def problems(**changed):
    values = {"name": "t", "dots": ROW, "radius": 2.0, "lines": ((0, 1, 2, 3),)} | changed
    with pytest.raises(InputError) as caught:
        Target(**values)
    return [(p.where, p.what) for p in caught.value.problems]


def test_every_projection_of_a_line_keeps_the_cross_ratio_and_so_does_reading_it_backwards():
    places = np.array([-3.0, 1.0, 2.5, 7.0])
    rng = np.random.default_rng(0)
    for a, b, c in rng.uniform([0.5, -5.0, -0.02], [2.0, 5.0, 0.02], (50, 3)):
        moved = (a * places + b) / (c * places + 1.0)
        assert cross_ratio(*moved) == pytest.approx(cross_ratio(*places), rel=1e-12)
        assert cross_ratio(*moved[::-1]) == pytest.approx(cross_ratio(*places), rel=1e-12)
    assert cross_ratio(0.0, 1.0, 2.0, 3.0) == pytest.approx(4.0 / 3.0)


def test_the_default_target_has_two_rows_that_are_told_apart_and_room_between_its_dots():
    target = DELTALAB_TARGET
    assert [len(line) for line in target.lines] == [7, 6]
    rows = [np.linalg.norm(target.dots[list(line)] - target.dots[line[0]], axis=1) for line in target.lines]
    signatures = [cross_ratio(*four) for row in rows for four in (row[:4], row[-4:])]
    assert np.abs(np.subtract.outer(signatures, signatures))[np.triu_indices(4, 1)].min() > 0.05
    gaps = np.linalg.norm(target.dots[:, None] - target.dots, axis=2)[np.triu_indices(len(target.dots), 1)]
    assert gaps.min() - 2.0 * target.radius > 5.6
    assert np.abs(target.dots).max() <= 140.0


def test_two_diagonals_cross_and_the_grid_keeps_away_from_them():
    target = two_diagonals("t", (-50.0, 0.0, 20.0, 40.0), (-30.0, 10.0, 25.0, 50.0), 100.0, 20.0, 4.0)
    first, second = (target.dots[list(line)] for line in target.lines)
    np.testing.assert_allclose(first @ np.array([1.0, 1.0]) / np.sqrt(2.0), [-50.0, 0.0, 20.0, 40.0])
    np.testing.assert_allclose(second @ np.array([1.0, -1.0]) / np.sqrt(2.0), [-30.0, 10.0, 25.0, 50.0])
    grid = target.dots[8:]
    assert len(grid) == 6 * 6 - 2 * 6
    assert np.abs(np.abs(grid[:, 0]) - np.abs(grid[:, 1])).min() > 0.6 * 20.0
    assert two_diagonals("t", (), (), 100.0, 20.0, 4.0).lines == ()


def test_points_lie_in_the_plane_and_arrays_cannot_be_written_to():
    points = DELTALAB_TARGET.points
    assert points.shape == (133, 3)
    assert not points[:, 2].any()
    with pytest.raises(ValueError, match="read-only"):
        DELTALAB_TARGET.dots[0, 0] = 1.0


def test_targets_are_equal_by_value():
    target = Target("t", ROW, 2.0, ((0, 1, 2, 3),))
    assert target == Target("t", ROW.tolist(), 2.0, ([0, 1, 2, 3],))
    assert hash(target) == hash(Target("t", ROW.tolist(), 2.0, ([0, 1, 2, 3],)))
    moved = np.vstack([ROW[:-1], [[0.0, 20.0 + 1e-9]]])
    for other in (replace(target, dots=moved), replace(target, radius=2.1), replace(target, bright=False), "t"):
        assert target != other


def test_a_measured_row_may_be_off_its_line_by_a_tenth_of_a_radius():
    measured = ROW.copy()
    measured[1] += [0.13, -0.13]  # across the line by 0.18 mm
    assert Target("t", measured, 2.0, ((0, 1, 2, 3),)).dots[1, 0] == 10.13
    measured[1] += [0.03, -0.03]
    assert problems(dots=measured) == [("target lines", "the dots (0, 1, 2, 3) are not collinear")]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"dots": np.zeros((3, 3))}, "two finite numbers"),
        ({"dots": np.array([[0.0, np.nan]])}, "two finite numbers"),
        ({"dots": np.zeros(4)}, "two finite numbers"),
        ({"radius": 0.0}, "is 0"),
        ({"dots": np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 0.0]])}, "0 and 2 are in the same place"),
        ({"dots": np.array([[0.0, 0.0], [1e308, 0.0]])}, "no plate is so large"),
        ({"radius": np.nan}, "is nan"),
        ({"radius": np.inf}, "is inf"),
        ({"lines": ((0, 1, 2),)}, "four or more"),
        ({"lines": ((0, 1, 2, 2),)}, "four or more"),
        ({"lines": ((0, 1, 2, 5),)}, "four or more"),
        ({"lines": ((0, 1, 2, -1),)}, "four or more"),
        ({"lines": ((0, 1, 2, 4),)}, "not collinear"),
        ({"dots": np.zeros((4, 2)), "lines": ((0, 1, 2, 3),)}, "not collinear"),
    ],
)
def test_what_is_no_target_is_refused_with_the_reason(changed, said):
    assert any(said in what for _, what in problems(**changed))


def test_all_bad_rows_are_named():
    assert len(problems(lines=((0, 1), (0, 1, 2, 4), (0, 1, 2, 9)))) == 3


def test_how_far_points_are_off_their_line():
    assert off_line(np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 0.0]])) == pytest.approx(0.5)
    assert off_line(np.zeros((3, 2))) == np.inf


def test_the_rows_of_the_default_target_are_told_apart_far_better_than_those_of_one_made_by_hand():
    first, second = (-185.0, -60.0, -30.0, 20.0, 45.0, 70.0, 185.0), (-185.0, -100.0, -75.0, 115.0, 140.0, 185.0)
    by_hand = two_diagonals("by hand", first, second, side=280.0, pitch=25.0, radius=6.0)
    assert least_separation(by_hand) < 0.1
    separation = least_separation(DELTALAB_TARGET)
    assert separation > 2.0
    twice = resized(DELTALAB_TARGET, 2.0)
    assert twice.radius == 12.0
    assert least_separation(twice) == pytest.approx(2.0 * separation, rel=1e-6)
