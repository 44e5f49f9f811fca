"""Existence and uniqueness by strict inclusion: a box that holds exactly one solution of a network."""

import math
import time
from collections.abc import Iterable, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from cpcal.common.errors import ModelError
from cpcal.common.values import Bools, Floats, Indices, all_finite, floats
from cpcal.solver.existence.operators import Equalities, inside, newton_all
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import Constraint, ConstraintNetwork, Expr, Tape, one_sided_rows, rows_tape
from cpcal.solver.network.forms import exactly_zero
from cpcal.solver.network.rows import Extremes

# ------------------------------------------------------------------------------------------------------------------
# Constraints on a box or at a point: rows that are at most zero, and proofs for all readings, or for some.


class ReadingConstraint:
    """One constraint `lower <= body <= upper` with readings.

    With one choice of readings body <= upper and with another body >= lower: then some readings between them satisfy
    both, for the sets are convex and the body is continuous (intermediate value theorem), provided that no component
    of a reading enters two elements of the body, nor the bounds.
    """

    def __init__(self, network: ConstraintNetwork, constraint: Constraint) -> None:
        self._over = constraint.body - constraint.upper
        self._under = constraint.lower - constraint.body
        self._order = constraint.lower - constraint.upper
        self._tape = Tape(network, [self._over, self._under, self._order, constraint.body])
        self._extremes = Extremes(network, constraint.body)
        bounds_read = any("reading" in e.ops for e in (constraint.lower, constraint.upper))
        self._size = constraint.body.size
        self._usable = self._extremes.exclusive and not bounds_read

    def for_all(self, box: IntervalArray) -> Bools:
        """Which elements hold on the box for all readings."""
        slots = self._tape.forward(box)
        ends = [upper_ends(self._tape.value(slots, e), self._size) for e in (self._over, self._under)]
        return np.asarray((np.max(ends, axis=0) <= 0.0) & self._tape.continuous(slots))

    def excesses(self, box: IntervalArray, point: Floats) -> Floats:
        """Element by element a bound of how far some reading is from satisfying it; <= 0: some reading does."""
        slots = self._tape.forward(box)
        if not self._usable or not self._tape.continuous(slots):
            return np.full(self._size, np.inf)
        tape = self._extremes.tape
        places = {leaf: tape.reading_slots[leaf.digest] - tape.program.given for leaf in tape.readings}
        smallest, largest = (
            ({leaf.digest: _inside(ends[places[leaf]], leaf) for leaf in tape.readings})
            for ends in self._extremes.at(point)
        )
        over = self._tape.value(self._tape.forward(box, smallest), self._over)
        under = self._tape.value(self._tape.forward(box, largest), self._under)
        order = self._tape.value(slots, self._order)
        return np.asarray(np.max([upper_ends(x, self._size) for x in (over, under, order)], axis=0))


def excess_for_some(constraints: Iterable[ReadingConstraint], box: IntervalArray, point: Floats) -> float:
    """How far the worst is from holding on a box for some readings, at most; <= 0: all hold for common ones."""
    choosing = [c for c in constraints if not c.for_all(box).all()]
    if len(choosing) > 1:  # two that hold for some readings each need not hold for common ones
        return math.inf
    return max((float(np.max(c.excesses(box, point), initial=-np.inf)) for c in choosing), default=-math.inf)


def _inside(values: Floats, reading: Expr) -> IntervalArray:
    """Values moved surely into a reading's set: its bounds are stored rounded outward by up to two floats."""
    data = reading.data
    lo = np.minimum(np.nextafter(np.nextafter(data.lo, np.inf), np.inf), data.mid)
    hi = np.maximum(np.nextafter(np.nextafter(data.hi, -np.inf), -np.inf), data.mid)
    return IntervalArray.point(np.where(data.lo == data.hi, data.lo, np.clip(values, lo, hi)))


def sides(network: ConstraintNetwork) -> list[list[Expr]]:
    """For each constraint expressions that are at most zero where it holds: none for a bound that is not there.

    An element without any bound asks to be defined: 0 times it.
    """
    constraints = network.constraints
    out, idle = [list[Expr]() for _ in constraints], [np.ones(c.body.size, bool) for c in constraints]
    for row in one_sided_rows(network):
        out[row.constraint].append(row.expr)
        idle[row.constraint][slice(None) if row.elements is None else row.elements] = False
    for constraint, own, places in zip(constraints, out, idle, strict=True):
        if places.any():
            own.append(0.0 * constraint.body.reshape(-1)[np.flatnonzero(places)])
    return out


def upper_ends(x: IntervalArray, size: int) -> Floats:
    """The upper bounds of so many elements, infinite where one is no number."""
    return np.broadcast_to(np.where(x.empty | np.isnan(x.hi), np.inf, x.hi).ravel(), (size,))


def highest(x: IntervalArray) -> float:
    """The largest upper bound; infinite where one is no number."""
    return float(np.max(upper_ends(x, x.lo.size), initial=-np.inf))


def reads(constraint: Constraint) -> bool:
    return any("reading" in part.ops for part in constraint.parts)


# ------------------------------------------------------------------------------------------------------------------
# Whole boxes of solutions: at every point THERE EXIST readings in their sets with which all constraints hold.


class Inside:
    """Proves boxes of one network; False means that it is not known.

    Constraints without readings are evaluated over the box, as are those with readings, which may hold for all of
    them. One constraint may hold for some readings only: with the same two choices on the whole box, see
    `ReadingConstraint`.
    """

    def __init__(self, network: ConstraintNetwork) -> None:
        self._domain = network.domain
        both = zip(network.constraints, sides(network), strict=True)
        self._plain = Tape(network, [e for c, own in both if not reads(c) for e in own])
        self._reading = [ReadingConstraint(network, c) for c in network.constraints if reads(c)]

    def __call__(self, box: Box) -> bool:
        """Whether every point of the box is proved to be a solution, in the domain."""
        if box.is_empty or not box.subset(self._domain):
            return False
        values = box.array[None]
        with np.errstate(all="ignore"):
            slots = self._plain.forward(values)
            plain = self._plain.continuous(slots) and highest(self._plain.values(slots)) <= 0.0
            return plain and excess_for_some(self._reading, values, values.mid[0]) <= 0.0


_POLISH = 12  # Newton steps in floating point before anything is proved
_AROUND = 4  # inflations of a box
_FROM_POINT = 10  # and of a point
_REFINEMENTS = 20
_INFLATE = 0.1  # of the width, on both sides
_FLOATS = 32  # units in the last place that are added as well
_LEAST = 1e-16  # of the domain, so that a zero at 0 gets some room


class Unique(NamedTuple):
    """`box` holds exactly one solution, and `region` (around it) no other."""

    box: Box
    region: Box


class UniquenessProver:
    """Proves single solutions of one network, where it has as many equations as unknowns.

    The equations must be free of readings (else solutions are no single points). The other constraints, and the
    domain, must hold on the whole box that is found. A component whose domain is one number is no unknown. Nothing
    more is proved at the `deadline` (of time.monotonic()).
    """

    def __init__(self, network: ConstraintNetwork, deadline: float = math.inf) -> None:
        self._network, self._deadline = network, deadline
        self._domain = network.domain
        self._equalities = Equalities.of(network)
        self._rest = Inside(self._equalities.rest)
        self._choose(np.flatnonzero(self._domain.hi > self._domain.lo))

    def _choose(self, unknowns: Indices) -> None:
        self._columns = unknowns
        self._free = np.zeros(len(self._domain))
        self._free[unknowns] = 1.0
        width = self._domain.width
        self._least = np.where(np.isfinite(width), _LEAST * width, 0.0) * self._free

    def among(self, point: Floats, unknowns: Indices) -> "UniquenessProver":
        """The prover for the same equations in some of the unknowns; the others stay at the point's values (n,)."""
        other = copy(self)
        lo, hi = point.copy(), point.copy()
        lo[unknowns], hi[unknowns] = self._domain.lo[unknowns], self._domain.hi[unknowns]
        other._domain = self._domain.with_bounds(lo, hi)
        other._choose(unknowns)
        return other

    @property
    def applies(self) -> bool:
        """Whether the network is of the kind for which something can be proved."""
        return 0 < self._equalities.count == len(self._columns) and not self._equalities.reads

    def prove(self, box: Box) -> Unique | None:
        """The only solution in or next to a bounded box, or None where nothing was proved.

        First a region that covers the box is tried, so that the box is known to hold no second solution; then one
        that grows from the approximate zero until it holds (epsilon-inflation).
        """
        if not self.applies or box.is_empty or not box.is_bounded:
            return None
        box = box.intersect(self._domain)
        center = None if box.is_empty else self._polished(box)
        if center is None:
            return None
        around = IntervalArray(np.minimum(box.lo, center), np.maximum(box.hi, center))
        return self._grown(around, center, _AROUND) or self._grown(IntervalArray.point(center), center, _FROM_POINT)

    def narrowed(self, box: Box) -> Box:
        """The part of a box that the operator, then each row by itself leave; it holds all solutions."""
        tight = box.intersect(self._narrowed(box.array))
        if tight.is_empty:
            return tight
        return tight.intersect(rows_tape(self._network).contract(tight.array[None])[0])

    def _narrowed(self, x: IntervalArray) -> IntervalArray:
        """N(X) again and again, as long as it halves some width; NaN where X holds no zero."""
        box = np.stack([x.lo, x.hi], axis=1)
        if time.monotonic() <= self._deadline:
            newton_all(self._equalities.program, _REFINEMENTS, box[None])
        return IntervalArray(box[:, 0], box[:, 1])

    def _polished(self, box: Box) -> Floats | None:
        """An approximate zero near the box, by Newton's method in floating point."""
        point, columns = box.mid, self._columns
        wide = bool((box.rad[columns] > 0.0).any())  # from a point the zero may be anywhere
        reach = 4.0 * box.rad + 1e-6 * np.abs(point) if wide else np.full(len(point), np.inf)
        for _ in range(_POLISH):
            value, jacobian = self._equalities.rows.linearize(point)
            try:
                step = np.linalg.solve(jacobian[:, columns], value)
            except np.linalg.LinAlgError:
                return None
            new = point.copy()
            new[columns] -= step
            if not all_finite(new) or (np.abs(new - box.mid) > reach).any():
                return box.mid if wide else None
            done = bool((np.abs(new - point) <= np.spacing(np.abs(point))).all())
            point = new
            if done:
                break
        return point

    def _grown(self, start: IntervalArray, center: Floats, tries: int) -> Unique | None:
        """Epsilon-inflation: a region that grows until N(region) lies in its interior."""
        region = self._inflated(start)
        for _ in range(tries):
            box = self._domain.with_bounds(region.lo, region.hi)
            if not box.is_bounded or time.monotonic() > self._deadline:
                return None
            moved = self._equalities.image(box, center, self._columns)
            if moved is None or moved.empty.any():
                return None
            if inside(moved, region, self._columns):
                return self._checked(moved, region)
            # only where it has to be: what one component gains makes the image of the others larger
            tight = (moved.lo <= region.lo) | (moved.hi >= region.hi)
            width = (region.hi - region.lo) * self._free
            grown = self._inflated(IntervalArray(region.lo - width, region.hi + width))
            region = IntervalArray(np.where(tight, grown.lo, region.lo), np.where(tight, grown.hi, region.hi))
        return None

    def _checked(self, image: IntervalArray, region: IntervalArray) -> Unique | None:
        """The zero in `image` narrowed down, if the other constraints hold where it is."""
        narrow = self._narrowed(image)
        tight = self._domain.with_bounds(narrow.lo, narrow.hi)
        if not tight.is_empty and not tight.subset(self._domain):  # then it is known on the boundary alone, as a point
            lo, hi = self._domain.lo, self._domain.hi
            point = np.where(tight.lo < lo, lo, np.where(tight.hi > hi, hi, np.clip(tight.mid, lo, hi)))
            if point not in tight or not exactly_zero(self._network, self._equalities.roots, point):
                return None
            tight = tight.with_bounds(point, point)
        if tight.is_empty or not self._rest(tight):
            return None
        return Unique(tight, self._domain.with_bounds(region.lo, region.hi))

    def _inflated(self, x: IntervalArray) -> IntervalArray:
        """A little larger in every unknown."""
        with np.errstate(over="ignore"):
            more = _INFLATE * (x.hi - x.lo) + _FLOATS * np.spacing(x.mag) + self._least
            return IntervalArray(x.lo - more * self._free, x.hi + more * self._free)


def prove_unique(network: ConstraintNetwork, where: Box | Sequence[float] | Floats) -> Box | None:
    """A box proved to hold exactly one solution of the network, or None: in or next to a box, or the zero that
    Newton's method reaches from a point. It serves networks with as many equations as unknowns.

    Raises ModelError for a point of another dimension.
    """
    if not isinstance(where, Box):
        point = floats(where)
        if point.shape != (len(network.names),):
            raise ModelError(f"a point of this network has {len(network.names)} components, not shape {point.shape}")
        where = Box(network.names, point, point)
    found = UniquenessProver(network).prove(where)
    return None if found is None else found.box
