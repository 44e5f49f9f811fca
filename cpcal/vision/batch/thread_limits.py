"""OpenCV and the libraries of linear algebra on one thread: their own would change the last bits of sums.

Their limits are the process's, not a thread's. So they are set when the first user of the process comes and restored
when the last one leaves: a worker that ends must not set them free while others compute.
"""

from __future__ import annotations

from contextlib import ExitStack

from cpcal.execution.threads import linear_algebra_on_one_thread, while_used
from cpcal.vision.opencv import opencv


def _limited(undone: ExitStack) -> None:
    cv2 = opencv()
    undone.callback(cv2.setNumThreads, cv2.getNumThreads())
    cv2.setNumThreads(1)
    undone.enter_context(linear_algebra_on_one_thread())


one_thread = while_used(_limited)
"""One thread for each call of these libraries in this process, until the last of all users leaves.

Raises MissingExtraError.
"""
