"""What searches tell of themselves, as plain values: results keep them, and load no search for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from cpcal.common.numbers import at_least, gap_text
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box

_DIGITS = 10  # of two lower bounds that differ


@dataclass(frozen=True)
class ContractorUse:
    """How much a contractor that was asked for took part.

    calls            how often it ran
    steps            bounds that it moved, and boxes that it proved empty
    certified_steps  those of its steps that the certificate holds: 0 where none was written
    """

    name: str
    calls: int = 0
    steps: int = 0
    certified_steps: int = 0


def total_use(one: tuple[ContractorUse, ...], two: tuple[ContractorUse, ...]) -> tuple[ContractorUse, ...]:
    """The sum, contractor by contractor; nobody is ()."""
    if not (one and two):
        return one or two
    pairs = zip(one, two, strict=True)
    return tuple(replace(a, calls=a.calls + b.calls, steps=a.steps + b.steps) for a, b in pairs)


class TimeoutAnswer(Enum):
    """What the solver says of one eps."""

    INFEASIBLE = "infeasible"
    FOUND = "found"
    TIMEOUT = "timeout"


@dataclass(frozen=True)
class Trial:
    """One call of the solver: is there a point with an objective up to `eps`, within `delay` seconds?

    `lo` and `hi`: the bracket afterwards. `checked`: the infeasible answer has a certificate.
    """

    eps: float
    delay: float
    answer: TimeoutAnswer
    lo: float
    hi: float
    nodes: int
    programs: int
    seconds: float
    checked: bool = False


@dataclass(frozen=True)
class Found:
    """What all contractors together prove, where a certificate proves less: see `Minimum`."""

    lo: float
    enclosure: Box

    def sentence(self, certified: float) -> str:
        """To follow another one; `certified` is the lower bound that the certificate proves."""
        if self.lo == np.inf:
            return " All contractors together prove that there is no solution; the certificate does not."
        if self.lo > certified:
            found, proved = at_least(self.lo, _DIGITS), at_least(certified, _DIGITS)
            return f" All contractors together prove the lower bound {found}; the certificate proves {proved}."
        return " All contractors together prove a smaller enclosure than the certificate."


def bracket_sentence(verdict: Verdict, lo: float, hi: float, *, floor: float, undecided: int) -> str:
    """How a search ended, said of its numbers; `hi` is infinite without a proved point."""
    if verdict is Verdict.REFUTED:
        return "No point of the domain satisfies the constraints: proved."
    if hi == np.inf:
        return "No point was proved to satisfy the constraints; the lower bound is proved."
    if verdict is Verdict.PROVED:
        return "Both bounds are proved and the gap is closed."
    printed = gap_text(lo, hi)
    if undecided:
        boxes = f"{undecided} undecided box{'' if undecided == 1 else 'es'}"
        return f"Stopped at a limit with {boxes}; both bounds are proved, the gap is open."
    if hi - lo <= floor:
        return (
            f"Both bounds are proved; the gap of {printed} is open. The search ends there, because the second-order "
            f"effect of the readings is {at_least(floor, 2)}."
        )
    return f"Both bounds are proved; the contractors cannot close the gap of {printed}."
