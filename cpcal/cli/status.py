"""Exit statuses: what they mean."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    ANSWERED = 0
    UNKNOWN = 1
    UNUSABLE = 2
    INTERNAL = 3
    INTERRUPTED = 130
    TERMINATED = 143


STATUS_HELP = (
    "Exit status: **0** every leg answered, or with --tolerance every leg passes, **1** some leg undecided (a limit "
    "came first, or the search ended at the second-order effect of the readings, or where contractors end), or "
    "with --tolerance some leg that does not pass, **2** unusable input (one message lists every problem), **3** an "
    "internal error (please report it), **130** interrupted by Ctrl-C or **143** terminated by SIGTERM, with what was "
    "proved until then written and printed."
)

HAND_EYE_STATUS_HELP = (
    "Exit status: **0** the bracket is closed, or with --tolerance the tolerance is met, **1** the bracket is open, or "
    "with --tolerance it is not met or undecided, **2** unusable input (one message lists every problem), **3** an "
    "internal error (please report it), **130** interrupted, **143** terminated."
)

SOLVE_STATUS_HELP = (
    "Exit status: **0** complete (that there is no solution is an answer too), **1** a limit came first, or the "
    "certificate does not hold all of the answer, **2** unusable input, **3** an internal error, **130** interrupted, "
    "**143** terminated."
)

VERIFY_STATUS_HELP = "Exit status: **0** every certificate proved, **1** one refused, **2** unusable input."

CHECK_STATUS_HELP = (
    "Exit status: **0** nothing looks wrong, **1** something is to be looked at (each with a sentence), "
    "**2** unusable input."
)

IMPORT_STATUS_HELP = (
    "Exit status: **0** the campaign was written (or looks right, with --preview), **1** nothing was written, since "
    "the data look mixed up, **2** unusable input."
)
