"""The support of a lower bound: few measurements that prove it by themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.restrict import restricted
from cpcal.solver.network.rows import Rows
from cpcal.solver.optimize.minimum import Minimum

Solve = Callable[[ConstraintNetwork], Minimum]
Elements = npt.NDArray[np.intp]

_ROUNDS = 4  # times that measurements are added
_ADDED = 3  # at a time, for each side of each constraint


def support(network: ConstraintNetwork, objective: str, found: Minimum, gap: float, solve: Solve) -> tuple[int, ...]:
    """Elements (along the constraints' leading axis) that alone prove `found.lo` up to the relative `gap`.

    It begins with those that decided the leaves; while they alone allow a smaller optimum, those join that this optimum
    violates most. Where that does not end soon, or is interrupted: all that had a weight in some step. () when there is
    nothing to prove.
    """
    if not found.lo > network.domain[objective].lo or found.interrupted:
        return ()
    rows = Rows(network)
    chosen = np.array(sorted({k for _, k in found.decisive_rows}), dtype=np.intp)
    for _ in range(_ROUNDS if chosen.size else 0):
        alone = solve(restricted(network, [chosen] * len(network.constraints)))
        if alone.interrupted:
            break
        if _as_good(alone.lo, found, gap):
            return tuple(int(k) for k in chosen)
        if alone.witness is None:
            break
        point = alone.witness.point
        violated = rows.likely(network.domain.with_bounds(point, point), _ADDED)
        more = np.unique(np.concatenate([chosen, *violated]))
        if more.size == chosen.size:
            break
        chosen = more
    return tuple(sorted({k for _, k in found.rows}))


def irreducible(
    network: ConstraintNetwork, found: Minimum, chosen: tuple[int, ...], gap: float, solve: Solve
) -> tuple[int, ...]:
    """A part of `chosen` that still proves `found.lo`, from which no element could be left out (deletion filter).

    Elements are tried in order, each time by a proof with the others alone; one whose need is not known stays.
    """
    kept = list(chosen)
    for element in chosen:
        others = np.array([k for k in kept if k != element], dtype=np.intp)
        if others.size:
            alone = solve(restricted(network, [others] * len(network.constraints)))
            if alone.interrupted:
                break
            if _as_good(alone.lo, found, gap):
                kept.remove(element)
    return tuple(kept)


def _as_good(lo: float, found: Minimum, gap: float) -> bool:
    return lo >= found.lo or lo >= found.lo - max(gap * abs(found.lo), found.hi - found.lo)
