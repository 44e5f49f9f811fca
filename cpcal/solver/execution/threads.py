"""Linear algebra on one thread: its own threads would change the last bits of sums, and fight with other workers.

The limit is the process's, not a thread's. So it is set when the first user of the process comes and taken away when
the last one leaves: a task that ends must not set it free while others compute.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import lru_cache
from typing import Any

_SAID = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")


def while_used(begin: Callable[[ExitStack], object]) -> Callable[[], AbstractContextManager[None]]:
    """A state of the process that the first of its users begins, and that ends when the last of them leaves.

    `begin` enters what has to be undone into the stack that it is given.
    """
    lock, undone, users = threading.Lock(), ExitStack(), 0

    @contextmanager
    def used() -> Iterator[None]:
        nonlocal users
        with lock:
            if not users:
                begin(undone)
            users += 1
        try:
            yield
        finally:
            with lock:
                users -= 1
                if not users:
                    undone.close()

    return used


@lru_cache(maxsize=1)
def _libraries(modules: int) -> Any:
    """Of linear algebra, in this process while so many modules are imported: looking for them takes a millisecond."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def _loaded_on_one_thread() -> Iterator[None]:
    """Libraries that are loaded while in the block read here how many threads they may use; they stay with one."""
    set_here = {name: "1" for name in _SAID if name not in os.environ}
    os.environ.update(set_here)
    try:
        yield
    finally:
        for name in set_here:
            os.environ.pop(name, None)


def _limited(undone: ExitStack) -> None:
    undone.enter_context(_libraries(len(sys.modules)).limit(limits=1))
    undone.enter_context(_loaded_on_one_thread())


linear_algebra_on_one_thread = while_used(_limited)
"""One thread for each call of these libraries in this process, until the last of all users leaves."""
