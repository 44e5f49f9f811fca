"""Intervals print outward: what is printed holds what is meant."""

from __future__ import annotations

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpcal.solver.interval import Interval

finite = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)


@given(finite, finite, st.integers(0, 12))
def test_decimals_hold_the_interval(a: float, b: float, decimals: int) -> None:
    lo, hi = min(a, b), max(a, b)
    text = f"{Interval(lo, hi):.{decimals}f}"
    printed_lo, printed_hi = (Decimal(part) for part in text.strip("[]").split(", "))
    unit = Decimal(1).scaleb(-decimals)
    assert printed_lo <= Decimal(lo) < printed_lo + unit
    assert printed_hi - unit < Decimal(hi) <= printed_hi


def test_formats() -> None:
    assert f"{Interval(1.26, 2.24):.1f}" == "[1.2, 2.3]"
    assert f"{Interval(0.0, math.inf):.2f}" == "[0.00, inf]"
    assert f"{Interval(1.0, 2.0)}" == str(Interval(1.0, 2.0))
    assert "empty" in f"{Interval.empty():.3f}"
    with pytest.raises(ValueError, match=re.escape("'.6f'")):
        f"{Interval(1.0, 2.0):>10}"
