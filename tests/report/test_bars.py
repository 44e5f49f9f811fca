"""The enclosure as bars: thin, wide, unbounded and empty ones, with and without a fit."""

import math
import re

import numpy as np
import pytest

from cpcal.report.figures import FARTHEST, Enclosure, enclosure_svg

NAMES = ("a_x", "a_y", "l")
NOMINAL = np.array([100.0, -5.0, 0.0])


def enclosure(lo, hi, fit=None):
    return Enclosure(NAMES, NOMINAL, NOMINAL + lo, NOMINAL + hi, None if fit is None else NOMINAL + fit)


def drawn(data):
    svg = enclosure_svg(data, label="x")
    assert "nan" not in svg.lower().replace("dominant", "")
    assert all(name in svg for name in NAMES)
    return svg


def marks(svg, variable):
    """Ticks, arrows and crosses of that colour: each begins a track, and no other path of that colour is there."""
    paths = re.findall(rf'<path d="([^"]*)" style="(?:fill: none; stroke|fill): var\(--{variable}\)', svg)
    return sum(path.count("M") for path in paths)


def test_a_thin_enclosure_has_its_ticks_and_its_width_in_words():
    svg = drawn(enclosure(np.full(3, 1.0), np.full(3, 1.0 + 2.0**-30), np.zeros(3)))
    assert marks(svg, "edge") == 6
    assert marks(svg, "support") == 3
    assert "9.4e-10" in svg  # 2**-30 rounded up


def test_without_a_fit_there_is_no_cross():
    svg = drawn(enclosure(np.full(3, -2.0), np.full(3, 1.0)))
    assert "var(--support)" not in svg
    assert ">3.0</text>" in svg


@pytest.mark.parametrize("far", [math.inf, 1e300, 2 * FARTHEST])
def test_bounds_that_are_too_far_become_arrows(far):
    data = enclosure(np.array([-far, -1.0, -1.0]), np.array([far, 1.0, far]), np.array([0.5, 0.5, far]))
    assert data.unbounded
    assert data.fit_beyond
    assert not data.empty
    svg = drawn(data)
    assert marks(svg, "edge") == 6


def test_an_empty_enclosure_has_no_bars():
    data = enclosure(np.full(3, np.nan), np.full(3, np.nan), np.ones(3))
    assert data.empty
    assert not data.unbounded
    svg = drawn(data)
    assert "var(--band)" not in svg
    assert svg.count("none</text>") == 3
    assert marks(svg, "support") == 3


def test_everything_at_the_nominal_value():
    svg = drawn(enclosure(np.zeros(3), np.zeros(3), np.zeros(3)))
    assert svg.count(">0</text>") >= 3  # widths


def test_a_fit_that_is_no_number_is_left_out():
    data = enclosure(np.zeros(3), np.ones(3), np.array([np.nan, 1.0, np.inf]))
    assert data.fit_beyond
    assert marks(drawn(data), "support") == 1
