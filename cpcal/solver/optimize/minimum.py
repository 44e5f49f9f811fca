"""What a minimisation says: a bracket at every moment, and the minimum at its end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from cpcal.common.values import Floats, Indices
from cpcal.solver.accounts import ContractorUse, Found, RowUse, bracket_sentence
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import Box, Interval
from cpcal.solver.interval.box import Variable
from cpcal.solver.optimize.local import Incumbent
from cpcal.solver.optimize.witness import Prepared, Witness


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


# ------------------------------------------------------------------------------------------------------------------
# The support of a lower bound: few measurements that prove it by themselves.
#
# What is proved of a support: by its measurements alone, no point of the domain has an objective below the bound.

_ROUNDS = 4  # times that measurements are added
_ADDED = 3  # at a time, for each side of each constraint


@dataclass(frozen=True)
class Alone:
    """What some measurements prove alone: a lower bound, and those of them that have a weight in its proof.

    `point`: a better point than that of all measurements, if these alone allow one.
    """

    lo: float
    members: frozenset[int]
    point: Floats | None
    interrupted: bool


Solve = Callable[[Indices], Alone]


def support(problem: Prepared, found: Minimum, gap: float, solve: Solve) -> tuple[int, ...]:
    """Elements (along the constraints' leading axis) that alone prove `found.lo` up to the relative `gap`.

    It begins with those that decided the leaves; while they alone allow a better point, those join that it violates
    most. Where that does not end soon, or is interrupted: all that had a weight in some step. () when there is
    nothing to prove.
    """
    domain = problem.network.domain
    if not found.lo > domain[problem.name].lo or found.interrupted:
        return ()
    chosen = np.array(sorted({k for _, k in found.decisive_rows}), dtype=np.intp)
    for _ in range(_ROUNDS if chosen.size else 0):
        alone = solve(chosen)
        if alone.interrupted:
            break
        if _as_good(alone.lo, found, gap):
            return tuple(int(k) for k in chosen)
        if alone.point is None:
            break
        violated = problem.rows.likely(domain.with_bounds(alone.point, alone.point), _ADDED)
        more = np.unique(np.concatenate([chosen, *violated]))
        if more.size == chosen.size:
            break
        chosen = more
    return tuple(sorted({k for _, k in found.rows}))


def irreducible(found: Minimum, chosen: tuple[int, ...], gap: float, solve: Solve) -> tuple[int, ...]:
    """A part of `chosen` that still proves `found.lo`, from which no element could be left out (deletion filter).

    Groups are tried first, half of all and then ever smaller ones, each by a proof with the others alone; whatever has
    no weight in a proof goes at once. An element whose need is not known stays.
    """
    kept, size = list(chosen), max(len(chosen) // 2, 1)
    while True:
        tried = 0
        while tried < len(kept):
            others = kept[:tried] + kept[tried + size :]
            alone = solve(np.array(others, dtype=np.intp)) if others else None
            if alone is not None and alone.interrupted:
                return tuple(kept)
            if alone is not None and _as_good(alone.lo, found, gap):
                needed = sum(k in alone.members for k in kept[:tried])
                kept, tried = [k for k in others if k in alone.members], needed
            else:
                tried += size
        if size == 1:
            return tuple(kept)
        size = max(min(size, len(kept)) // 2, 1)


def _as_good(lo: float, found: Minimum, gap: float) -> bool:
    return lo >= found.lo or lo >= found.lo - max(gap * abs(found.lo), found.hi - found.lo)


# ------------------------------------------------------------------------------------------------------------------
# Small sets that meet all of a family: what must be left out before none of several proofs holds.


def hitting_set(family: Sequence[Collection[int]], most: int) -> frozenset[int] | None:
    """At most `most` numbers of which every set of the family holds one; None when there are none.

    Exact: a set that is not met must lose one of its members, and all are tried, those of many sets first.
    """
    left = [frozenset(one) for one in family]
    return _hit(left, most)


def _hit(left: list[frozenset[int]], most: int) -> frozenset[int] | None:
    if not left:
        return frozenset()
    if most == 0 or _apart(left) > most:
        return None
    smallest = min(left, key=len)
    counts = Counter(k for one in left for k in one)
    for k in sorted(smallest, key=lambda k: (-counts[k], k)):
        found = _hit([one for one in left if k not in one], most - 1)
        if found is not None:
            return found | {k}
    return None


def _apart(family: list[frozenset[int]]) -> int:
    """How many sets of the family have no common member, chosen greedily: so many numbers are needed at least."""
    taken: set[int] = set()
    count = 0
    for one in sorted(family, key=len):
        if taken.isdisjoint(one):
            taken |= one
            count += 1
    return count
