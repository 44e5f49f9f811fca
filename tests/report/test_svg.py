"""Figures from arrays: ticks are round numbers in the range, data land where they belong, words are no markup."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cpcal.report.svg import INK, Axes, Figure, tick_labels, ticks


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e6), st.integers(2, 9))
def test_ticks_lie_in_the_range_evenly_and_not_too_many(lo, width, most):
    hi = lo + width
    if hi - lo < 1e-6 * abs(lo):  # digits that float64 has not
        return
    found = ticks(lo, hi, most)
    assert len(found) <= most + 1
    assert len(found) >= 1 or most < 4
    slack = 1e-6 * (hi - lo)
    assert all(lo - slack <= t <= hi + slack for t in found)
    steps = np.diff(found)
    assert np.allclose(steps, steps[:1], rtol=1e-6)


@given(st.integers(1, 10**6), st.integers(2, 9))
def test_whole_ticks_are_integers(count, most):
    assert all(t == round(t) for t in ticks(0.0, count + 1.0, most, whole=True))


def test_labels_say_the_numbers_with_few_digits():
    assert tick_labels([-0.5, 0.0, 0.5]) == ["−0.5", "0.0", "0.5"]
    assert tick_labels([0.0, 0.25]) == ["0.00", "0.25"]
    assert tick_labels([-2e-9, 0.0]) == ["−2e−9", "0"]
    assert tick_labels([0.0, 2e7]) == ["0", "2e7"]
    assert tick_labels([k * 0.1 for k in range(4)]) == ["0.0", "0.1", "0.2", "0.3"]


def test_the_corners_of_the_data_are_the_corners_of_the_frame():
    axes = Axes(Figure(100, 50), (10.0, 5.0, 90.0, 40.0), (-1.0, 1.0), (0.0, 2.0))
    assert axes.at([(-1.0, 0.0), (1.0, 2.0)]).tolist() == [[10.0, 40.0], [90.0, 5.0]]


def test_words_are_escaped_and_data_are_no_markup():
    figure = Figure(100, 50)
    figure.text(1.0, math.pi, "<b>&")
    Axes(figure, (0.0, 0.0, 9.0, 9.0), (0.0, 1.0), (0.0, 1.0)).line(INK, [(0, 0), (1, 1)])
    assert ">&lt;b&gt;&amp;</text>" in figure.svg("x")
    assert 'd="M0 9L9 0"' in figure.svg("x")
