"""The compiled kernels, made once before many workers want them: a cold start takes half a minute of processor time.

python -m tests.warm_up programs | networks     those of linear programs, or all others
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HALVES = ("programs", "networks")  # of about the same time


def compile_kernels() -> None:
    """In two processes at once; those that are in the cache cost next to nothing."""
    here = Path(__file__).parents[1]
    quiet = {"cwd": here, "stderr": subprocess.DEVNULL}  # what fails here fails again, and is told, where it is used
    begun = [subprocess.Popen([sys.executable, "-m", "tests.warm_up", half], **quiet) for half in HALVES]
    for process in begun:
        process.wait()


def _programs() -> None:
    import numpy as np

    from cpcal.solver.linear import Dense

    engine = Dense()
    engine.load(np.array([[1.0, 1.0], [-1.0, 0.5]]), np.array([1.0, 0.5]), -np.ones(2), np.ones(2))
    engine.minimize(np.array([-1.0, -1.0]))


def _networks() -> None:
    import cpcal
    from cpcal.solver.network.rows import Rows

    net = cpcal.Network()
    x = net.variable("x", 2, ([0.5, 0.5], [2.0, 2.0]))
    net.add((cpcal.norm(x) - x[0]).within((0.5, 1.0)))
    net.contract(contractors=("hc4",))
    Rows(net).linearize(net.domain.mid)


if __name__ == "__main__":
    {"programs": _programs, "networks": _networks}[sys.argv[1]]()
