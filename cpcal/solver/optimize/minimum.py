"""What a minimisation says: a bracket at every moment, and the minimum at its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.accounts import ContractorUse, Found, bracket_sentence
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box, Interval
from cpcal.solver.interval.box import Variable
from cpcal.solver.optimize.incumbent import Incumbent
from cpcal.solver.optimize.witness import Witness
from cpcal.solver.row_use import RowUse


@dataclass(frozen=True)
class Bracket:
    """The state of a minimisation: the optimum lies in `[lo, hi]` (hi infinite: no point proved yet).

    `pending` boxes are undecided.
    """

    lo: float
    hi: float
    nodes: int
    programs: int
    seconds: float
    pending: int = 0

    @property
    def rate(self) -> float:
        """Boxes a second."""
        return self.nodes / self.seconds if self.seconds > 0.0 else 0.0


@dataclass(frozen=True)
class Point:
    """A point (n,) whose components have names."""

    names: tuple[str, ...]
    values: Floats

    def __getitem__(self, name: str | Variable) -> float | Floats:
        """A component by its name, or the value of a variable, of its shape."""
        found = Box(self.names, self.values, self.values)[name]
        return found.lo if isinstance(found, Interval) else np.array(found.lo)


@dataclass(frozen=True)
class Minimum:
    """The end of a minimisation over a box.

    `lo`: proved, no solution has a smaller objective. `hi` and `witness`: a proved solution. `enclosure`: holds every
    solution with objective <= hi. `verdict` PROVED: the two bounds are no further apart than the gap asked for, or the
    smallest value of the domain is attained; REFUTED: there is no solution. `floor`: the second-order effect of the
    readings at the witness; boxes are not divided to close a smaller gap (though contraction alone often closes it).
    `rows`: the (constraint, element) pairs with a multiplier in some step of the proof of `lo`; `decisive_rows`: those
    of the steps that decided the leaves. `contractors_used`: those asked for, in their order.

    With a certificate all this is what it proves, and `found` is what the contractors prove beyond it, None if nothing.
    """

    lo: float
    hi: float
    verdict: Verdict
    status: str
    witness: Witness | None
    enclosure: Box
    floor: float
    rows: tuple[tuple[int, int], ...]
    decisive_rows: tuple[tuple[int, int], ...]
    pending: int
    nodes: int
    programs: int
    seconds: float
    interrupted: bool = False
    contractors_used: tuple[ContractorUse, ...] = ()
    found: Found | None = None
    names: tuple[str, ...] = ()  # of the components of points
    relax: float = 0.0  # by how much equations may be missed
    method: str = ""  # which contractors, and why these
    row_use: RowUse | None = None

    @property
    def solution(self) -> Point | None:
        """The proved point by names and variables: `minimum.solution["x[0]"]`, `minimum.solution[x]`."""
        return None if self.witness is None else Point(self.names, self.witness.point)

    @property
    def beyond(self) -> str:
        """What the contractors prove beyond the certificate, to follow a sentence; it is part of `status`."""
        return "" if self.found is None else self.found.sentence(self.lo)


def status_of(last: Bracket, incumbent: Incumbent, undecided: int) -> tuple[Verdict, str]:
    """The verdict on a bracket and a sentence; `undecided` boxes were left at a limit."""
    verdict = Verdict.UNKNOWN
    if incumbent.witness is None:
        if not undecided and last.lo == np.inf:
            verdict = Verdict.REFUTED
    elif last.hi == incumbent.domain.lo[incumbent.objective]:
        return Verdict.PROVED, "The smallest value that the domain allows is attained: proved."
    elif last.hi - last.lo <= incumbent.gap:
        verdict = Verdict.PROVED
    hi = np.inf if incumbent.witness is None else last.hi
    return verdict, bracket_sentence(verdict, last.lo, hi, floor=incumbent.floor, undecided=undecided)
