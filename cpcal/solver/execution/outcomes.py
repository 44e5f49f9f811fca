"""Many tasks through an executor: few at a time, in the order in which they are done, and none lost with its worker.

A large value that many small tasks need is `Shared`: it travels to a worker once, not with every task.
"""

from __future__ import annotations

import hashlib
import pickle
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from cpcal.common.errors import CpcalError
from cpcal.solver.execution.executors import PATIENCE, Place, Processes, dask_status
from cpcal.solver.execution.stopping import Reason, Stopped, asked, insisted
from cpcal.solver.execution.threads import linear_algebra_on_one_thread

A = TypeVar("A")
T = TypeVar("T")
V = TypeVar("V")

DESERTED = 60.0  # seconds without a scheduler
_LOOK = 0.2  # seconds between looks at whether to stop
_TRIES = 3  # times that a task is begun whose worker ends
_KEPT = 4  # shared values that a worker keeps
_here: dict[str, Any] = {}  # those of this process, by digest
_KILLED = (
    "its process was killed, had no memory left, or could not begin (a script that begins workers does so after "
    "`if __name__ == '__main__':`)"
)
_GONE = "the scheduler is gone, or was started again too often"


class LostWorkerError(CpcalError):
    """Who did a task is gone: it was killed, had no memory left, or cannot be reached."""


@dataclass(frozen=True)
class TaskOutcome(Generic[A, T]):
    """What became of a task: its value, or the exception that it raised."""

    task: A
    future: Future[T]

    @property
    def value(self) -> T:
        """Raises what the task raised."""
        return self.future.result()

    @property
    def error(self) -> BaseException | None:
        """What the task raised, or None."""
        return self.future.exception()


def outcomes(executor: Executor, most: int, work: Callable[[A], T], tasks: Iterable[A]) -> Iterator[TaskOutcome[A, T]]:
    """`work(task)` for all tasks, `most` of them given out at a time, in the order in which they are done.

    A task whose worker is killed, or whose scheduler begins anew, is begun again, three times at most, the last time
    alone, in case memory is short; then its outcome is a LostWorkerError. When the process is asked to stop, no task is
    begun any more; those at work in processes of ours are told, and what they answer within ten seconds still comes.
    Raises LostWorkerError where nobody takes tasks any more.
    """
    pool, source = executor if isinstance(executor, Processes) else None, iter(tasks)
    again: deque[tuple[A, int]] = deque()
    finished: SimpleQueue[Future[T]] = SimpleQueue()  # in the order in which they are
    running: dict[Future[T], tuple[A, int]] = {}  # and how often it was begun
    stopped: float | None = None  # when
    reached = time.monotonic()  # a scheduler, last
    try:
        while True:
            while (
                len(running) < most and not asked() and not any(begun >= _TRIES for _, begun in running.values())
            ):  # one that lost its worker twice runs alone
                if again and again[0][1] + 1 >= _TRIES and running:
                    break
                try:
                    task, begun = again.popleft() if again else (next(source), 0)
                except StopIteration:
                    break
                try:
                    future = executor.submit(work, task)
                except (RuntimeError, ValueError, OSError) as error:  # of a client without scheduler, say
                    raise LostWorkerError(f"the executor takes no more tasks ({error})") from None
                running[future] = task, begun + 1
                future.add_done_callback(finished.put)
            if not running:
                return
            for future in _ended(finished):
                if future not in running:  # given up
                    continue
                task, begun = running.pop(future)
                cancelled = future.cancelled()  # by a Dask client that lost its scheduler, and looks for it again
                raised = None if cancelled else future.exception()
                lost = cancelled or isinstance(raised, BrokenExecutor)
                if isinstance(raised, Stopped) or (lost and asked()):
                    continue
                if lost and begun < _TRIES and (cancelled or pool is not None):
                    again.append((task, begun))
                    continue
                if lost:
                    future = Future()
                    future.set_exception(LostWorkerError(f"it was cancelled: {_GONE}" if cancelled else _KILLED))
                yield TaskOutcome(task, future)
            if asked() and pool is None:  # what is at work elsewhere cannot be told: it is given up
                return
            if asked() and pool is not None and stopped is None:
                stopped = time.monotonic()
                pool.ask_to_stop()
                running = {future: given for future, given in running.items() if not future.cancel()}
            elif pool is not None and stopped is not None and (insisted() or time.monotonic() > stopped + PATIENCE):
                pool.kill()  # one that a SIGSTOP holds, say
            status = dask_status(executor)
            if status in (None, "running"):
                reached = time.monotonic()
            elif status in ("closing", "closed") or time.monotonic() > reached + DESERTED:
                running = {}
                what = f"did not answer for {int(DESERTED)} s, or the client is closed"
                raise LostWorkerError(f"the scheduler is gone: it {what}")
    finally:
        if asked() and running and pool is not None:
            pool.ask_to_stop()
        dask = dask_status(executor)
        if dask is None or (dask == "running" and asked()):  # else it complains of them: they end by themselves
            for future in running:
                future.cancel()


def _ended(finished: SimpleQueue[Future[T]]) -> Iterator[Future[T]]:
    with suppress(Empty):
        yield finished.get(timeout=_LOOK)
        while True:
            yield finished.get_nowait()


class Shared(Generic[V]):
    """A value, and what it is as bytes; nothing may change it."""

    def __init__(self, value: V) -> None:
        self._bytes = pickle.dumps(value)
        self._digest = hashlib.sha256(self._bytes).hexdigest()

    def mapped(self, place: Place, work: Callable[[V, A], T], items: Sequence[A]) -> list[T]:
        """`work(value, item)` for every item, in their order, wherever the executor is.

        The value goes with as many tasks as may be at work, or where a worker asks for it. Raises what the work raises,
        and Stopped when the process is asked to stop.
        """
        executor, most = place
        found: dict[int, T] = {}
        left = list(range(len(items)))
        content = None
        while left:
            tasks = [_SharedTask(work, self._digest, content, items[k], k) for k in left]
            for outcome in outcomes(executor, most, _done, tasks):
                value = outcome.value
                if not isinstance(value, _Missing):
                    found[outcome.task.place] = value
            again = [k for k in left if k not in found]
            if asked() and again:
                raise Stopped(asked() or Reason.INTERRUPTED)
            left, content = again, self._bytes
        return [found[k] for k in range(len(items))]

    def in_parts(self, place: Place, work: Callable[..., Sequence[T]], items: Sequence[Any], *more: Any) -> list[T]:
        """`work(value, some, *more)` for as many parts of the items as may be at work: its answers in their order."""
        size = -(-len(items) // place[1])
        parts = [(work, items[k : k + size], more) for k in range(0, len(items), size)]
        return [one for part in self.mapped(place, _on_part, parts) for one in part]


def _on_part(value: Any, part: tuple[Callable[..., Sequence[T]], Sequence[Any], tuple[Any, ...]]) -> Sequence[T]:
    work, items, more = part
    return work(value, items, *more)


class _Missing:
    """Says that this worker has never seen the value. No error, which a cluster would log."""


@dataclass(frozen=True)
class _SharedTask(Generic[V, A, T]):
    work: Callable[[V, A], T]
    digest: str
    content: bytes | None
    item: A
    place: int


def _done(task: _SharedTask[V, A, T]) -> T | _Missing:
    if task.digest not in _here:
        if task.content is None:
            return _Missing()
        while len(_here) >= _KEPT:
            del _here[next(iter(_here))]
        _here[task.digest] = pickle.loads(task.content)
    with linear_algebra_on_one_thread():
        return task.work(_here[task.digest], task.item)
