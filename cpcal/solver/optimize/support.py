"""The support of a lower bound: few measurements that prove it by themselves.

What is proved of a support: by its measurements alone, no point of the domain has an objective below the bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.solver.optimize.minimum import Minimum
from cpcal.solver.optimize.prepared import Prepared

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
