"""Printed bounds stay proved."""

import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.report import bracket_text, clean, gap_text, rounded_down, rounded_up
from cpcal.report.numbers import nearest

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(finite, finite)
def test_a_bracket_is_printed_outward(x, y):
    lo, hi = min(x, y), max(x, y)
    down, up = bracket_text(lo, hi)
    assert Decimal(down) <= Decimal(lo)
    assert Decimal(up) >= Decimal(hi)


@given(finite, finite)
def test_a_gap_is_never_printed_too_small(x, y):
    lo, hi = min(x, y), max(x, y)
    exact = Decimal(gap_text(lo, hi))
    # Decimals compare exactly; the difference itself is formed with fractions of integers.
    assert exact.as_integer_ratio()[1] >= 1
    p, q = exact.as_integer_ratio()
    (a, b), (c, d) = hi.as_integer_ratio(), lo.as_integer_ratio()
    assert p * b * d >= (a * d - c * b) * q


@given(finite, st.integers(0, 12))
def test_fixed_decimals_are_rounded_to_their_side(value, decimals):
    assert Decimal(rounded_down(value, decimals)) <= Decimal(value) <= Decimal(rounded_up(value, decimals))


@pytest.mark.parametrize(
    ("lo", "hi", "texts"),
    [
        (0.0, 0.0, ("0", "0")),
        (0.0890117468, 0.0890117515, ("0.08901174", "0.08901176")),
        (1.6262165, 1.6262165, ("1.626216", "1.626217")),
        (0.0, 0.5, ("0", "0.5000000")),
        (0.25, math.inf, ("0.2500000", "∞")),
        (math.inf, math.inf, ("∞", "∞")),
        (0.0, math.inf, ("0", "∞")),
        (-math.inf, math.nan, ("-∞", "—")),
        (1.50000005e-9, 1.60000005e-9, ("1.500000e-9", "1.600001e-9")),
        (9.9999999, 9.9999999, ("9.999999", "10.000000")),
    ],
)
def test_examples(lo, hi, texts):
    assert bracket_text(lo, hi) == texts


def test_gaps():
    assert gap_text(0.25, 0.25) == "0"
    assert gap_text(0.0, 0.125) == "1.3e-1"
    assert gap_text(0.0, math.inf) == "∞"
    assert gap_text(math.inf, math.inf) == "—"


def test_nearest_shows_no_negative_zero():
    assert nearest(-1e-12, 6) == "0.000000"


def test_clean_disarms_terminal_commands():
    assert clean("a\x1b[2Jb\x07\u202ec\nd") == "a\ufffd[2Jb\ufffd\ufffdc\nd"
