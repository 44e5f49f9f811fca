"""Linear algebra on one thread: its own threads would change the last bits of sums, and fight with other workers.

The limit is the process's, not a thread's. So it is set when the first user of the process comes and taken away when
the last one leaves: a task that ends must not set it free while others compute.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import Any

_lock = threading.Lock()
_users = 0
_restore = ExitStack()


@contextmanager
def linear_algebra_on_one_thread() -> Iterator[None]:
    """One thread for each call of these libraries in this process, until the last of all users leaves."""
    _enter()
    try:
        yield
    finally:
        _leave()


def _enter() -> None:
    global _users
    with _lock:
        if not _users:
            _restore.enter_context(_libraries().limit(limits=1))
        _users += 1


def _leave() -> None:
    global _users
    with _lock:
        _users -= 1
        if not _users:
            _restore.close()


@cache
def _libraries() -> Any:
    """Of linear algebra, in this process."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
