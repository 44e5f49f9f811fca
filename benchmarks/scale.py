"""Where the road saturates: recorded task times, replayed on 1 to 1,000 workers with the coordinator's measured costs.

    python -m benchmarks.scale [--campaigns 8] [--tasks 2000] [--workers 1 2 4 10 30 100 300 1000] [--log run.jsonl]

Some campaigns are certified here, one after the other, as `cpcal certify DIR...` does; the time of each is a task's.
Then the coordinator's share is measured: a task as bytes, its answer read from bytes, its run written and put in its
place. The replay draws `--tasks` of the recorded times (with --log: those of a run) for a coordinator that
does one thing at a time, gives out as many tasks as `executors` does, and pays its share before and after each.
Nothing is said of the network. Processor times, so that a busy machine matters little; what waits for a disk is in
wall time.
"""

from __future__ import annotations

import argparse
import heapq
import json
import pickle
import random
import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cpcal
from cpcal.cli.many_campaigns import CampaignTask, CampaignWork, put
from cpcal.execution.executors import at_a_time


@dataclass(frozen=True)
class Costs:
    """Seconds of the coordinator for each task: to give it out, and to take and write its answer."""

    send: float
    receive: float


def measured(count: int) -> tuple[list[float], Costs]:
    """Times of tasks, and the coordinator's costs."""
    work, times, sends, receives = CampaignWork({}, checker=True), [], [], []
    with tempfile.TemporaryDirectory() as name:
        for seed in range(count + 1):
            campaign = cpcal.simulate(seed=seed, joint_error=1.0, factor=0.0)
            began = time.process_time()
            content = pickle.dumps((work, CampaignTask(str(seed), campaign)))
            sends.append(time.process_time() - began)
            pickle.loads(content)
            began = time.process_time()
            found = work(CampaignTask(str(seed), campaign))
            times.append(time.process_time() - began)
            content = pickle.dumps(found)
            began = time.perf_counter()
            put(Path(name) / str(seed), campaign, pickle.loads(content))
            receives.append(time.perf_counter() - began)
    # the first one compiles
    return times[1:], Costs(statistics.median(sends[1:]), statistics.median(receives[1:]))


def recorded(log: Path) -> list[float]:
    """Times of the campaigns of a run."""
    lines = map(json.loads, log.read_text(encoding="utf-8").splitlines())
    return [float(line["seconds"]) for line in lines if line["event"] == "campaign"]


def replayed(tasks: Sequence[float], workers: int, costs: Costs) -> float:
    """Seconds until the last answer is written."""
    now, free, running = 0.0, [0.0] * workers, list[float]()
    most, waiting = at_a_time(workers), list(tasks)[::-1]
    while waiting or running:
        while waiting and len(running) < most:
            now += costs.send
            begun = max(heapq.heappop(free), now)
            done = begun + waiting.pop()
            heapq.heappush(free, done)
            heapq.heappush(running, done)
        now = max(now, heapq.heappop(running)) + costs.receive
    return now


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=8)
    parser.add_argument("--tasks", type=int, default=2000)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4, 10, 30, 100, 300, 1000])
    parser.add_argument("--log", type=Path)
    given = parser.parse_args()
    times, costs = measured(given.campaigns)
    times = recorded(given.log) if given.log else times
    print(f"{len(times)} tasks recorded: median {statistics.median(times):.2f} s, longest {max(times):.2f} s")
    print(
        f"coordinator: {1e3 * costs.send:.2f} ms to give out a task, {1e3 * costs.receive:.1f} ms to write its answer"
    )
    tasks = random.Random(1).choices(times, k=given.tasks)
    alone = sum(tasks)
    print(f"{given.tasks} tasks, {alone:.0f} s of work\n\nworkers  seconds  speed-up  efficiency")
    for workers in given.workers:
        took = replayed(tasks, workers, costs)
        print(f"{workers:7,}  {took:7.1f}  {alone / took:8.1f}  {alone / took / workers:9.0%}", flush=True)
    limit = statistics.mean(times) / (costs.send + costs.receive)
    print(f"\nno more than {limit:.0f} workers can be kept busy with such tasks")


if __name__ == "__main__":
    main()
