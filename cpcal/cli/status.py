"""Exit statuses: what they mean and which one a result has."""

from __future__ import annotations

from enum import IntEnum

from cpcal.results import Result
from cpcal.solver.contract import Verdict


class Status(IntEnum):
    ANSWERED = 0
    UNKNOWN = 1
    UNUSABLE = 2
    INTERRUPTED = 130


STATUS_HELP = (
    "Exit status: **0** every leg answered (“refuted” is an answer), **1** some leg unknown (a limit was "
    "reached), **2** unusable input (one message lists every problem), **130** interrupted by Ctrl-C, with "
    "what was proved until then written and printed."
)


def status_of(result: Result) -> Status:
    """The exit status that tells of a result."""
    if result.interrupted:
        return Status.INTERRUPTED
    unknown = any(leg.verdict is Verdict.UNKNOWN for leg in result.legs)
    return Status.UNKNOWN if unknown else Status.ANSWERED
