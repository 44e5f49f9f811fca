"""The contractor algebra: `a >> b` (then), `a | b` (hull of both), `fixpoint(a)`.

`contractors.hc4.HC4` and the others inherit the operators from `Composable`; a third party's contractor
joins in as soon as one operand does.
"""

from __future__ import annotations

import numpy as np

from cpcal.solver.contract import Contraction, Contractor
from cpcal.solver.interval import Box


class Composable:
    """Operators for contractors."""

    idempotent = False

    def contract(self, box: Box) -> Contraction:
        raise NotImplementedError

    def __rshift__(self, other: Contractor) -> Contractor:
        return Then(self, other)

    def __rrshift__(self, other: Contractor) -> Contractor:
        return Then(other, self)

    def __or__(self, other: Contractor) -> Contractor:
        return Union(self, other)

    def __ror__(self, other: Contractor) -> Contractor:
        return Union(other, self)


class Then(Composable):
    """`first`, then `second` on what is left: solutions of both."""

    def __init__(self, first: Contractor, second: Contractor) -> None:
        self._first, self._second = first, second
        self.monotone_tolerance = _tolerance(first) + _tolerance(second)

    def contract(self, box: Box) -> Contraction:
        one = self._first.contract(box)
        return one if one.box.is_empty else followed(one, self._second.contract(one.box))


class Union(Composable):
    """Hull of what either leaves: solutions of one or the other. Its steps prove nothing alone: none."""

    def __init__(self, first: Contractor, second: Contractor) -> None:
        self._first, self._second = first, second
        self.monotone_tolerance = max(_tolerance(first), _tolerance(second))

    def contract(self, box: Box) -> Contraction:
        one, two = self._first.contract(box), self._second.contract(box)
        programs = one.programs + two.programs
        return Contraction(one.box.hull(two.box), (), one.point if one.point is not None else two.point, programs)


class Fixpoint(Composable):
    """`inner` again and again, while some width shrinks below `ratio` times what it was."""

    monotone_tolerance = np.inf  # a part may stop at once where the whole goes on shrinking

    def __init__(self, inner: Contractor, ratio: float = 0.9, most: int = 100) -> None:
        if not 0.0 < ratio <= 1.0:
            raise ValueError(f"ratio is in (0, 1], not {ratio}")
        self._inner, self._ratio, self._most = inner, ratio, most

    def contract(self, box: Box) -> Contraction:
        total = Contraction(box)
        for _ in range(self._most):
            step = self._inner.contract(total.box)
            before, after = total.box, step.box
            total = followed(total, step)
            if after.is_empty or not shrunk(before, after, self._ratio):
                break
        return total


def followed(one: Contraction, two: Contraction) -> Contraction:
    """Two contractions in sequence as one: what holds in the second's box holds for all solutions in the first's."""
    return Contraction(
        box=two.box,
        steps=one.steps + two.steps,
        point=two.point if two.point is not None else one.point,
        programs=one.programs + two.programs,
        polyhedron=two.polyhedron or one.polyhedron,
    )


def _tolerance(contractor: Contractor) -> float:
    """How far from monotone (see cpcal.solver.testing), as a share of the box."""
    return float(getattr(contractor, "monotone_tolerance", 1e-9))


def fixpoint(inner: Contractor, ratio: float = 0.9) -> Fixpoint:
    """Repeat `inner` while some width shrinks below `ratio` times what it was."""
    return Fixpoint(inner, ratio)


def shrunk(before: Box, after: Box, ratio: float) -> bool:
    """Whether some component became narrower than `ratio` times its width (an infinite one: finite)."""
    return bool((after.width < ratio * before.width).any())
