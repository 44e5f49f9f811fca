"""The structures of a network's relaxations: of all measurements where they are few, else of those that say most.

Few rows are ever active. Where a network has very many rows for its unknowns, a box gets those that its midpoint
violates most, and some that are spread over all: the others could only make its relaxation tighter, so leaving them out
loses no solution.
"""

from __future__ import annotations

from copy import copy
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
_KEPT = 8  # structures of other reading sets
_MUCH = 0.25  # of a width: from here on rows are expanded again
_SHARE = 256  # one of so many, where that is more: of 31,000 measurements 128 left out some that decide


class Structures:
    """Those of one network on any boxes. What two boxes in a row have in common is made once.

    `objective`: the variable whose smallest value is sought on boxes where it has a width; few rows decide that.
    """

    def __init__(self, network: ConstraintNetwork, arithmetic: Arithmetic, objective: int | None) -> None:
        self._network, self._arithmetic, self._objective = network, arithmetic, objective
        elements = sum(int(np.prod(c.body.shape[:1])) for c in network.constraints)
        self._share = elements // _SHARE
        self._rows = Rows(network) if elements > max(_MANY, _MANY_EACH * len(network.names)) else None
        self.by_box = self._rows is not None or any(map(reads, network.constraints))  # else one serves all boxes
        self._made: _Expanded | None = None

    def on(self, box: Box, deadline: float) -> Structure:
        """For a bounded box (any box where `by_box` is false); rows that are not expanded at `deadline` are missing."""
        return self.of(None if self._rows is None else self._rows.telling(box.mid, self._most(box)), box, deadline)

    def of(self, keep: list[Indices] | None, box: Box, deadline: float) -> Structure:
        """The same of those elements of each constraint; None: of all."""
        if self._made is None or not self._made.has(keep):
            self._made = _Expanded(self._network, keep, self._arithmetic, deadline)
        return self._made.on(box)

    def restricted_to(self, elements: Indices) -> RestrictedStructures:
        """Those of some elements (along the leading axis) of every constraint alone."""
        return RestrictedStructures(self if self._rows is None else copy(self), elements)

    def alone(self, elements: Indices, box: Box, deadline: float) -> Structure:
        """Of some elements, on a box. Where few are expanded for all, those that are serve these too."""
        if self._rows is not None:
            return self.of([elements] * len(self._network.constraints), box, deadline)
        structure = self.of(None, box, deadline)
        shapes = [c.body.shape for c in self._network.constraints]
        width = np.array([max(int(np.prod(shape[1:])), 1) for shape in shapes], np.intp)
        constraint, element = structure.system.origin.T
        apart = np.array([bool(shape) for shape in shapes], np.bool_)[constraint]
        rows = np.flatnonzero(~apart | np.isin(element // width[constraint], elements))
        return structure.part(rows, np.zeros(len(structure.used), np.bool_))

    def _most(self, box: Box) -> int:
        """Elements for each side of a constraint."""
        seeking = self._objective is not None and bool(box.rad[self._objective] > 0.0)
        return max(_TELLING if seeking else _ENCLOSING, self._share)


class RestrictedStructures:
    """Those of some elements of every constraint alone, for one search.

    Few rows shrink a box in many small steps. Rows that were expanded for a box hold in all of it, and so they serve
    the boxes within it that are not much smaller.
    """

    def __init__(self, whole: Structures, elements: Indices) -> None:
        self._whole, self._elements = whole, elements
        self._last: tuple[Box, Structure] | None = None

    @property
    def by_box(self) -> bool:
        return self._whole.by_box

    def on(self, box: Box, deadline: float) -> Structure:
        """As `Structures.on`."""
        last = self._last
        if last is not None and _near(box, last[0]):
            return last[1]
        structure = self._whole.alone(self._elements, box, deadline)
        self._last = box, structure
        return structure


def _near(box: Box, other: Box) -> bool:
    """Whether a box lies in another one and is not much smaller in any direction."""
    return box.subset(other) and bool((box.width >= _MUCH * other.width).all())


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
        self._known: dict[bytes, Structure] = {}  # by the reading sets, the latest last

    def has(self, keep: list[Indices] | None) -> bool:
        """Whether it is of these elements."""
        if keep is None or self._keep is None:
            return keep is self._keep
        return all(map(np.array_equal, keep, self._keep))

    def on(self, box: Box) -> Structure:
        """With the readings at the ends that decide on all of the box.

        Those of the boxes before are kept: another question about the same network comes by the same ends.
        """
        sets = None if self._decisive is None else self._decisive.on(box)
        key = b"".join(b for own in sets or () for part in own.values() for b in (part.lo.tobytes(), part.hi.tobytes()))
        structure = self._known.pop(key, None)
        if structure is None:
            system = self._forms.on(sets)
            if self._keep is not None:
                system = replace(system, origin=_original(system.origin, self._network, self._keep))
            structure = Structure(system)
            while len(self._known) >= _KEPT:
                del self._known[next(iter(self._known))]
        self._known[key] = structure
        return structure

    def __getstate__(self) -> dict[str, object]:
        """Without those that were made, which may be large."""
        return self.__dict__ | {"_known": {}}


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
