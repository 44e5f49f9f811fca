"""The same work on many images, in as many processes as there are cores, or in any executor."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from typing import Generic, TypeVar

from cpcal.vision.batch.thread_limits import one_thread

T = TypeVar("T")

_CHUNK = 8  # images that a worker is given at a time
_WAITING = 3  # chunks a worker
_WAITING_ELSEWHERE = 16  # chunks in an executor whose workers are not known


def in_parallel(
    work: Callable[[Sequence[str]], T],
    names: Sequence[str],
    workers: int | None = None,
    executor: Executor | None = None,
) -> Iterator[T]:
    """`work` on all names, a few at a time, each on one thread, in the order in which it is done.

    workers   processes; left out: one a core. 1: none, the work is done here
    executor  any executor to use instead; it is not shut down
    """
    quiet = _OnOneThread(work)
    chunks = iter([names[k : k + _CHUNK] for k in range(0, len(names), _CHUNK)])
    with one_thread():  # for as long as any worker of this process may be at work
        if executor is not None:
            yield from _through(executor, quiet, chunks, _WAITING_ELSEWHERE)
            return
        count = workers or multiprocessing.cpu_count()
        if count == 1 or len(names) <= _CHUNK:
            yield from map(work, chunks)
            return
        context = multiprocessing.get_context("spawn")  # the same everywhere, and safe beside threads
        with ProcessPoolExecutor(count, mp_context=context, initializer=_prepare) as pool:
            yield from _through(pool, quiet, chunks, _WAITING * count)


def _through(
    executor: Executor, work: Callable[[Sequence[str]], T], chunks: Iterator[Sequence[str]], most: int
) -> Iterator[T]:
    """At most so many chunks wait, so that an interruption is heard soon and memory stays bounded."""
    waiting: set[Future[T]] = set()
    try:
        while True:
            while len(waiting) < most and (chunk := next(chunks, None)) is not None:
                waiting.add(executor.submit(work, chunk))
            if not waiting:
                return
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    finally:
        for future in waiting:
            future.cancel()


@dataclass(frozen=True)
class _OnOneThread(Generic[T]):
    """Work without threads of its own, in whatever process or thread it runs."""

    work: Callable[[Sequence[str]], T]

    def __call__(self, names: Sequence[str]) -> T:
        with one_thread():
            return self.work(names)


def _prepare() -> None:
    """In each worker: Ctrl-C is for the main process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
