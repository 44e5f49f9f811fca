"""One process compiles a function, the others wait for what it keeps.

The lock is a file beside the machine code, one for each source file; the system takes it back when a process ends. A
function's compilation takes the locks of the files that it calls into. Imports have no circle, so that no two processes
wait for each other; and none waits longer than `LONGEST`, but compiles itself.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cpcal.common.file_lock import exclusive

LONGEST = 120.0  # seconds
_PAUSE = 0.05
_held: set[Path] = set()  # by this process: what is compiled may call into its own file


def compiled_once(dispatcher: Any, lock: Path, tell: Callable[[str], None]) -> None:
    """Let numba's dispatcher load or compile under a lock; `tell` is given a sentence before it waits."""
    from numba.core.compiler_lock import global_compiler_lock

    compile_it = dispatcher.compile

    def before_waiting() -> None:
        tell(f"waiting for another process that compiles '{lock.stem}'")

    def compile_in_turn(signature: Any) -> Any:
        # numba's own lock first: a thread that has the file's must not wait for one that waits for the file
        with global_compiler_lock, _turn(lock, before_waiting):
            return compile_it(signature)

    dispatcher.compile = compile_in_turn


@contextmanager
def _turn(lock: Path, before_waiting: Callable[[], None]) -> Iterator[None]:
    if lock in _held:
        yield
        return
    descriptor = None
    with suppress(OSError):  # where nothing can be locked every process compiles
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        _wait(descriptor, before_waiting)
    _held.add(lock)
    try:
        yield
    finally:
        _held.remove(lock)
        if descriptor is not None:
            os.close(descriptor)


def _wait(descriptor: int, before_waiting: Callable[[], None]) -> None:
    """Until the file is this process's, or for too long."""
    began, told = time.monotonic(), False
    while time.monotonic() < began + LONGEST:
        try:
            exclusive(descriptor)
        except BlockingIOError:
            if not told and time.monotonic() > began + 0.5:
                before_waiting()
                told = True
            time.sleep(_PAUSE)
        else:
            return
