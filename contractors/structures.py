"""The structures of a network's relaxations: of all measurements where they are few, else of those that say most.

Few rows are ever active. Where a network has very many rows for its unknowns, a box gets those that its midpoint
violates most, and some that are spread over all: the others could only make its relaxation tighter, so leaving them out
loses no solution.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from contractors.relaxation import Structure
from cpcal.common.arrays import Indices
from cpcal.solver.existence import reads
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.monotone import DecisiveReadings
from cpcal.solver.network.polynomial_rows import PolynomialForms
from cpcal.solver.network.restrict import restricted
from cpcal.solver.network.rows import Rows

_MANY = 4096  # elements of constraints, beyond which only those that say most about a box are expanded,
_MANY_EACH = 64  # if they are so many for each unknown
_TELLING = 128  # of them for each side of a constraint, and as many that are spread over all
_ENCLOSING = 1024  # the same where no objective is sought: then the enclosure is the answer
_SHARE = 256  # one of so many, where that is more: of 31,000 measurements 128 left out some that decide


class Structures:
    """Those of one network on any boxes. What two boxes in a row have in common is made once.

    `seeking`: the smallest value of an objective, which few rows decide.
    """

    def __init__(self, network: ConstraintNetwork, arithmetic: Arithmetic, *, seeking: bool) -> None:
        self._network, self._arithmetic = network, arithmetic
        elements = sum(int(np.prod(c.body.shape[:1])) for c in network.constraints)
        self._most = max(_TELLING if seeking else _ENCLOSING, elements // _SHARE)
        self._rows = Rows(network) if elements > max(_MANY, _MANY_EACH * len(network.names)) else None
        self.by_box = self._rows is not None or any(map(reads, network.constraints))  # else one serves all boxes
        self._made: _Expanded | None = None

    def on(self, box: Box, deadline: float) -> Structure:
        """For a bounded box (any box where `by_box` is false); rows that are not expanded at `deadline` are missing."""
        keep = None if self._rows is None else self._rows.telling(box.mid, self._most)
        if self._made is None or not self._made.has(keep):
            self._made = _Expanded(self._network, keep, self._arithmetic, deadline)
        return self._made.on(box)


class _Expanded:
    """The polynomial forms of some elements of a network's constraints; None: of all."""

    def __init__(
        self, network: ConstraintNetwork, keep: list[Indices] | None, arithmetic: Arithmetic, deadline: float
    ) -> None:
        self._network, self._keep = network, keep
        some = network if keep is None else restricted(network, keep)
        self._forms = PolynomialForms(some, arithmetic, deadline)
        read = any(map(reads, some.constraints))
        self._decisive = DecisiveReadings(some, arithmetic) if read else None
        self._last: tuple[bytes, Structure] | None = None

    def has(self, keep: list[Indices] | None) -> bool:
        """Whether it is of these elements."""
        if keep is None or self._keep is None:
            return keep is self._keep
        return all(map(np.array_equal, keep, self._keep))

    def on(self, box: Box) -> Structure:
        """With the readings at the ends that decide on all of the box: that of before, if they are the same ends."""
        sets = None if self._decisive is None else self._decisive.on(box)
        key = b"".join(b for own in sets or () for part in own.values() for b in (part.lo.tobytes(), part.hi.tobytes()))
        if self._last is None or self._last[0] != key:
            system = self._forms.on(sets)
            if self._keep is not None:
                system = replace(system, origin=_original(system.origin, self._network, self._keep))
            self._last = key, Structure(system)
        return self._last[1]


def _original(origin: Indices, network: ConstraintNetwork, keep: list[Indices]) -> Indices:
    """Constraint and element in the whole network of each row of a restricted one."""
    kept = [c for c, rows in enumerate(keep) if rows.size or not network.constraints[c].body.shape]
    out = origin.copy()
    for new, old in enumerate(kept):
        mine = origin[:, 0] == new
        out[mine, 0] = old
        shape = network.constraints[old].body.shape
        if shape:
            width = max(int(np.prod(shape[1:])), 1)
            element = origin[mine, 1]
            out[mine, 1] = keep[old][element // width] * width + element % width
    return out
