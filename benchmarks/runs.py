"""Runs of methods on tasks, each in a process of its own that is killed when it overruns, and the file of results.

A worker (`python -m benchmarks.methods`) reads a job on stdin and writes "ready", then its run, as lines of JSON on
stdout; what a peer prints goes to stderr. Only the task itself is timed. What does not succeed is a result, too.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
import queue
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from datetime import date
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any

FORMAT = "cpcal-benchmark/1"
ANSWERED, UNDECIDED, TIMEOUT, FAILED, SKIPPED = "answered", "undecided", "timeout", "failed", "skipped"
KINDS = {
    "minimise": "close eps* to the relative gap that is given",
    "refute": "prove that there is no solution at that share of eps*",
    "certify": "the whole answer about a leg, its support included, to the relative gap that is given",
    "prove": "the same, a certificate written and checked in exact arithmetic",
}
REFERENCE, MINIMISE = "lifted", "minimise-1e-06"  # brackets eps* where a task needs to know it
PACKAGES = ("cpcal", "numpy", "scipy", "numba", "python-flint", "codac", "pyscipopt", "gurobipy")
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")}
_SETUP, _REFERENCE_LIMIT = 300.0, 300.0  # seconds at most, for imports and the problem; for a bracket of eps*
NEARLY = 0.95  # who gives up this close to the limit gave up because of it
_OVERRAN, _UNREADY = "overran its limit", "its set-up took too long"

Key = tuple[str, str, str]  # problem, task, method
Entry = tuple[str, str, tuple[str, ...]]  # problem, task, methods


class Unsupported(Exception):
    """A method was asked what it cannot answer. The message says why; the run is skipped."""


@dataclass(frozen=True)
class Task:
    """`kind` is one of KINDS; `value` its number."""

    kind: str
    value: float

    @classmethod
    def named(cls, name: str) -> Task:
        kind, _, value = name.partition("-")
        if kind not in KINDS:
            raise ValueError(f"no task is called {name!r}; there are {', '.join(KINDS)}, each followed by -NUMBER")
        return cls(kind, float(value))


@dataclass(frozen=True)
class MethodAnswer:
    """What a method says: `answered` means that it claims to have done all of the task.

    `figures`: "lo" and "hi" of eps in mm, "nodes", "programs", "steps", where there are such.
    """

    answered: bool
    figures: dict[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Job:
    """What a worker is told. `data` is the folder of the real measurements."""

    problem: str
    task: str
    method: str
    limit: float
    eps: float | None = None
    data: str | None = None


@dataclass(frozen=True)
class Run:
    """`seconds` and `cpu` are of the task alone, without imports and without making the problem."""

    problem: str
    task: str
    method: str
    status: str
    seconds: float = math.nan
    cpu: float = math.nan
    figures: dict[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Results:
    """All runs of a session, and what they ran on."""

    suite: str
    date: str
    limit: float
    repeat: int
    machine: dict[str, str]
    runs: tuple[Run, ...]

    def medians(self) -> dict[Key, Run]:
        """For each (problem, task, method) the last run that did not succeed, else medians of times and figures."""
        groups: dict[Key, list[Run]] = {}
        for run in self.runs:
            groups.setdefault((run.problem, run.task, run.method), []).append(run)
        return {key: _median(runs) for key, runs in groups.items()}


def _median(runs: list[Run]) -> Run:
    if bad := [run for run in runs if run.status != ANSWERED]:
        return bad[-1]
    first = runs[0]
    shared = [name for name in first.figures if all(name in run.figures for run in runs)]
    figures = {name: statistics.median(run.figures[name] for run in runs) for name in shared}
    seconds, cpu = (statistics.median(values) for values in ([r.seconds for r in runs], [r.cpu for r in runs]))
    return replace(first, seconds=seconds, cpu=cpu, figures=figures)


# ----------------------------------------------------------------------------------------------------------------------
# The file: JSON knows no infinities and no NaN; the former are strings, the latter left out. Times to the microsecond.


def save(results: Results, path: Path) -> None:
    lines = json.dumps({"format": FORMAT, **asdict(replace(results, runs=()))}, indent=1)[: -len("[]\n}")]
    runs = ",\n  ".join(json.dumps(_compact(run), allow_nan=False) for run in results.runs)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{lines}[\n  {runs}\n ]\n}}\n", encoding="utf-8")


def _compact(run: Run) -> dict[str, Any]:
    figures = {k: v if math.isfinite(v) else str(v) for k, v in run.figures.items() if not math.isnan(v)}
    times = {k: round(v, 6) for k, v in (("seconds", run.seconds), ("cpu", run.cpu)) if not math.isnan(v)}
    named = {"problem": run.problem, "task": run.task, "method": run.method, "status": run.status}
    return named | times | {"figures": figures} | ({"note": run.note} if run.note else {})


def load(path: Path) -> Results:
    """Raises ValueError for a file that is no result file."""
    data = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(data, dict) or data.pop("format", None) != FORMAT:
        raise ValueError(f"{path} is not of format {FORMAT}")
    try:
        for run in data["runs"]:
            run["figures"] = {k: float(v) for k, v in run.get("figures", {}).items()}
        return Results(**{**data, "runs": tuple(Run(**run) for run in data["runs"])})
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} lacks or garbles a field: {error}") from None


def machine() -> dict[str, str]:
    """Processor, system, versions of what takes part, without names of hosts, users or folders."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    facts = {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
    }
    for package in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            facts[package] = version(package)
    return facts


# ----------------------------------------------------------------------------------------------------------------------
# A suite: repetitions interleaved, so that what slows the machine down slows all methods down alike.


def execute(
    name: str,
    entries: Iterable[Entry],
    *,
    limit: float,
    repeat: int,
    data: str | None = None,
    tell: Callable[[Run], None] = lambda run: None,
    keep: Callable[[Results], None] = lambda results: None,
) -> Results:
    """Every entry `repeat` times. A method that did not answer is not asked the same again.

    `tell` hears of every run, `keep` is given all that is known after each entry.
    """

    @cache
    def reference(problem: str) -> tuple[float, float] | None:
        run = perform(Job(problem, MINIMISE, REFERENCE, _REFERENCE_LIMIT, data=data))
        return (run.figures["lo"], run.figures["hi"]) if run.status == ANSWERED else None

    def asked(job: Job) -> Run:
        task = Task.named(job.task)
        if task.kind != "refute":
            return perform(job)
        if (known := reference(job.problem)) is None:
            return Run(job.problem, job.task, job.method, SKIPPED, note=f"{REFERENCE} could not bracket eps* in time")
        eps = task.value * known[0 if task.value < 1.0 else 1]
        return replace(run := perform(replace(job, eps=eps)), figures={**run.figures, "eps": eps})

    results = Results(name, date.today().isoformat(), limit, repeat, machine(), ())
    for problem, task, methods in entries:
        silent: set[str] = set()
        for _ in range(repeat):
            for method in (method for method in methods if method not in silent):
                run = asked(Job(problem, task, method, limit, data=data))
                if run.status != ANSWERED:
                    silent.add(method)
                results = replace(results, runs=(*results.runs, run))
                tell(run)
        keep(results)
    return results


def perform(job: Job, setup: float = _SETUP) -> Run:
    """The run in a process of its own, whatever happens in it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as errors:
        process = _started(job, errors)
        said: queue.Queue[Any] = queue.Queue()
        reader = threading.Thread(target=_read, args=(process, said), daemon=True)
        reader.start()
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
    path = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.methods"], env={**os.environ, **ONE_THREAD, "PYTHONPATH": path}, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, start_new_session=True,
    )  # fmt: skip
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(json.dumps(asdict(job)))
        process.stdin.close()
    return process


def _read(process: subprocess.Popen[str], said: queue.Queue[Any]) -> None:
    """What the worker says, as it says it; None at the end."""
    assert process.stdout is not None
    with process.stdout:
        for line in process.stdout:
            said.put(json.loads(line))
    said.put(None)


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
