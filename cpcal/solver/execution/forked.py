"""Short tasks side by side in forked children of this process: they begin in a millisecond, with all that it holds.

Workers of a pool start in a tenth of a second or more, which pays for longer work only.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def side_by_side(tasks: Sequence[Callable[[], T]]) -> Iterator[Callable[[], list[T]]]:
    """Begin tasks; what is given waits for their answers, in order, or raises what a task raised.

    Answers travel by pickle. Where children cannot be had (one processor, threads, another system than Linux) the tasks
    are done when their answers are asked for, and so is what a child did not answer. After the block no child is left.
    """
    count = _children(len(tasks))
    children: list[tuple[int, int]] = []

    def answers() -> list[T]:
        found: dict[int, T] = {}
        for k, (_, reading) in enumerate(children):
            share = range(k, len(tasks), count)
            found.update(zip(share, _answered(reading) or [tasks[n]() for n in share], strict=True))
        return [found[n] if n in found else task() for n, task in enumerate(tasks)]

    try:
        for k in range(count):
            children.append(_child(tasks[k::count]))
        yield answers
    finally:
        for pid, reading in children:
            os.close(reading)
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


def _children(tasks: int) -> int:
    """How many children to begin for so many tasks."""
    if sys.platform != "linux" or threading.active_count() > 1:
        return 0
    processors = len(os.sched_getaffinity(0))
    return min(tasks, processors) if processors > 1 else 0


def _child(share: Sequence[Callable[[], object]]) -> tuple[int, int]:
    """A child that does some tasks: its number, and where its answers are read."""
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads of linear algebra, which such tasks do not use
        pid = os.fork()
    if pid:
        os.close(writing)
        return pid, reading
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        os.close(reading)
        answers = pickle.dumps([task() for task in share])
        with open(writing, "wb") as out:
            out.write(answers)
    finally:
        os._exit(0)  # whatever was raised: this process does the tasks again, and raises it


def _answered(reading: int) -> list[T] | None:
    """The answers of a child; None where it failed."""
    with open(reading, "rb", closefd=False) as stream:
        answers = stream.read()
    with suppress(EOFError, pickle.UnpicklingError):
        found: list[T] = pickle.loads(answers)  # what a child of this process wrote
        return found
    return None
