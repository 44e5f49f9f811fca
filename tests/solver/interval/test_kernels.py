"""Interval kernels: 3,000 operand pairs each against arb, all small intervals exactly, and the same as plain Python."""

import itertools
import math
import os
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.kernel_soundness import KERNELS, swept
from cpcal.solver import compiled
from cpcal.solver.interval import IntervalArray, kernels
from cpcal.solver.interval.kernels import MAX, factor
from cpcal.solver.interval.operations import CODES, POWER, value

PLAIN = """
import cpcal, numpy as np, sys
assert "numba" not in sys.modules
net = cpcal.Network()
x = net.variable("x", 2, (-3.0, 3.1))
net.add([x[0] ** 2 + x[1] ** 2 == 4, np.exp(x[0]) == x[1] + 1, x[0] ** 3 <= 9])
paving = net.solve(contractors=["hc4", "newton"])
print([(s.verdict.name, s.box.lo.tolist(), s.box.hi.tolist()) for s in paving.solutions], paving.nodes)
print(cpcal.certify(cpcal.simulate(seed=1, joint_error=1.0, factor=0.0), legs=[1], support="none").legs[0].bracket)
assert ("numba" in sys.modules) == (sys.argv[1] == "compiled")
"""
Pair = tuple[float, float]


@pytest.mark.parametrize("name", KERNELS)
def test_three_thousand_operand_pairs_are_enclosed(name: str) -> None:
    compared, wrong = swept(name, 3_000, seed=3)
    assert wrong is None
    assert compared > 600


# directed rounding --------------------------------------------------------------------------------------------------

NASTY = [0.0, 5e-324, 1e-310, 2.0**-1022, 2.0**-1021, 1e-200, 1e-160, 0.5, 1.0, 3.0, 1e16, 1e160, 1e300, MAX]
NASTY += [math.nextafter(1.0, 0.0), math.nextafter(1.0, 2.0), math.nextafter(2.0**-1021, 1.0)]
FINITE = st.sampled_from(NASTY + [-v for v in NASTY]) | st.floats(allow_nan=False, allow_infinity=False)
ROUNDED: dict[str, Callable[[Fraction, Fraction], Fraction]] = {
    "sum": lambda a, b: a + b,
    "product": lambda a, b: a * b,
    "quotient": lambda a, b: a / b,
}


@pytest.mark.parametrize("name", ROUNDED)
@settings(max_examples=200, deadline=None)
@given(a=FINITE, b=FINITE)
def test_bounds_of_one_operation_are_within_four_floats_of_its_exact_result(name: str, a: float, b: float) -> None:
    if name == "quotient" and b == 0.0:
        return
    exact = ROUNDED[name](Fraction(a), Fraction(b))
    low, high = (float(getattr(kernels, f"{name}_{side}")(np.float64(a), np.float64(b))) for side in ("below", "above"))
    assert low < math.inf
    assert high > -math.inf
    assert low == -math.inf or Fraction(low) <= exact
    assert high == math.inf or Fraction(high) >= exact
    assert reaches(moved(low, 4), exact)
    assert reaches(-moved(high, -4), -exact)


def moved(bound: float, floats: int) -> float:
    """The float so many places above (below if negative)."""
    for _ in range(abs(floats)):
        bound = math.nextafter(bound, math.copysign(math.inf, floats))
    return bound


def reaches(bound: float, exact: Fraction) -> bool:
    """Whether a float is at least an exact number, or the largest float, where that is beyond all."""
    return bound == math.inf or Fraction(bound) >= min(exact, Fraction(MAX))


@settings(max_examples=100, deadline=None)
@given(a=FINITE, n=st.sampled_from([2, 3, 17]))
def test_roots_lie_between_their_bounds_and_these_are_close(a: float, n: int) -> None:
    low, high = map(float, kernels.root((np.float64(abs(a)), np.float64(abs(a))), n))
    assert Fraction(low) ** n <= abs(Fraction(a)) <= Fraction(high) ** n
    assert high - low <= 12 * math.ulp(high)


# operations ---------------------------------------------------------------------------------------------------------

# with ends from -2 to 2 and beyond all bounds, so that zero is in them, at their ends, and on both sides
SMALL: list[Pair] = [
    (float(lo), float(hi))
    for lo, hi in itertools.combinations_with_replacement((-math.inf, -2, -1, 0, 1, 2, math.inf), 2)
    if lo < math.inf and hi > -math.inf
]
EMPTY = (math.nan, math.nan)
BINARY: dict[str, Callable[[Fraction, Fraction], Fraction]] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "div": lambda a, b: a / b,
    "min": min, "max": max,
}  # fmt: skip
UNARY: dict[str, Callable[[Fraction], Any]] = {
    "neg": lambda a: -a,
    "abs": abs,
    "sqr": lambda a: a * a,
    "sqrt": lambda a: math.sqrt(a),
}


def points(x: Pair) -> list[Fraction]:
    """Whole numbers and halves, as far as 5."""
    return [Fraction(k, 2) for k in range(-10, 11) if x[0] <= k / 2 <= x[1]]


def holds_closely(found: Pair, values: list[Any], *, whole: bool) -> None:
    """All values lie in the interval; `whole`: its ends are the extreme ones, but for rounding."""
    low, high = found
    assert math.isnan(low) == math.isnan(high) == (not values)
    if values:
        assert low - 1e-15 <= min(values)
        assert max(values) <= high + 1e-15
        assert not whole or (low, high) == pytest.approx((float(min(values)), float(max(values))), rel=1e-14)


@pytest.mark.parametrize("name", BINARY)
def test_operations_of_two_arguments_lose_and_add_nothing(name: str) -> None:
    for x, y in itertools.product([*SMALL, EMPTY], repeat=2):
        pairs = itertools.product(points(x), points(y))
        values = [BINARY[name](a, b) for a, b in pairs if name != "div" or b]
        bounded = all(map(math.isfinite, (*x, *y))) and not (name == "div" and y[0] <= 0.0 <= y[1])
        holds_closely(value(CODES[name], 0, x, y), values, whole=bounded)


@pytest.mark.parametrize("name", [*UNARY, *range(-3, 5)])
def test_operations_of_one_argument_lose_and_add_nothing(name: str | int) -> None:
    for x in [*SMALL, EMPTY]:
        if isinstance(name, str):
            found = value(CODES[name], 0, x, x)
            values = [UNARY[name](a) for a in points(x) if name != "sqrt" or a >= 0]
        else:
            found = value(POWER, name, x, x)
            values = [a**name for a in points(x) if a or name >= 0]
        bounded = all(map(math.isfinite, x)) and (isinstance(name, str) or name >= 0 or not x[0] <= 0.0 <= x[1])
        holds_closely(found, values, whole=bounded)


def test_no_factor_among_small_whole_numbers_is_lost() -> None:
    some = [x for x in SMALL if all(map(math.isfinite, x))]
    for z, y, x in itertools.product(some, repeat=3):
        low, high = factor(z, y, x)
        for a, b in itertools.product(*(range(int(lo), int(hi) + 1) for lo, hi in (x, y))):
            assert low <= a <= high or not z[0] <= a * b <= z[1], (z, y, x, a, b)


def test_operands_broadcast_and_may_have_no_dimension() -> None:
    column = IntervalArray(np.array([[1.0], [3.0]]), np.array([[2.0], [4.0]]))
    row, scalar = IntervalArray.point(np.array([5.0, -1.0, 0.0])), IntervalArray.point(2.0)
    difference = column - row
    assert difference.shape == (2, 3)
    assert difference[1, 0].lo == pytest.approx(-2.0)
    assert difference[1, 0].hi == pytest.approx(-1.0)
    assert [(scalar * scalar).shape, (row / scalar).shape, scalar.apply(POWER, n=-3).shape] == [(), (3,), ()]


def test_compiled_code_and_plain_python_give_the_same_solutions_to_the_last_bit() -> None:
    root = str(Path(compiled.__file__).parents[2])
    said = []
    for mode, disabled in (("compiled", "0"), ("plain", "1")):
        environment = {**os.environ, "PYTHONPATH": root, "NUMBA_DISABLE_JIT": disabled}
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", PLAIN, mode],
            env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        said.append(done.stdout)
    assert said[0] == said[1]
    assert "PROVED" in said[0]
