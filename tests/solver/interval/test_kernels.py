"""Interval kernels: 10,000 operand pairs each against arb, and the same results as plain Python."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.kernel_soundness import KERNELS, swept
from cpcal.solver import compiled

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
def test_ten_thousand_operand_pairs_are_enclosed(name: str) -> None:
    compared, wrong = swept(name, 10_000, seed=3)
    assert wrong is None
    assert compared > 2_000


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
