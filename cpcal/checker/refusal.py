"""Why nothing is proved."""

from __future__ import annotations


class Refused(Exception):
    """A certificate or a run proves nothing; `line` (from 1; 0 where there is none) and the reason."""

    def __init__(self, line: int, reason: str) -> None:
        self.line, self.reason = line, reason
        super().__init__(f"line {line}: {reason}" if line else reason)


class Unusable(Exception):
    """There is nothing to check: a file is missing or cannot be read."""
