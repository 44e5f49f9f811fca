"""Runs a suite: repetitions interleaved, so that what slows the machine down slows all methods down alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import date
from functools import cache

from benchmarks.isolation import Job, perform
from benchmarks.machine import machine
from benchmarks.records import ANSWERED, SKIPPED, Results, Run
from benchmarks.suites import MINIMISE, REFERENCE, Entry
from benchmarks.tasks import WITH_EPS, Task

_REFERENCE_LIMIT = 300.0

Tell = Callable[[Run], None]
Bracket = tuple[float, float]


def execute(
    name: str,
    entries: Iterable[Entry],
    *,
    limit: float,
    repeat: int,
    data: str | None = None,
    tell: Tell = lambda run: None,
    keep: Callable[[Results], None] = lambda results: None,
    before: tuple[Run, ...] = (),
) -> Results:
    """Every entry `repeat` times. A method that did not answer is not asked the same again.

    `tell` hears of every run, `keep` is given all that is known after each entry. Entries that `before` holds runs of
    are not run again.
    """

    def results() -> Results:
        return Results(name, date.today().isoformat(), limit, repeat, machine(), tuple(runs))

    @cache
    def reference(problem: str) -> Bracket | None:
        run = perform(Job(problem, MINIMISE, REFERENCE, _REFERENCE_LIMIT, data=data))
        return (run.figures["lo"], run.figures["hi"]) if run.status == ANSWERED else None

    runs = list(before)
    known_entries = {(run.problem, run.task) for run in before}
    for problem, task, methods in entries:
        if (problem, task) in known_entries:
            continue
        known = reference(problem) if Task.named(task).kind in WITH_EPS else None
        silent: set[str] = set()
        for _ in range(repeat):
            for method in methods:
                if method in silent:
                    continue
                run = _asked(Job(problem, task, method, limit, data=data), known)
                if run.status != ANSWERED:
                    silent.add(method)
                runs.append(run)
                tell(run)
        keep(results())
    return results()


def _asked(job: Job, known: Bracket | None) -> Run:
    task = Task.named(job.task)
    if task.kind not in WITH_EPS:
        return perform(job)
    if known is None:
        return Run(job.problem, job.task, job.method, SKIPPED, note=f"{REFERENCE} could not bracket eps* in time")
    eps = task.eps(*known)
    run = perform(replace(job, eps=eps))
    return replace(run, figures={**run.figures, "eps": eps})
