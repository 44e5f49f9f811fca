"""What a search found: boxes that hold single solutions, boxes of solutions, boxes that may hold some."""

from __future__ import annotations

from dataclasses import dataclass

from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box, Interval, IntervalArray
from cpcal.solver.interval.box import Variable
from cpcal.solver.row_use import RowUse
from cpcal.solver.search.regions import hull, volume


@dataclass(frozen=True)
class Solution:
    """A box of a `Paving`: PROVED, it holds exactly one solution; UNKNOWN, it may hold solutions.

    Boxes that touch, and those that touch them, have the same `cluster`.
    """

    verdict: Verdict
    box: Box
    cluster: int = 0

    def __getitem__(self, name: str | Variable) -> Interval | IntervalArray:
        """`solution[x]`: what its box says of a component (by name) or a variable."""
        return self.box[name]


@dataclass(frozen=True)
class Paving:
    """Every solution in the domain lies in one of `solutions` or of `inside`; `complete` is False when a limit came
    first. `status` says it in a sentence.

    `inside` (all points are solutions) and `outside` (none is, but on faces shared with other boxes) are filled by
    `solve(inner=True)`; with the boxes of `solutions` they cover the domain.
    """

    complete: bool
    status: str
    solutions: tuple[Solution, ...]
    nodes: int
    inside: tuple[Box, ...] = ()
    outside: tuple[Box, ...] = ()
    method: str = ""  # contractors and strategy: what was chosen, and why
    width: float = 0.0  # of boxes that are not divided further
    row_use: RowUse | None = None  # of the contractors that came to this answer

    @property
    def boundary(self) -> tuple[Box, ...]:
        """The boxes that may hold solutions."""
        return tuple(s.box for s in self.solutions if s.verdict is Verdict.UNKNOWN)

    @property
    def clusters(self) -> tuple[Box, ...]:
        """The hull of each cluster of `solutions`: neighbours that may be about one and the same solution."""
        members: dict[int, list[Box]] = {}
        for solution in self.solutions:
            members.setdefault(solution.cluster, []).append(solution.box)
        return tuple(hull(boxes) for boxes in members.values())

    @property
    def volume(self) -> Interval:
        """Enclosure of the solution set's volume: that of `inside`, up to that with all boxes of `solutions`."""
        surely, perhaps = volume(self.inside), volume([s.box for s in self.solutions])
        return Interval(surely.lo, (surely + perhaps).hi)
