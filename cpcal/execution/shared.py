"""A large value that many small tasks need: it travels to a worker once, not with every task."""

from __future__ import annotations

import hashlib
import pickle
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from cpcal.execution.executors import Place
from cpcal.execution.outcomes import Road, TaskOutcome, outcomes
from cpcal.execution.stopping import Reason, Stopped, asked
from cpcal.execution.threads import linear_algebra_on_one_thread

A = TypeVar("A")
T = TypeVar("T")
V = TypeVar("V")

_KEPT = 4  # values that a worker keeps
_here: dict[str, Any] = {}  # of this process, by digest


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
            tasks = [_Task(work, self._digest, content, items[k], k) for k in left]
            for outcome in outcomes(executor, most, _done, tasks):
                value = outcome.value
                if not isinstance(value, _Missing):
                    found[outcome.task.place] = value
            again = [k for k in left if k not in found]
            if asked() and again:
                raise Stopped(asked() or Reason.INTERRUPTED)
            left, content = again, self._bytes
        return [found[k] for k in range(len(items))]

    def given_out(self, place: Place, work: Callable[[V, A], T]) -> GivenOut[V, A, T]:
        """The same one by one, taken back as they are done."""
        return GivenOut(self._bytes, self._digest, place, work)


class GivenOut(Generic[V, A, T]):
    """Tasks on a value that travels: give some out, go on with other work, take back what is done."""

    def __init__(self, content: bytes, digest: str, place: Place, work: Callable[[V, A], T]) -> None:
        self._content, self._digest, self._work = content, digest, work
        self._waiting: deque[_Task[V, A, T]] = deque()
        self._road = Road(place[0], _done, self._next, place[1])

    @property
    def free(self) -> int:
        """How many more may be given out."""
        return self._road.free - len(self._waiting)

    @property
    def ready(self) -> bool:
        """Whether a task that is given out now does not hold up who gives it."""
        return self._road.ready

    @property
    def some_done(self) -> bool:
        return self._road.some_done

    def give(self, item: A, *, first: bool = False) -> None:
        """Begin a task; `first`: the value goes with it, since the worker cannot know it yet."""
        self._waiting.append(_Task(self._work, self._digest, self._content if first else None, item, 0))
        self._road.fill()

    def taken_back(self) -> Iterator[TaskOutcome[A, T]]:
        """What is done; where nothing is, wait for some, or for a moment. Raises LostWorkerError as `outcomes`."""
        for outcome in self._road.done():
            if outcome.error is None and isinstance(outcome.value, _Missing):
                self._waiting.append(replace(outcome.task, content=self._content))
            else:
                yield TaskOutcome(outcome.task.item, outcome.future)  # type: ignore[arg-type]
        self._road.fill()

    def cancel(self) -> None:
        """Give up what is on its way."""
        self._waiting.clear()
        self._road.cancel()

    def _next(self) -> _Task[V, A, T] | None:
        return self._waiting.popleft() if self._waiting else None


class _Missing:
    """Says that this worker has never seen the value. No error, which a cluster would log."""


@dataclass(frozen=True)
class _Task(Generic[V, A, T]):
    work: Callable[[V, A], T]
    digest: str
    content: bytes | None
    item: A
    place: int


def _done(task: _Task[V, A, T]) -> T | _Missing:
    if task.digest not in _here:
        if task.content is None:
            return _Missing()
        while len(_here) >= _KEPT:
            del _here[next(iter(_here))]
        _here[task.digest] = pickle.loads(task.content)
    with linear_algebra_on_one_thread():
        return task.work(_here[task.digest], task.item)
