"""Which rows the contractors of a search cannot use: counted, so that nobody relies on rows that do nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cpcal.solver.contract import Contractor, elements
from cpcal.solver.network import ConstraintNetwork


@dataclass(frozen=True)
class RowUse:
    """rows     elements of all constraints, an objective that is no variable among them
    unused   for each contractor that leaves some of them alone, how many
    by_none  how many no contractor uses: they take part in proofs of existence alone
    """

    rows: int
    unused: tuple[tuple[str, int], ...] = ()
    by_none: int = 0

    @property
    def sentence(self) -> str:
        """To be printed where some contractor leaves rows alone, else empty."""
        parts = [f"{name} cannot use {count} of {self.rows} rows" for name, count in self.unused]
        if self.unused and self.by_none:
            parts.append(f"{self.by_none} {'is' if self.by_none == 1 else 'are'} used by none")
        return "; ".join(parts)


def row_use(
    network: ConstraintNetwork, named: Sequence[tuple[str, Contractor]], origin: Sequence[int] | None = None
) -> RowUse:
    """Of the contractors of a search, with their names, which were built for the network or for one made of it.

    `origin`: of each constraint of that one, the number of the constraint that it stands for.
    """
    size = [math.prod(c.body.shape) for c in network.constraints]
    origin = range(len(size)) if origin is None else origin
    left = []
    for name, contractor in named:
        unused = _unused(contractor)
        used = {old for new, old in enumerate(origin) if new not in unused}
        left.append((name, frozenset(range(len(size))) - used))
    nobody = frozenset.intersection(*(which for _, which in left)) if left else frozenset[int]()
    counts = [(name, sum(size[k] for k in which)) for name, which in left if which]
    return RowUse(sum(size), tuple(counts), sum(size[k] for k in nobody))


def _unused(contractor: Contractor) -> frozenset[int]:
    """What none of its parts uses: each may declare the constraints, by number, that it leaves alone."""
    return frozenset.intersection(*(frozenset(getattr(p, "unused_constraints", ())) for p in elements(contractor)))
