"""Directions in the variables of a box as objectives in its columns, and back: nothing is lost to rounding.

On a box with midpoint c and radius r, `d.x = d.c + sum_i d_i r_i u_i` with u in [-1, 1]^n. Linear programs bound the
sum with each d_i r_i rounded to a float64; what the rounding leaves out is added to their bounds.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats
from cpcal.solver.interval import Arithmetic, Box, IntervalArray


class Directions:
    """`directions` (m, n) on a bounded box; `columns` says which of `count` columns is the coordinate of a variable.

    `objectives` (m, count) are to be minimised: they point the other way.
    """

    def __init__(
        self, engine: Arithmetic, box: Box, columns: Mapping[int, int], count: int, directions: Floats
    ) -> None:
        self._engine = engine
        center = IntervalArray.point(np.broadcast_to(box.mid, directions.shape))
        radius = IntervalArray.point(np.broadcast_to(box.rad, directions.shape))
        scaled, self._exponents = _scaled(directions, box.rad)
        unit = IntervalArray.point(scaled)
        slopes = engine.mul(unit, radius)
        variables, places = list(columns), list(columns.values())
        self.objectives = np.zeros((len(directions), count))
        self.objectives[:, places] = -slopes.mid[:, variables]
        beside = slopes.mag
        beside[:, variables] = slopes.rad[:, variables]
        self._rest = np.concatenate([beside, engine.mul(unit, center).hi], axis=1)

    def highest(self, lowest: Floats) -> Floats:
        """Upper bounds (m,) of `directions @ x` from lower bounds (m,) of the objectives."""
        terms = IntervalArray.point(np.concatenate([-lowest[:, None], self._rest], axis=1))
        bounds = self._engine.sum(terms, 1).hi
        # a step up: powers of two are exact but for numbers that are nearly too small
        return np.where(self._exponents == 0, bounds, np.nextafter(np.ldexp(bounds, self._exponents), np.inf))


def _scaled(directions: Floats, radius: Floats) -> tuple[Floats, npt.NDArray[np.intc]]:
    """`directions` over powers of two, and the exponents: the size that the tolerances of programs are made for."""
    exponents = np.frexp(np.max(np.abs(directions) * radius, axis=1, initial=0.0))[1]
    scaled = np.ldexp(directions, -exponents[:, None])
    exact = (np.ldexp(scaled, exponents[:, None]) == directions).all(axis=1)
    return np.where(exact[:, None], scaled, directions), np.where(exact, exponents, 0)


def over_box(engine: Arithmetic, box: Box, directions: Floats) -> Floats:
    """Upper bounds (m,) of `directions @ x` over all of a box, which need not be bounded."""
    bounds = IntervalArray(np.broadcast_to(box.lo, directions.shape), np.broadcast_to(box.hi, directions.shape))
    with np.errstate(invalid="ignore"):
        terms = engine.mul(IntervalArray.point(directions), bounds)
    highest = np.where(directions == 0.0, 0.0, terms.hi)  # zero times an infinite bound is nothing
    return np.asarray(engine.sum(IntervalArray.point(highest), 1).hi)
