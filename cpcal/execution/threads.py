"""Linear algebra on one thread: its own threads would change the last bits of sums, and fight with other workers.

The limit is the process's, not a thread's. So it is set when the first user of the process comes and taken away when
the last one leaves: a task that ends must not set it free while others compute.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import cache
from typing import Any


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


@cache
def _libraries() -> Any:
    """Of linear algebra, in this process."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


linear_algebra_on_one_thread = while_used(lambda undone: undone.enter_context(_libraries().limit(limits=1)))
"""One thread for each call of these libraries in this process, until the last of all users leaves."""
