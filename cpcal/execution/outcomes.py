"""Many tasks through an executor: few at a time, in the order in which they are done, and none lost with its worker."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from cpcal.common.errors import CpcalError
from cpcal.execution.executors import Processes, of_dask
from cpcal.execution.stopping import Stopped, asked

A = TypeVar("A")
T = TypeVar("T")

_LOOK = 0.2  # seconds between looks at whether to stop
_TRIES = 3  # times that a task is begun whose worker ends
_KILLED = (
    "its process was killed, had no memory left, or could not begin (a script that begins workers does so after "
    "`if __name__ == '__main__':`)"
)


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
    alone, so that it harms no other; then its outcome is a LostWorkerError. When the process is asked to stop, no task
    is begun any more; those at work in processes of ours are told, and what they answer still comes. Raises
    LostWorkerError where nobody takes tasks any more.
    """
    road = Road(executor, work, partial(next, iter(tasks), None), most)
    try:
        while True:
            road.fill()
            if not road.running:
                return
            yield from road.done()
    finally:
        road.cancel()


class Road(Generic[A, T]):
    """Tasks on their way. `task` gives the next one; None where there is none at the moment."""

    def __init__(self, executor: Executor, work: Callable[[A], T], task: Callable[[], A | None], most: int) -> None:
        self._executor, self._work, self._task, self._most = executor, work, task, most
        self._again: deque[tuple[A, int]] = deque()
        self._finished: SimpleQueue[Future[T]] = SimpleQueue()  # in the order in which they are
        self._stopping = False
        self.running: dict[Future[T], tuple[A, int]] = {}  # and how often it was begun

    @property
    def free(self) -> int:
        """How many tasks more may be given out."""
        return self._most - len(self.running) - len(self._again)

    @property
    def ready(self) -> bool:
        """Whether a task that is given out now does not hold up who gives it."""
        return not isinstance(self._executor, Processes) or self._executor.ready

    @property
    def some_done(self) -> bool:
        return not self._finished.empty()

    def fill(self) -> None:
        """Give out tasks, as many as may run; one that lost its worker twice runs alone."""
        while len(self.running) < self._most and not asked() and not self._alone():
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
                self.running[future] = task, begun + 1
                future.add_done_callback(self._finished.put)
            except BrokenExecutor:
                self._again.append((task, begun))
                self._renew()
            except (RuntimeError, ValueError, OSError, EOFError) as error:  # of a client without scheduler, say
                raise LostWorkerError(f"the executor takes no more tasks ({error})") from None

    def _alone(self) -> bool:
        return any(begun >= _TRIES for _, begun in self.running.values())

    def done(self) -> Iterator[TaskOutcome[A, T]]:
        """Wait for some task to be done, or for a moment."""
        for future in self._ended():
            if future not in self.running:  # given up
                continue
            task, begun = self.running.pop(future)
            if future.cancelled():  # by a Dask client that lost its scheduler, and looks for it again
                if begun < _TRIES and not asked():
                    self._again.append((task, begun))
                else:
                    yield _lost(task, "it was cancelled: the scheduler is gone, or was started again too often")
            elif isinstance(future.exception(), Stopped):
                continue
            elif not isinstance(future.exception(), BrokenExecutor):
                yield TaskOutcome(task, future)
            elif begun < _TRIES and isinstance(self._executor, Processes):
                self._again.append((task, begun))
            else:
                yield _lost(task, _KILLED)
        if self._again and not self.running and isinstance(self._executor, Processes):
            self._renew()
        if asked() and not self._stopping:
            self._stop()

    def _ended(self) -> Iterator[Future[T]]:
        try:
            yield self._finished.get(timeout=_LOOK)
            while True:
                yield self._finished.get_nowait()
        except Empty:
            return

    def _renew(self) -> None:
        if not isinstance(self._executor, Processes):
            raise LostWorkerError("the executor takes no more tasks")
        self._executor.renew()

    def _stop(self) -> None:
        """What is at work elsewhere than in processes of ours cannot be told: it is given up."""
        self._stopping = True
        if isinstance(self._executor, Processes):
            self._executor.ask_to_stop()
            for future in list(self.running):
                if future.cancel():
                    del self.running[future]
        else:
            self.cancel()

    def cancel(self) -> None:
        """Give up what is on its way. Processes of ours that are to stop are told."""
        if asked() and self.running and not self._stopping:
            self._stop()
        given_up, self.running = self.running, {}
        if asked() or not of_dask(
            self._executor
        ):  # which complains of tasks that are cancelled: they end by themselves
            for future in given_up:
                future.cancel()


def _lost(task: A, why: str) -> TaskOutcome[A, T]:
    future: Future[T] = Future()
    future.set_exception(LostWorkerError(why))
    return TaskOutcome(task, future)
