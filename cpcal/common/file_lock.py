"""A lock on an open file that the system takes back when the process ends, however it ends."""

from __future__ import annotations

import importlib
import os


def exclusive(descriptor: int) -> None:
    """Lock the file for this process alone, without waiting.

    Raises BlockingIOError while another process has it, OSError where there are no locks.
    """
    if os.name == "nt":
        msvcrt = importlib.import_module("msvcrt")  # of Windows only
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from None
        return
    fcntl = importlib.import_module("fcntl")  # of POSIX only
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
