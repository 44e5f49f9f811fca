"""Interval kernels: 3,000 operand pairs each against arb, and the same results as plain Python."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.kernel_soundness import KERNELS, swept
from cpcal.solver import compiled
from cpcal.solver.interval.kernels import div, factor, mul

PLAIN = """
import cpcal, numpy as np, sys
assert "numba" not in sys.modules
net = cpcal.Network()
x = net.variable("x", 2, (-3.0, 3.1))
net.add([x[0] ** 2 + x[1] ** 2 == 4, np.exp(x[0]) == x[1] + 1])
paving = net.solve(contractors=["hc4", "newton"])
print([(s.verdict.name, s.box.lo.tolist(), s.box.hi.tolist()) for s in paving.solutions], paving.nodes)
assert ("numba" in sys.modules) == (sys.argv[1] == "compiled")
"""


@pytest.mark.parametrize("name", KERNELS)
def test_three_thousand_operand_pairs_are_enclosed(name: str) -> None:
    compared, wrong = swept(name, 3_000, seed=3)
    assert wrong is None
    assert compared > 600


# all with ends from -2 to 2, so that zero is in them, at their ends, and on both sides
SMALL = list(itertools.combinations_with_replacement(range(-2, 3), 2))


def whole(*intervals: tuple[int, int]) -> itertools.product[tuple[int, ...]]:
    """The points of whole numbers."""
    return itertools.product(*(range(lo, hi + 1) for lo, hi in intervals))


def test_no_product_or_quotient_of_small_whole_numbers_is_lost() -> None:
    for x, y in itertools.product(SMALL, repeat=2):
        bounds = (float(x[0]), float(x[1])), (float(y[0]), float(y[1]))
        product, quotient = mul(*bounds), div(*bounds)
        for a, b in whole(x, y):
            assert product[0] <= a * b <= product[1], (x, y, a, b)
            assert b == 0 or quotient[0] <= a / b <= quotient[1], (x, y, a, b)


def test_no_factor_among_small_whole_numbers_is_lost() -> None:
    for z, y, x in itertools.product(SMALL, repeat=3):
        low, high = factor(*(tuple(map(float, bounds)) for bounds in (z, y, x)))
        for a, b in whole(x, y):
            assert low <= a <= high or not z[0] <= a * b <= z[1], (z, y, x, a, b)


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
