"""Classic systems of equations, from their published definitions: `python -m benchmarks.classic`.

Caprasse, cyclohexane: COPRIN's collection of the 2000s; Broyden's banded function: More, Garbow and Hillstrom (1981),
number 31. Printed are the proved solutions beside the literature's count, nodes, and processor time after one run that
compiles and loads.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import cpcal
from cpcal.solver.contract import Verdict


@dataclass(frozen=True)
class Classic:
    """A system, and how many real solutions its domain holds."""

    network: Callable[[], cpcal.Network]
    solutions: int


def caprasse() -> cpcal.Network:
    net = cpcal.Network("caprasse")
    x, y, z, t = (net.variable(name, domain=(-10, 10)) for name in "xyzt")
    net.add(y**2 * z + 2 * x * y * t - 2 * x - z == 0)
    net.add(
        -(x**3) * z + 4 * x * y**2 * z + 4 * x**2 * y * t + 2 * y**3 * t + 4 * x**2 - 10 * y**2 + 4 * x * z - 10 * y * t
        == -2
    )
    net.add(2 * y * z * t + x * t**2 - x - 2 * z == 0)
    net.add(
        -x * z**3 + 4 * y * z**2 * t + 4 * x * z * t**2 + 2 * y * t**3 + 4 * x * z + 4 * z**2 - 10 * y * t - 10 * t**2
        == -2
    )
    return net


def cyclohexane() -> cpcal.Network:
    net = cpcal.Network("cyclohexane")
    x, y, z = (net.variable(name, domain=(-1e5, 1e5)) for name in "xyz")
    for a, b in ((y, z), (x, y), (z, x)):
        net.add(a**2 * (1 + b**2) + b * (b - 24 * a) == -13)
    return net


def broyden(n: int = 50) -> cpcal.Network:
    """On [-1, 1]: on [-100, 101] neither hc4 nor newton sees enough, and 2 minutes are not enough."""
    net = cpcal.Network(f"broyden {n}")
    x = net.variable("x", n, (-1, 1))
    for i in range(n):
        row = x[i] * (2 + 5 * x[i] ** 2) + 1
        for j in range(max(0, i - 5), min(n, i + 2)):
            if j != i:
                row = row - x[j] * (1 + x[j])
        net.add(row == 0)
    return net


CLASSICS = {
    "caprasse": Classic(caprasse, 18),
    "cyclohexane": Classic(cyclohexane, 16),
    "broyden 50": Classic(broyden, 1),
}


def main() -> None:
    cpcal.Network.solve(cyclohexane(), contractors=["hc4", "newton"], width=1e-6)
    print("system         proved (literature)   nodes   seconds   microseconds a node")
    for name, classic in CLASSICS.items():
        net, began = classic.network(), time.process_time()
        paving = net.solve(contractors=["hc4", "newton"], width=1e-6, limits=cpcal.Limits(seconds=120))
        seconds = time.process_time() - began
        proved = sum(s.verdict is Verdict.PROVED for s in paving.solutions)
        each = 1e6 * seconds / max(paving.nodes, 1)
        count = f"{proved} of {len(paving.solutions)} boxes ({classic.solutions})"
        print(f"{name:<14} {count:<20} {paving.nodes:>6} {seconds:>9.3f} {each:>9.1f}")


if __name__ == "__main__":
    main()
