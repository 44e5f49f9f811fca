"""Locks on open files that the system takes back when the process ends, however it ends; folders that live as long."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from tempfile import gettempdir, mkdtemp

_LOCK = ".cpcal-scratch"


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


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """An empty folder for this block, in the system's temporary directory.

    A killed process leaves its folder, but not the lock on it: such folders are removed first.
    """
    for lock in Path(gettempdir()).glob(f"cpcal-*/{_LOCK}"):
        with suppress(OSError):  # it is another user's, or its process lives
            descriptor = os.open(lock, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
            try:
                exclusive(descriptor)
                rmtree(lock.parent, ignore_errors=True)
            finally:
                os.close(descriptor)
    held = None
    while held is None:
        folder = Path(mkdtemp(prefix="cpcal-"))
        held = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o600)
        with suppress(BlockingIOError):
            exclusive(held)
            if (folder / _LOCK).exists():
                break
        os.close(held)  # another process took it for one that was left, and removes it
        held = None
    place = folder / "files"
    try:
        place.mkdir()
        yield place
    finally:
        os.close(held)
        rmtree(folder, ignore_errors=True)
