"""The same work on many images, in as many processes as there are cores, or in any executor."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Generic, TypeVar

from cpcal.execution.executors import Processes, executor_for
from cpcal.execution.outcomes import outcomes
from cpcal.execution.stopping import Reason, Stopped, asked
from cpcal.vision.batch.thread_limits import one_thread

T = TypeVar("T")

_LOADS = ("cpcal.vision.batch.detect", "cpcal.solver.numba_begun")
_CHUNK = 8  # images that a worker is given at a time


def in_parallel(
    work: Callable[[Sequence[str]], T],
    names: Sequence[str],
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
) -> Iterator[T]:
    """`work` on all names, a few at a time, each on one thread, in the order in which it is done; here, too, until the
    first of the processes has begun.

    workers    processes; left out: one a core. 1: none, the work is done here
    executor   any executor to use instead; it is not shut down
    scheduler  address of a Dask scheduler to use instead

    Raises what the work raises, LostWorkerError, and Stopped after the last answer when the process is asked to stop.
    """
    if executor is None and scheduler is None:
        workers = 1 if len(names) <= _CHUNK else workers or multiprocessing.cpu_count()
    done, alone = 0, _OnOneThread(work)
    with one_thread(), executor_for(workers, scheduler, executor, loads=_LOADS) as (place, most):
        while done < len(names) and not asked() and isinstance(place, Processes) and not place.ready:
            yield alone(names[done : done + 1])  # while the first worker begins
            done += 1
        chunks = [names[k : k + _CHUNK] for k in range(done, len(names), _CHUNK)]
        for outcome in outcomes(place, most, alone, chunks):
            done += len(outcome.task)
            yield outcome.value
    if done < len(names):
        raise Stopped(asked() or Reason.INTERRUPTED)


@dataclass(frozen=True)
class _OnOneThread(Generic[T]):
    """Work without threads of its own, in whatever process or thread it runs."""

    work: Callable[[Sequence[str]], T]

    def __call__(self, names: Sequence[str]) -> T:
        with one_thread():
            return self.work(names)
