"""What searches tell of themselves, as plain values: results keep them, and load no search for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from cpcal.common.numbers import at_least, gap_text
from cpcal.solver.contract import Named, Verdict, elements

if TYPE_CHECKING:
    from cpcal.solver.network import ConstraintNetwork


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
    checked: bool


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


# ------------------------------------------------------------------------------------------------------------------
# Which rows the contractors of a search cannot use: counted, so that nobody relies on rows that do nothing.


@dataclass(frozen=True)
class RowUse:
    """rows     elements of all constraints, an objective that is no variable among them
    unused   for each contractor that leaves some of them alone, how many
    by_none  how many no contractor uses: they take part in proofs of existence alone
    """

    rows: int
    unused: tuple[tuple[str, int], ...]
    by_none: int

    @property
    def sentence(self) -> str:
        """To be printed where some contractor leaves rows alone, else empty."""
        parts = [f"{name} cannot use {count} of {self.rows} rows" for name, count in self.unused]
        if self.unused and self.by_none:
            parts.append(f"{self.by_none} {'is' if self.by_none == 1 else 'are'} used by none")
        return "; ".join(parts)


def row_use(network: ConstraintNetwork, named: Sequence[Named], origin: Sequence[int] | None = None) -> RowUse:
    """Of the contractors of a search, with their names, which were built for the network or for one made of it.

    `origin`: of each constraint of that one, the number of the constraint that it stands for.
    """
    size = [c.body.size for c in network.constraints]
    origin = range(len(size)) if origin is None else origin
    left = []
    for name, contractor in named:
        declared = (frozenset(getattr(part, "unused_constraints", ())) for part in elements(contractor))
        unused = frozenset.intersection(*declared)  # what each part leaves alone, by number
        used = {old for new, old in enumerate(origin) if new not in unused}
        left.append((name, frozenset(range(len(size))) - used))
    nobody = frozenset.intersection(*(which for _, which in left)) if left else frozenset[int]()
    counts = [(name, sum(size[k] for k in which)) for name, which in left if which]
    return RowUse(sum(size), tuple(counts), sum(size[k] for k in nobody))
