"""OpenCV and the libraries of linear algebra on one thread: their own would change the last bits of sums.

Their limits are the process's, not a thread's. So they are set when the first user of the process comes and restored
when the last one leaves: a worker that ends must not set them free while others compute.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from cpcal.execution.threads import linear_algebra_on_one_thread
from cpcal.vision.opencv import opencv

_lock = threading.Lock()
_users = 0
_restore = ExitStack()


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread for each call of these libraries in this process, until the last of all users leaves.

    Raises MissingExtraError.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


def _enter() -> None:
    global _users
    with _lock:
        if not _users:
            cv2 = opencv()
            _restore.callback(cv2.setNumThreads, cv2.getNumThreads())
            cv2.setNumThreads(1)
            _restore.enter_context(linear_algebra_on_one_thread())
        _users += 1


def _leave() -> None:
    global _users
    with _lock:
        _users -= 1
        if not _users:
            _restore.close()
