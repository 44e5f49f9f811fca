"""Does a pool of processes always end? Hundreds of them, each with a fault at a random moment, beside two busy loops.

    python -m benchmarks.faults [--count 500] [--seed 1] [--load 2] [--limit 60] [--patience 2]
        [--kinds NAME...]

Each pool is given tasks and meets one of these faults between its first moment and its last: nothing; a task that
cannot be pickled; Ctrl-C (a real signal, once, or twice); a worker that is killed, or stopped; the fork server killed;
the resource tracker killed; a disk on which no byte can be written any more. Then it is shut down. One that takes
longer than `--limit` seconds ends the script with the stack of every thread; a worker has `--patience` seconds to end,
elsewhere ten. Counted are tasks without an outcome although nothing asked to stop, and workers that are left. Linux
only.
"""

from __future__ import annotations

import argparse
import faulthandler
import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import forkserver, resource_tracker
from typing import Any

from cpcal.solver.execution import executors
from cpcal.solver.execution.executors import executor_for, outcomes
from cpcal.solver.execution.stopping import asked, heard

_TASKS = 12


def short(number: int) -> int:
    """A task that looks whether it is to stop, and writes a little."""
    until = time.monotonic() + 0.02
    while time.monotonic() < until and not asked():
        pass
    with suppress(OSError), tempfile.TemporaryFile() as file:
        file.write(bytes(number + 1))
    return number


def to_a_worker(number: int) -> Callable[[], None]:
    def send() -> None:
        for child in multiprocessing.active_children()[:1]:
            if child.pid is not None:
                os.kill(child.pid, number)

    return send


def to_us(*numbers: int) -> Callable[[], None]:
    def send() -> None:
        for number in numbers:
            os.kill(os.getpid(), number)
            time.sleep(0.05)

    return send


def to_helper(helper: Any, name: str) -> Callable[[], None]:
    def send() -> None:
        if getattr(helper, name) is not None:
            os.kill(getattr(helper, name), signal.SIGKILL)

    return send


def full() -> None:
    """No file of this process may grow any more, nor of the workers that it begins."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))


FAULTS: dict[str, Callable[[], None]] = {
    "none": lambda: None,
    "unpicklable": lambda: None,
    "Ctrl-C": to_us(signal.SIGINT),
    "Ctrl-C twice": to_us(signal.SIGINT, signal.SIGINT),
    "SIGTERM": to_us(signal.SIGTERM),
    "worker killed": to_a_worker(signal.SIGKILL),
    "worker stopped": to_a_worker(signal.SIGSTOP),
    "fork server killed": to_helper(forkserver._forkserver, "_forkserver_pid"),
    "tracker killed": to_helper(resource_tracker._resource_tracker, "_pid"),
    "disk full": full,
}


def one(kind: str, after: float) -> tuple[float, list[str]]:
    """Seconds that the shutdown took, and what was wrong."""
    tasks: list[Any] = list(range(_TASKS))
    if kind == "unpicklable":
        tasks[5:5] = [threading.Lock()]
    began, done, stopped = time.monotonic(), 0, False
    timer = threading.Timer(after, FAULTS[kind])
    try:
        with heard(terminate=True):
            try:
                with executor_for(workers=2) as (pool, most):
                    timer.start()
                    for _ in outcomes(pool, most, short, tasks):
                        done += 1
                        if kind == "worker stopped" and time.monotonic() > began + after:
                            break  # it would wait for that one for ever, as it may
                    timer.cancel()
                    began = time.monotonic()
            finally:
                timer.join()
                stopped = asked() is not None
    except KeyboardInterrupt:
        stopped = True
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    took = time.monotonic() - began
    wrong = []
    if done != len(tasks) and not stopped and kind != "worker stopped":
        wrong.append(f"{len(tasks) - done} tasks without an outcome")
    if any(child.is_alive() for child in multiprocessing.active_children()):
        wrong.append("workers are left")
    return took, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--load", type=int, default=2)
    parser.add_argument("--limit", type=float, default=60.0)
    parser.add_argument("--patience", type=float, default=2.0)
    parser.add_argument("--kinds", nargs="+", default=list(FAULTS), choices=list(FAULTS))
    given = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    executors.PATIENCE = given.patience
    moments = random.Random(given.seed)
    wrong: Counter[str] = Counter()
    slowest = dict.fromkeys(given.kinds, 0.0)
    load = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(given.load)]
    try:
        for k in range(given.count):
            kind = given.kinds[k % len(given.kinds)]
            faulthandler.dump_traceback_later(given.limit, exit=True)
            took, found = one(kind, moments.uniform(0.0, 0.5))
            faulthandler.cancel_dump_traceback_later()
            slowest[kind] = max(slowest[kind], took)
            wrong.update(f"{kind}: {what}" for what in found)
    finally:
        for process in load:
            process.kill()
    for kind, seconds in slowest.items():
        print(f"{kind:20} slowest shutdown {seconds:6.2f} s")
    print(f"{given.count} pools ended; wrong: {dict(wrong) or 'nothing'}")
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
