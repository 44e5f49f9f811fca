"""Why nothing is proved."""

from __future__ import annotations


class Refused(Exception):
    """A certificate or a run proves nothing: the reason, its code, and the line (from 1; 0 where there is none).

    Codes: "form" (a line is not as the format has it), "limit" (of this checker), "campaign" (campaign.json cannot be
    used, or is another one), "proof" (what is claimed is not proved), "run" (result.json states something else).
    """

    def __init__(self, reason: str, code: str = "form", line: int | None = None) -> None:
        self.reason, self.code, self.line = reason, code, line
        super().__init__(f"line {line}: {reason}" if line else reason)

    def at(self, line: int) -> Refused:
        """In that line, unless it is known to be elsewhere."""
        return Refused(self.reason, self.code, line if self.line is None else self.line)


class Unusable(Exception):
    """There is nothing to check: a file is missing or cannot be read."""
