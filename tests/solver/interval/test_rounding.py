"""Directed rounding and interval arrays."""

import ctypes
import math
import platform
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cpcal
from cpcal.common.errors import RoundingError
from cpcal.solver.contract import Contraction
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.interval.kernels import check_rounding

MAX = 1.7976931348623157e308


BOUND = st.sampled_from([0.0, 5e-324, 1.0, -1.0, MAX, -MAX, math.inf, -math.inf]) | st.floats(allow_nan=False)


@settings(max_examples=100, deadline=None)
@given(a=BOUND, b=BOUND)
def test_mid_rad_and_mag_cover_the_interval(a: float, b: float) -> None:
    lo, hi = min(a, b), max(a, b)
    if lo == math.inf or hi == -math.inf:
        return
    x = IntervalArray(np.array([lo, math.nan]), np.array([hi, math.nan]))
    mid, rad = float(x.mid[0]), float(x.rad[0])
    assert lo <= mid <= hi
    assert math.isfinite(mid)
    assert x.mag[0] == max(abs(lo), abs(hi))
    if math.isfinite(lo) and math.isfinite(hi):
        assert Fraction(hi) - Fraction(mid) <= rad if rad < math.inf else True
        assert Fraction(mid) - Fraction(lo) <= rad if rad < math.inf else True
    else:
        assert rad == math.inf
    assert np.isnan(x.mid[1])
    assert np.isnan(x.rad[1])


MODES = {"x86_64": (0x400, 0x800, 0xC00), "aarch64": (0x800000, 0x400000, 0xC00000)}.get(platform.machine(), ())


@pytest.fixture
def rounding() -> Iterator[ctypes.CDLL]:
    """The C library, whose rounding mode is put right in the end."""
    library = ctypes.CDLL(None)
    yield library
    library.fesetround(0)


@pytest.mark.parametrize("mode", MODES)  # downward, upward, towards zero
def test_where_another_library_has_changed_the_rounding_no_bound_is_computed(mode: int, rounding: ctypes.CDLL) -> None:
    check_rounding()
    net = cpcal.Network()
    x = net.variable("x", domain=(0.0, 2.0))
    net.add(x * x == 2.0)
    rounding.fesetround(mode)
    with pytest.raises(RoundingError, match="process of its own"):
        net.solve()


@pytest.fixture
def environment() -> Iterator[ctypes.Array[ctypes.c_uint32]]:
    """The floating-point environment of a PC's processor, which is put right in the end; word 7 holds the switches."""
    library, words = ctypes.CDLL(None), (ctypes.c_uint32 * 16)()
    library.fegetenv(words)
    kept = bytes(words)
    yield words
    library.fesetenv(kept)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the bits are those of other processors")
@pytest.mark.parametrize("bit", [0x8000, 0x40])  # small results are zero; small operands are
def test_where_a_library_has_switched_small_numbers_off_no_bound_is_computed(bit, environment):
    """Compiled with -ffast-math, it does so when it is loaded: x = 1 was lost, and "no solution" called proved."""
    net = cpcal.Network()
    x = net.variable("x", domain=(0.5, 2.0))
    net.add((1e-160 * x * 1e-155).within((5e-316, 1.5e-315)))
    environment[7] |= bit
    ctypes.CDLL(None).fesetenv(environment)
    with pytest.raises(RoundingError, match="process of its own"):
        net.solve()


@pytest.mark.skipif(not MODES, reason="the numbers of the modes are those of other processors")
def test_a_plug_in_that_changes_it_ends_the_search(rounding: ctypes.CDLL) -> None:
    class Switching:
        gives_weights = False

        def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
            rounding.fesetround(MODES[1])
            return Contraction(box)

    net = cpcal.Network()
    x = net.variable("x", domain=(0.0, 2.0))
    net.add(x * x == 2.0)
    with pytest.raises(RoundingError, match="has changed how the processor rounds"):
        net.solve(contractors=[Switching(), "hc4"])
