"""The same work on many images, in as many processes as there are cores, or in any executor."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

from cpcal.vision.opencv import opencv

T = TypeVar("T")

_CHUNK = 8  # images that a worker is given at a time
_WAITING = 3  # chunks a worker
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_WAITING_ELSEWHERE = 16  # chunks in an executor whose workers are not known


def in_parallel(
    work: Callable[[Sequence[str]], T],
    names: Sequence[str],
    workers: int | None = None,
    executor: Executor | None = None,
) -> Iterator[T]:
    """`work` on all names, a few at a time, in the order in which it is done.

    workers   processes; left out: one a core. 1: none, the work is done here
    executor  any executor to use instead; it is not shut down
    """
    chunks = iter([names[k : k + _CHUNK] for k in range(0, len(names), _CHUNK)])
    if executor is not None:
        yield from _through(executor, work, chunks, _WAITING_ELSEWHERE)
        return
    count = workers or multiprocessing.cpu_count()
    if count == 1 or len(names) <= _CHUNK:
        yield from map(work, chunks)
        return
    context = multiprocessing.get_context("spawn")  # the same everywhere, and safe beside threads
    with _one_thread(), ProcessPoolExecutor(count, mp_context=context, initializer=_prepare) as pool:
        yield from _through(pool, work, chunks, _WAITING * count)


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


@contextmanager
def _one_thread() -> Generator[None, None, None]:
    """Processes started meanwhile do linear algebra on one core: threads of many workers would wait for each other."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _prepare() -> None:
    """In each worker: Ctrl-C is for the main process, and a worker has one core."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    opencv().setNumThreads(1)
