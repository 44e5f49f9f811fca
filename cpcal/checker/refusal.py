"""Why a certificate was not accepted. Standard library only; part of the checker."""

from __future__ import annotations


class Refused(Exception):
    """The certificate proves nothing; `line` (from 1; 0 for the campaign) and the reason."""

    def __init__(self, line: int, reason: str) -> None:
        self.line, self.reason = line, reason
        super().__init__(f"line {line}: {reason}" if line else reason)
