"""When a checkpoint is due, and what happens where it cannot be written: the work goes on."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path

from cpcal.common.errors import InputError, Problem
from cpcal.execution.checkpoint_file import Line, write_checkpoint

_EVERY = 5.0  # seconds between two checkpoints of a search
_SHARE = 20.0  # and at least so many times as long as the last one took
_LOGGER = logging.getLogger("cpcal")


class Regularly:
    """Calls `keep` when it is due: every few seconds, and never so often that it takes much of the time.

    It holds nothing of what is kept: in a circle of references that would stay in memory long after its search.
    """

    def __init__(self) -> None:
        self._next = time.monotonic() + _EVERY

    def __call__(self, keep: Callable[[], None]) -> None:
        """After every node."""
        if time.monotonic() >= self._next:
            self.now(keep)

    def now(self, keep: Callable[[], None]) -> None:
        """Due or not."""
        began = time.monotonic()
        keep()
        now = time.monotonic()
        self._next = now + max(_EVERY, _SHARE * (now - began))


def kept(path: Path, of: Mapping[str, str], lines: Iterable[Line]) -> bool:
    """Write, or say in the log that it could not be: no checkpoint is worth the run."""
    try:
        write_checkpoint(path, of, lines)
    except InputError as error:
        _say_once(str(error.problems[0]))
        return False
    return True


def garbled(path: Path, error: Exception) -> InputError:
    """What to raise for a checkpoint that is whole, and still says nothing that can be gone on with."""
    what = f"lacks or garbles something ({error})"
    return InputError([Problem(str(path), what, "run again without --resume, which begins anew")])


@cache
def _say_once(problem: str) -> None:
    """On stderr, or in the log where there is one."""
    _LOGGER.warning("cpcal: warning: a checkpoint is missing: %s", problem)
