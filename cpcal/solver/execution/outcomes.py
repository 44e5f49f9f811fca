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
from dataclasses import dataclass
from functools import partial
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
    given = TasksAtWork(executor, work, partial(next, iter(tasks), None), most)
    try:
        while True:
            given.fill()
            if not given.running:
                return
            yield from given.done()
    finally:
        given.cancel()


class TasksAtWork(Generic[A, T]):
    """Tasks that an executor does. `task` gives the next one; None where there is none at the moment."""

    def __init__(self, executor: Executor, work: Callable[[A], T], task: Callable[[], A | None], most: int) -> None:
        self._executor, self._work, self._task, self._most = executor, work, task, most
        self._pool = executor if isinstance(executor, Processes) else None
        self._again: deque[tuple[A, int]] = deque()
        self._finished: SimpleQueue[Future[T]] = SimpleQueue()  # in the order in which they are
        self._stopped: float | None = None  # when
        self._reached = time.monotonic()  # a scheduler, last
        self.running: dict[Future[T], tuple[A, int]] = {}  # and how often it was begun

    def fill(self) -> None:
        """Give out tasks, as many as may run; one that lost its worker twice runs alone."""
        while (
            len(self.running) < self._most
            and not asked()
            and not any(begun >= _TRIES for _, begun in self.running.values())
        ):
            if self._again and (self._again[0][1] + 1 < _TRIES or not self.running):
                task, begun = self._again.popleft()
            elif self._again:
                return
            else:
                fresh = self._task()
                if fresh is None:
                    return
                task, begun = fresh, 0
            try:
                future = self._executor.submit(self._work, task)
            except (RuntimeError, ValueError, OSError) as error:  # of a client without scheduler, say
                raise LostWorkerError(f"the executor takes no more tasks ({error})") from None
            self.running[future] = task, begun + 1
            future.add_done_callback(self._finished.put)

    def done(self) -> Iterator[TaskOutcome[A, T]]:
        """Wait for some task to be done, or for a moment. Raises LostWorkerError."""
        for future in self._ended():
            if future not in self.running:  # given up
                continue
            task, begun = self.running.pop(future)
            cancelled = future.cancelled()  # by a Dask client that lost its scheduler, and looks for it again
            error = None if cancelled else future.exception()
            lost = cancelled or isinstance(error, BrokenExecutor)
            if isinstance(error, Stopped) or (lost and asked()):
                continue
            if lost and begun < _TRIES and (cancelled or self._pool is not None):
                self._again.append((task, begun))
            elif lost:
                yield _lost(task, f"it was cancelled: {_GONE}" if cancelled else _KILLED)
            else:
                yield TaskOutcome(task, future)
        if asked():
            self._stop()
        self._look_for_scheduler()

    def _ended(self) -> Iterator[Future[T]]:
        try:
            yield self._finished.get(timeout=_LOOK)
            while True:
                yield self._finished.get_nowait()
        except Empty:
            return

    def _stop(self) -> None:
        """What is at work elsewhere than in processes of ours cannot be told: it is given up. These are killed if they
        do not end soon: one that a SIGSTOP holds, say."""
        if self._pool is None:
            self.cancel()
            return
        if self._stopped is None:
            self._stopped = time.monotonic()
            self._pool.ask_to_stop()
            for future in list(self.running):
                if future.cancel():
                    del self.running[future]
        elif insisted() or time.monotonic() > self._stopped + PATIENCE:
            self._pool.kill()

    def _look_for_scheduler(self) -> None:
        """Raises LostWorkerError where a Dask client has found none for too long, or looks for none any more."""
        status = dask_status(self._executor)
        if status in (None, "running"):
            self._reached = time.monotonic()
        elif status in ("closing", "closed") or time.monotonic() > self._reached + DESERTED:
            self.running.clear()
            raise LostWorkerError(
                f"the scheduler is gone: it did not answer for {int(DESERTED)} s, or the client is closed"
            )

    def cancel(self) -> None:
        """Give up what is on its way. Processes of ours that are to stop are told."""
        if asked() and self.running and self._pool is not None:
            self._pool.ask_to_stop()
        given_up, self.running = self.running, {}
        dask = dask_status(self._executor)
        if dask is None or (dask == "running" and asked()):  # else it complains of them: they end by themselves
            for future in given_up:
                future.cancel()


def _lost(task: A, why: str) -> TaskOutcome[A, T]:
    future: Future[T] = Future()
    future.set_exception(LostWorkerError(why))
    return TaskOutcome(task, future)


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
