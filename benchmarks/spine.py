"""Nodes, linear programs and seconds of the main job, and the share of the time that the programs take.

    python -m benchmarks.spine [--data ../shared/data] [--legs 1,5] [--repeat 3] [--json FILE]

Simulated DeltaLab campaigns with 64, 704 and 7,744 measurements (64 extremal poses, 1, 11 and 121 runs), readings
exact and uncertain, joint error 1 mm, box +-100 mm, gap 1e-6; with --data also the Hangprinter's cables. Medians over
repeated runs in one process; "seconds" is everything from the campaign in memory to the result, per leg.
"""

from __future__ import annotations

import argparse
import json
import platform
import runpy
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import cpcal
from cpcal.interfaces import LinearSolution
from cpcal.linear import Glop

SEED = 1
HANGPRINTER = Path(__file__).parents[1] / "docs" / "examples" / "hangprinter.py"


@dataclass(frozen=True)
class Line:
    """Medians over the repetitions; `lp_share` is the fraction of the time inside the linear engine."""

    case: str
    measurements: int
    nodes: int
    programs: int
    seconds: float
    lp_share: float
    eps_lo: float
    eps_hi: float


class LinearTime:
    """Adds up the time that GLOP takes, while it is entered as a context."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._original: Callable[..., LinearSolution] = Glop.minimize

    def __enter__(self) -> LinearTime:
        def timed(engine: Glop, objective: np.ndarray) -> LinearSolution:  # type: ignore[type-arg]
            began = time.perf_counter()
            try:
                return self._original(engine, objective)
            finally:
                self.seconds += time.perf_counter() - began

        Glop.minimize = timed  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        Glop.minimize = self._original  # type: ignore[method-assign]


Job = Callable[[], tuple[int, int, float, float]]  # nodes, programs, eps_lo, eps_hi


def measured(case: str, measurements: int, job: Job, repeat: int) -> Line:
    """Run a job several times."""
    times, shares = [], []
    for _ in range(repeat):
        with LinearTime() as linear:
            began = time.perf_counter()
            nodes, programs, lo, hi = job()
            times.append(time.perf_counter() - began)
            shares.append(linear.seconds / times[-1])
    return Line(case, measurements, nodes, programs, statistics.median(times), statistics.median(shares), lo, hi)


def leg_jobs(legs: list[int]) -> Iterator[tuple[str, int, Job]]:
    for factor in (0.0, 3.0):
        for runs in (1, 11, 121):
            campaign = cpcal.simulate(seed=SEED, joint_error=1.0, factor=factor, runs=runs)
            _ = campaign.sha256  # the digest of the files belongs to reading them
            for leg in legs:
                kind = "uncertain" if factor else "exact"
                yield f"leg {leg}, {kind} readings", len(campaign), _leg_job(campaign, leg)


def _leg_job(campaign: cpcal.Campaign, leg: int) -> Job:
    def job() -> tuple[int, int, float, float]:
        found = cpcal.certify(campaign, legs=[leg], delta=100.0).legs[0]
        return found.nodes, found.programs, found.eps_lo, found.eps_hi

    return job


def cable_jobs(data: Path) -> Iterator[tuple[str, int, Job]]:
    example = runpy.run_path(str(HANGPRINTER))
    cable_network = example["cable_network"]
    position, angle = example["load"](data / "hangprinter" / "samples.csv")
    for quadratic in (False, True):
        for k, cable in enumerate(example["CABLES"]):

            def job(k: int = k, quadratic: bool = quadratic) -> tuple[int, int, float, float]:
                net, eps = cable_network(position, angle[:, k], quadratic=quadratic)
                found = net.minimize(eps)
                return found.nodes, found.programs, found.lo, found.hi

            yield f"cable {cable}, {'quadratic' if quadratic else 'linear'} model", len(position), job


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the real measurements")
    parser.add_argument("--legs", default="1,5", help="legs to certify")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", type=Path, help="write the figures here too")
    options = parser.parse_args()
    print(f"cpcal {cpcal.__version__}, CPython {platform.python_version()}, {platform.machine()}, one process\n")
    print(f"{'case':31} {'N':>6} {'nodes':>5} {'LPs':>4} {'seconds':>8} {'in LPs':>6}  bracket (mm)")
    lines = []
    jobs = list(leg_jobs([int(leg) for leg in options.legs.split(",")]))
    for case, count, job in jobs + (list(cable_jobs(options.data)) if options.data else []):
        line = measured(case, count, job, options.repeat)
        lines.append(line)
        print(
            f"{line.case:31} {line.measurements:6} {line.nodes:5} {line.programs:4} {line.seconds:8.3f}"
            f" {line.lp_share:6.0%}  [{line.eps_lo:.7f}, {line.eps_hi:.7f}]",
            flush=True,
        )
    if options.json:
        options.json.write_text(json.dumps([asdict(line) for line in lines], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
