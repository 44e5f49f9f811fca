"""How much sooner two workers are done than one: a paving, many campaigns.

    python -m benchmarks.speedup [--workers 2] [--campaigns 200] [--repeats 3] [--only paving campaigns]

Each is done with one process and with workers, in turns, so that other work on the machine slows both; ratios are of
medians of wall time, and mean something on an idle machine only: the load is printed. Answers and certificates are
compared, too. Images: `python -m benchmarks.throughput --workers 1 2`.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cpcal
from cpcal.cli.many_campaigns import CampaignWork, certified_all
from cpcal.cli.talk import Talk
from cpcal.execution.executors import executor_for


def paving(workers: int) -> Any:
    """A set in three dimensions, with boxes inside."""
    net = cpcal.Network()
    y = net.variable("y", shape=3, domain=(-2, 2))
    net.add((y[0] * y[0] + y[1] * y[1]).within((1, 2)))
    net.add((y[1] * y[2] + cpcal.sin(y[0])).within((0.1, 0.5)))
    found = net.solve(width=0.08, inner=True, workers=None if workers == 1 else workers)
    return found.nodes, found.inside, [s.box for s in found.solutions]


def campaigns(count: int) -> Callable[[int], Any]:
    """Many small ones, certified with ranges, projections and pages."""
    keep = tempfile.TemporaryDirectory()
    folder = Path(keep.name)
    folders = [folder / f"campaign{seed}" for seed in range(count)]
    for seed, path in enumerate(folders):
        cpcal.save_campaign(cpcal.simulate(seed=seed, joint_error=1.0, factor=0.0), path)

    def certified(workers: int) -> Any:
        assert keep
        runs = folder / f"runs{workers}"
        with executor_for(workers) as place:
            certified_all(folders, runs, CampaignWork({}, checker=True), place, talk=Talk(quiet=True))
        return {path.relative_to(runs): path.read_bytes() for path in sorted(runs.rglob("*.cert.jsonl"))}

    return certified


def measured(name: str, work: Callable[[int], Any], workers: int, repeats: int) -> None:
    times: dict[int, list[float]] = {1: [], workers: []}
    answers = []
    for _ in range(repeats):
        for count, spent in times.items():
            began = time.monotonic()
            answers.append(work(count))
            spent.append(time.monotonic() - began)
    same = all(answer == answers[0] for answer in answers)
    alone, together = statistics.median(times[1]), statistics.median(times[workers])
    load = os.getloadavg()[0]
    said = f"{alone:.2f} s with 1, {together:.2f} s with {workers}: {alone / together:.2f} times as fast"
    print(f"{name}: {said}; the same answers: {same}; load {load:.1f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", nargs="+", default=["paving", "campaigns"])
    given = parser.parse_args()
    for name in given.only:
        work = campaigns(given.campaigns) if name == "campaigns" else paving
        measured(name, work, given.workers, given.repeats)


if __name__ == "__main__":
    main()
