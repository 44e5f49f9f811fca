"""Proposes readings for the checker: where a row is used, and where a point is a solution. Nothing of it is trusted."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction as F

import numpy as np

from cpcal.checker.leg import LegConstraint
from cpcal.checker.problem import Box, Problem, Unknowns
from cpcal.checker.rule import Row
from cpcal.solver.certificate.float_rows import best_signs, linear_parts
from cpcal.solver.certificate.statement import free


def row_of(problem: Problem, x: Unknowns, side: str, k: int) -> Row:
    """The row with the reference reading that costs least, component by component, on the box of x."""
    return rows_of(problem, x, [(side, k)])[0]


def rows_of(problem: Problem, x: Unknowns, places: Sequence[tuple[str, int]]) -> list[Row]:
    """`row_of` for several sides and numbers."""
    rows = [(side, k, "0" * len(problem.radii(k))) for side, k in places]
    for side in dict.fromkeys(side for side, _ in places if side != "length"):
        mine = [n for n, row in enumerate(rows) if row[0] == side and any(problem.radii(row[1]))]
        if mine:
            legs = [_leg(problem, x, rows[n][1]) for n in mine]
            for n, signs in zip(mine, best_signs(legs, side), strict=True):
                rows[n] = (*rows[n][:2], signs)
    return rows


def _leg(problem: Problem, x: Unknowns, k: int) -> LegConstraint:
    """The constraint at the centres of its reading sets."""
    leg = problem.constraint(k, x, "0" * len(problem.radii(k)), 0)
    assert isinstance(leg, LegConstraint)
    return leg


def stretching(problem: Problem, x: Unknowns, k: int) -> str:
    """The end of the reading set, in signs, at which sqrt(body) is largest compared to its bounds, at a point."""
    return stretchings(problem, x, [k])[0]


def stretchings(problem: Problem, x: Unknowns, numbers: Sequence[int]) -> list[str]:
    """`stretching` of several."""
    found = ["0" * len(problem.radii(k)) for k in numbers]
    mine = [n for n, k in enumerate(numbers) if any(problem.radii(k))]
    if mine:
        legs = [_leg(problem, x, numbers[n]) for n in mine]
        (body, of_body), (factor, of_factor) = (linear_parts(legs, name) for name in ("under_root", "factor"))
        of_bounds = linear_parts(legs, "at_least")[1] + linear_parts(legs, "at_most")[1]
        square = (body / factor)[:, None]
        slopes = (of_body - square * of_factor) / factor[:, None] - np.sqrt(np.maximum(square, 0.0)) * of_bounds
        for n, row in zip(mine, slopes.tolist(), strict=True):
            found[n] = "".join("+" if slope > 0.0 else "-" if slope < 0.0 else "0" for slope in row)
    return found


def at_point(point: Sequence[float]) -> Unknowns:
    """The unknowns on a box of width zero."""
    x = tuple(F(float(v)) for v in point)
    return Unknowns(Box(x, x), free)


def failing(problem: Problem, x: Unknowns, k: int) -> Row | None:
    """The row that proves that the point fails at k."""
    rows = (row_of(problem, x, side, k) for side in problem.sides)
    return next((row for row in rows if problem.fails(x, *row)), None)


def holding(problem: Problem, x: Unknowns, k: int) -> str | None:
    """The signs of the readings that prove that it satisfies k."""
    signs = stretching(problem, x, k)
    return signs if problem.holds(x, k, signs) else None
