"""Classic systems of equations, from their published definitions: `python -m benchmarks.classic [--codac]`.

Caprasse, cyclohexane: COPRIN's collection of the 2000s; Broyden's banded function: More, Garbow and Hillstrom (1981),
number 31, here on [-1, 1]: on [-100, 101] neither hc4 nor newton sees enough, and 2 minutes are not enough. Printed are
the proved solutions beside the literature's count, nodes, and processor time after one run that compiles and loads.
codac's contractors, one for each equation with its centred form, prune in a search of its own here (depth first, the
widest side halved, to the same width); they prove no solution.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import cpcal
from cpcal.solver.contract import Verdict

_WIDTH = 1e-6
_SECONDS = 120.0
Equations = Callable[[Sequence[Any]], list[Any]]  # what is zero, of unknowns of any kind


@dataclass(frozen=True)
class Classic:
    """A system in `size` unknowns in [-half, half], and how many real solutions it has there."""

    equations: Equations
    size: int
    half: float
    solutions: int

    def network(self) -> cpcal.Network:
        net = cpcal.Network()
        x = net.variable("x", self.size, (-self.half, self.half))
        for body in self.equations([x[i] for i in range(self.size)]):
            net.add(body == 0)
        return net


def caprasse(v: Sequence[Any]) -> list[Any]:
    x, y, z, t = v
    return [
        y**2 * z + 2 * x * y * t - 2 * x - z,
        -(x**3) * z
        + 4 * x * y**2 * z
        + 4 * x**2 * y * t
        + 2 * y**3 * t
        + 4 * x**2
        - 10 * y**2
        + 4 * x * z
        - 10 * y * t
        + 2,
        2 * y * z * t + x * t**2 - x - 2 * z,
        -x * z**3
        + 4 * y * z**2 * t
        + 4 * x * z * t**2
        + 2 * y * t**3
        + 4 * x * z
        + 4 * z**2
        - 10 * y * t
        - 10 * t**2
        + 2,
    ]


def cyclohexane(v: Sequence[Any]) -> list[Any]:
    x, y, z = v
    return [a**2 * (1 + b**2) + b * (b - 24 * a) + 13 for a, b in ((y, z), (x, y), (z, x))]


def broyden(x: Sequence[Any]) -> list[Any]:
    n, out = len(x), []
    for i in range(n):
        row = x[i] * (2 + 5 * x[i] ** 2) + 1
        for j in range(max(0, i - 5), min(n, i + 2)):
            if j != i:
                row = row - x[j] * (1 + x[j])
        out.append(row)
    return out


CLASSICS = {
    "caprasse": Classic(caprasse, 4, 10.0, 18),
    "cyclohexane": Classic(cyclohexane, 3, 1e5, 16),
    "broyden 50": Classic(broyden, 50, 1.0, 1),
}


def ours(name: str, seconds: float) -> tuple[str, int, float]:
    """What was found, nodes, and processor seconds."""
    classic = CLASSICS[name]
    net, began = classic.network(), time.process_time()
    limits = cpcal.Limits(seconds=seconds)
    paving = net.solve(contractors=["hc4", "newton"], width=_WIDTH, limits=limits)
    proved = sum(s.verdict is Verdict.PROVED for s in paving.solutions)
    count = f"{proved} of {len(paving.solutions)} boxes ({classic.solutions})"
    return count, paving.nodes, time.process_time() - began


def _elsewhere(name: str, seconds: float) -> tuple[str, int, float]:
    """codac in a process of its own: it switches the processor's rounding, which cpcal refuses to compute with."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(codacs, name, seconds).result()


def codacs(name: str, seconds: float) -> tuple[str, int, float]:
    """The same by codac's contractors, in turn until a box shrinks by less than a tenth."""
    import codac

    classic = CLASSICS[name]
    x = codac.VectorVar(classic.size)
    bodies = classic.equations([x[i] for i in range(classic.size)])
    contractors = [codac.CtcInverse(codac.AnalyticFunction([x], body), codac.Interval(0.0)) for body in bodies]
    began, nodes, left = time.process_time(), 0, 0
    pending = [codac.IntervalVector([[-classic.half, classic.half]] * classic.size)]
    while pending and time.process_time() - began < seconds:
        box, nodes = pending.pop(), nodes + 1
        before = float("inf")
        while not box.is_empty() and box.max_diam() < 0.9 * before:
            before = box.max_diam()
            for contractor in contractors:
                contractor.contract(box)
        if box.is_empty():
            continue
        if box.max_diam() < _WIDTH:
            left += 1
        else:
            pending += box.bisect(box.max_diam_index())
    said = f"{left} boxes are left" if not pending else f"{len(pending)} pending, {left} left"
    return said, nodes, time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--codac", action="store_true", help="beside codac's contractors")
    parser.add_argument("--seconds", type=float, default=_SECONDS, help="of each search")
    asked = parser.parse_args()
    methods = [("cpcal", ours), *([("codac", _elsewhere)] if asked.codac else [])]
    ours("cyclohexane", asked.seconds)
    print("system         method  proved (literature)    nodes   seconds   microseconds a node")
    for name in CLASSICS:
        for method, search in methods:
            count, nodes, seconds = search(name, asked.seconds)
            each = 1e6 * seconds / max(nodes, 1)
            print(f"{name:<14} {method:<7} {count:<21} {nodes:>6} {seconds:>9.3f} {each:>9.1f}", flush=True)


if __name__ == "__main__":
    main()
