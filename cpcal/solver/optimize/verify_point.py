"""A given point, element by element: is it proved to satisfy the constraints for some reading, or to fail for all?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Bools, Floats
from cpcal.solver.existence import ReadingConstraint, reads, upper_ends
from cpcal.solver.interval import Arithmetic, Box, IntervalArray
from cpcal.solver.network import Constraint, ConstraintNetwork, Tape, one_sided_rows
from cpcal.solver.network.monotone import DecisiveReadings
from cpcal.solver.network.rewrite import ReadingSets, Row, one_sided


@dataclass(frozen=True)
class PointVerdicts:
    """For each element (along the constraints' leading axis, N of them): proved to hold, proved to fail, or neither."""

    holds: Bools
    fails: Bools


def verify_point(
    network: ConstraintNetwork,
    point: npt.ArrayLike,
    engine: Arithmetic,
    reading: Sequence[ReadingConstraint] | None = None,
) -> PointVerdicts:
    """Verify a point (n,), one value for each component in the order of `names`.

    Element k holds when THERE EXIST readings in their sets with which all constraints hold at k; it fails when some
    constraint does not hold at k for any readings. Constraints of one element count for all. `reading`: those of the
    network with readings, in their order, where they are set up already.
    """
    x = np.asarray(point, np.float64)
    box = IntervalArray.point(x[None])
    count = max((c.body.shape[0] for c in network.constraints if c.body.shape), default=1)
    holds, fails = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    for_some = np.zeros(count, dtype=np.intp)  # constraints at an element that hold, but not for all readings
    set_up = iter(reading or [ReadingConstraint(network, c) for c in network.constraints if reads(c)])
    with np.errstate(all="ignore"):
        for constraint in network.constraints:
            if reads(constraint):
                good, all_readings = next(set_up).holding(engine, box, x)
            else:
                good = _holds(network, constraint, engine, box)
                all_readings = np.ones_like(good)
            holds &= _by_row(good, constraint, count, every=True)
            for_some += ~_by_row(all_readings, constraint, count, every=True)
        for row, lowest in _lowest(network, engine, x):
            violated = np.zeros(int(np.prod(network.constraints[row.constraint].body.shape)), dtype=bool)
            violated[slice(None) if row.elements is None else row.elements] = lowest > 0.0
            fails |= _by_row(violated, network.constraints[row.constraint], count, every=False)
    # two constraints that hold for some reading each need not hold for a common one
    return PointVerdicts(holds & (for_some <= 1), fails)


def _holds(network: ConstraintNetwork, constraint: Constraint, engine: Arithmetic, box: IntervalArray) -> Bools:
    """Elements of a constraint without readings that hold."""
    rows = one_sided(0, constraint)
    tape = Tape(network, [*(row.expr for row in rows), constraint.body])
    slots = tape.forward(engine, box)
    good = np.full(int(np.prod(constraint.body.shape)), tape.defined(engine, slots))
    for row in rows:
        where = slice(None) if row.elements is None else row.elements
        good[where] &= upper_ends(tape.value(slots, row.expr), good[where].size) <= 0.0
    return good


def _lowest(network: ConstraintNetwork, engine: Arithmetic, x: Floats) -> list[tuple[Row, Floats]]:
    """For each one-sided row `r <= 0` a lower bound of its elements over all readings."""
    decisive = DecisiveReadings(network, engine)
    sets = decisive.on(Box(network.names, x, x))
    rows = zip(one_sided_rows(network), sets, strict=True)
    return [(row, _over_readings(decisive.tape, row, own, engine, x)) for row, own in rows]


def _over_readings(tape: Tape, row: Row, decisive: ReadingSets, engine: Arithmetic, x: Floats) -> Floats:
    values = tape.value(tape.forward(engine, IntervalArray.point(x[None]), decisive), row.expr)
    lowest = np.where(values.empty, -np.inf, values.lo)
    return np.broadcast_to(lowest.ravel(), (int(np.prod(row.expr.shape)),))


def _by_row(flags: Bools, constraint: Constraint, count: int, *, every: bool) -> Bools:
    """For each of `count` rows, whether every (or any) element of the constraint there has its flag set."""
    if not constraint.body.shape:
        return np.full(count, flags[0])
    rows = flags.reshape((constraint.body.shape[0], -1))
    out = np.asarray(rows.all(axis=1) if every else rows.any(axis=1))
    return np.concatenate([out, np.full(count - len(out), every)])
