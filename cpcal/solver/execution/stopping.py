"""Long work is asked to stop, and stops at the next safe moment with what it has proved.

A signal that raises an exception between any two lines tears a step apart, or is lost where the exception is dropped.
So a signal only leaves a note here, and work looks at it between its steps: `asked()`. Signals belong to the process,
and so does the note. A second signal does what the first would have done without us.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum
from types import FrameType
from typing import Any


class Reason(IntEnum):
    """Why work is asked to stop; the value is the exit status that says so."""

    DESERTED = 2
    INTERRUPTED = 130
    TERMINATED = 143

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Reason.DESERTED: "stopped, since nobody is there to do the work",
    Reason.INTERRUPTED: "interrupted",
    Reason.TERMINATED: "terminated",
}


class Stopped(KeyboardInterrupt):
    """Work ended before there was anything to answer. Where nobody catches it, it is a KeyboardInterrupt."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason = reason

    def __str__(self) -> str:
        return self.reason.sentence


Handler = Callable[[int, FrameType | None], Any] | int | signal.Handlers | None


class _Note:
    """What this process was asked. `sources` are asked too: a worker's coordinator, a limit of memory."""

    def __init__(self) -> None:
        self.reason: Reason | None = None
        self.heard = self.insisted = False
        self.sources = list[Callable[[], Reason | None]]()


_note = _Note()


def asked() -> Reason | None:
    """Why the work of this process should stop now; None while it may go on."""
    return _note.reason or next(filter(None, (source() for source in _note.sources)), None)


def insisted() -> bool:
    """Whether a second signal came: there is no time to end well."""
    return _note.insisted


def give_up(reason: Reason) -> None:
    """Ask this process itself to stop, until the end of the outermost `heard`; outside of one nothing changes."""
    if _note.heard and _note.reason is None:
        _note.reason = reason


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], None], *numbers: int) -> Iterator[dict[int, Handler]]:
    """While in the block these signals go to the handler, but for those that are ignored: a background job of a shell
    ignores Ctrl-C. The handlers before."""
    before = {n: signal.getsignal(n) for n in numbers}
    before = {n: earlier for n, earlier in before.items() if earlier not in (signal.SIG_IGN, None)}
    try:
        for number in before:
            signal.signal(number, handler)
        yield before
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def heard(*, terminate: bool = False) -> Iterator[None]:
    """While in the block the first Ctrl-C (and SIGTERM, with `terminate`) is a note that `asked` shows.

    The note is gone at the end. Inside another such block, or in a thread that gets no signals, nothing changes.
    """
    if _note.heard or threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        if _note.reason is None:
            _note.reason = Reason(128 + number)
            return
        _note.insisted = True
        earlier = before[number]
        (earlier if callable(earlier) else leave_at_once)(number, frame)

    _note.heard = True
    try:
        with _handled(note, signal.SIGINT, *([signal.SIGTERM] if terminate else [])) as before:
            yield
    finally:
        _note.heard, _note.insisted, _note.reason = False, False, None


@contextmanager
def also_asked_by(source: Callable[[], Reason | None]) -> Iterator[None]:
    """While in the block `asked` looks at this, too."""
    _note.sources.append(source)
    try:
        yield
    finally:
        _note.sources.remove(source)


@contextmanager
def raising() -> Iterator[None]:
    """While in the block SIGTERM is an exception, as Ctrl-C is, so that what was begun is tidied up."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Stopped(Reason(128 + number))

    with _handled(stop, signal.SIGINT, signal.SIGTERM):
        yield


def leave_at_once(number: int, frame: FrameType | None) -> None:
    """A handler: the process ends now, with one sentence; what is on disk stays as it is."""
    with suppress(OSError, ValueError):
        shown = "\x1b[?25h" if sys.stderr.isatty() else ""  # a progress display may have hidden the cursor
        os.write(2, f"{shown}cpcal: {Reason(128 + number).sentence}\n".encode())
    os._exit(128 + number)
