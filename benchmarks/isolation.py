"""A run in a process of its own, which is killed when it overruns its limit."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import resource
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from benchmarks.records import FAILED, TIMEOUT, Run

_SETUP = 300.0  # seconds at most, for imports and for making the problem
_OVERRAN, _UNREADY = "overran its limit", "its set-up took too long"
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")}


@dataclass(frozen=True)
class Job:
    """What a worker is told. `data` is the folder of the real measurements."""

    problem: str
    task: str
    method: str
    limit: float
    eps: float | None = None
    data: str | None = None


def perform(job: Job, setup: float = _SETUP) -> Run:
    """The run, whatever happens in it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as errors:
        process = _started(job, errors)
        said, reader = _lines(process)
        try:
            end = _followed(job, said, setup)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            reader.join(timeout=5.0)
        if isinstance(end, Run):
            return end
        errors.seek(0)
        last = (errors.read().strip().splitlines() or ["no message"])[-1][:300]
    name = (job.problem, job.task, job.method)
    if end == _OVERRAN:
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return Run(*name, TIMEOUT, job.limit, used, note="killed; CPU time includes set-up")
    return Run(*name, FAILED, note=end if end == _UNREADY else f"ended with {process.returncode}: {last}")


def _started(job: Job, errors: IO[str]) -> subprocess.Popen[str]:
    root = str(Path(__file__).parents[1])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": path},
        start_new_session=True,
    )
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(json.dumps(asdict(job)))
        process.stdin.close()
    return process


def _lines(process: subprocess.Popen[str]) -> tuple[queue.Queue[Any], threading.Thread]:
    """What the worker says, as it says it; None at the end. And who listens."""
    said: queue.Queue[Any] = queue.Queue()

    def read() -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                said.put(json.loads(line))
        said.put(None)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    return said, reader


def _followed(job: Job, said: queue.Queue[Any], setup: float) -> Run | str:
    """The worker's run, or in which way it came to no end."""
    patience, late = setup, _UNREADY
    while True:
        try:
            line = said.get(timeout=patience)
        except queue.Empty:
            return late
        if line is None:
            return "ended"
        if line != "ready":
            return Run(**line)
        patience, late = job.limit + max(2.0, 0.1 * job.limit), _OVERRAN
