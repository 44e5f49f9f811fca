"""Does the memory of a long search stay flat, and does a limit of memory end one with what is proved?

    python -m benchmarks.soak [--minutes 20] [--in-memory 20000] [--memory-limit MB] [--certificate]

A minimum in six dimensions is sought by hc4 alone, best first, so that hundreds of thousands of boxes wait; more than
`--in-memory` of them do so on disk. Four times a minute the memory of the process is printed with the bracket. At the
end: how much it grew over the second half of the time, in MB an hour.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import cpcal
from cpcal.execution.memory import resident_bytes
from cpcal.execution.stopping import within_memory
from cpcal.solver.optimize import Bracket
from cpcal.solver.search import frontier

_EVERY = 15.0  # seconds


def problem() -> tuple[cpcal.Network, cpcal.Expr]:
    """Many local minima, and boxes that interval arithmetic alone hardly closes."""
    net = cpcal.Network()
    x, t = net.variable("x", shape=6, domain=(-3, 3)), net.variable("t", domain=(-1000, 1000))
    total = sum((x[k] * x[k + 1] - 0.3 * k) ** 2 + 0.1 * x[k] for k in range(5))
    net.add(total + x[5] * x[0] * x[2] <= t)
    return net, t


class Curve:
    """Memory over time, printed now and then."""

    def __init__(self) -> None:
        self.began = self.last = time.monotonic()
        self.seen: list[tuple[float, float]] = []

    def __call__(self, bracket: Bracket) -> None:
        now = time.monotonic()
        if now - self.last < _EVERY:
            return
        self.last = now
        self.seen.append((now - self.began, resident_bytes() / 1e6))
        spent, memory = self.seen[-1]
        said = f"{bracket.nodes:,} boxes, {bracket.pending:,} wait, [{bracket.lo:.4g}, {bracket.hi:.4g}]"
        print(f"{spent:6.0f} s  {memory:7.1f} MB  {said}", flush=True)

    def growth(self) -> float:
        """MB an hour, of the second half."""
        half = np.array(self.seen[len(self.seen) // 2 :])
        if len(half) < 2:
            return float("nan")
        return float(3600.0 * np.polyfit(half[:, 0], half[:, 1], 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--in-memory", type=int, default=20_000)
    parser.add_argument("--memory-limit", type=int, default=1000)
    parser.add_argument("--certificate", action="store_true")
    given = parser.parse_args()
    frontier.IN_MEMORY = given.in_memory
    net, t = problem()
    curve = Curve()
    with tempfile.TemporaryDirectory() as folder, within_memory(given.memory_limit * 10**6):
        found = net.minimize(
            t,
            contractors=["hc4", "lifted"] if given.certificate else ["hc4"],
            limits=cpcal.Limits(seconds=60.0 * given.minutes, gap=1e-12),
            progress=curve,
            certificate=Path(folder) / "minimum.cert.jsonl" if given.certificate else None,
        )
    print(f"{found.status} {found.nodes:,} boxes, {found.pending:,} pending, [{found.lo:.6g}, {found.hi:.6g}]")
    print(f"memory of the second half grew by {curve.growth():.1f} MB an hour; limit {given.memory_limit} MB")


if __name__ == "__main__":
    main()
