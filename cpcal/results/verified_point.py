"""A given point of one leg, measurement by measurement, as plain values (section 5.1.2 of the paper)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cpcal.common.numbers import stated
from cpcal.solver.contract import Verdict


@dataclass(frozen=True)
class VerifiedPoint:
    """Of N measurements at tolerance `eps` (mm): how many the point is proved to satisfy, and to fail.

    It satisfies measurement k when THERE EXISTS a reading in its set with |g(x, M_k)| <= eps (and the leg is longer
    than eps); it fails when there is none. Of the others nothing is proved.
    """

    eps: float
    holds: int
    fails: int
    count: int

    def __post_init__(self) -> None:
        """Raises ValueError for counts that do not go together."""
        if min(self.holds, self.fails) < 0 or self.holds + self.fails > self.count:
            raise ValueError("holds and fails are not counts of the measurements")
        if not 0.0 <= self.eps < math.inf:
            raise ValueError("eps is no tolerance")

    @property
    def verdict(self) -> Verdict:
        """Of the statement that the point is a solution."""
        if self.fails:
            return Verdict.REFUTED
        return Verdict.PROVED if self.holds == self.count else Verdict.UNKNOWN

    def sentence(self, name: str) -> str:
        """What is proved of the point called `name`."""
        within = "exactly" if self.eps == 0.0 else f"to within {stated(self.eps)} mm"
        equations = f"{self.holds:,} of the {self.count:,} equations {within} for some readings in their sets"
        if self.verdict is Verdict.PROVED:
            return f"{name} is a solution: it satisfies all {self.count:,} equations {within} for some readings."
        refuting = f"{self.fails:,} measurement{'' if self.fails == 1 else 's'} refute it" if self.fails else ""
        unknown = self.count - self.holds - self.fails
        rest = [text for text in (refuting, f"{unknown:,} are undecided" if unknown else "") if text]
        return f"{name} satisfies {equations}; {', '.join(rest)}."
