"""A large value that many small tasks need: it travels to a worker once, not with every task."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from cpcal.execution.executors import Place
from cpcal.execution.outcomes import outcomes
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
