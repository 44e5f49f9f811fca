"""regression: each variable as a combination of equations, by one pseudo-inverse for all boxes.

The equations of N measurements are linear in some dozen products of the variables that they share. Where they are many
more than these, weights w_k with `sum_k w_k equation_k = x_i` follow by least squares, once: as polynomials the two
sides are the same, so that the tolerances of the equations alone bound x_i, on any box. Each equation is two rows;
weights of either sign become multipliers >= 0 of the one or the other. They are proposals: what they prove is proved
anew on each box, and a certificate holds them as those of any linear program.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from contractors.lifted import LiftedPrograms, Structures
from contractors.relaxation import Relaxation
from cpcal.solver.contract import Composable, Contraction, Step
from cpcal.solver.interval import Box, Floats, Indices
from cpcal.solver.linear import LinearSolution, LinearStatus, lower_bound
from cpcal.solver.network import ConstraintNetwork, PolynomialSystem

_OPPOSITE = -0.5  # cosine between the coefficients of two rows, below which they bound one expression from both sides
_SAME = 1e-6  # by which the coefficients of a combination may differ from those of the variable
_RANK = 1e-12  # of the largest singular value


class Combined(NamedTuple):
    """`weights` (V, P) of P equations, whose two rows are `above` and `below` (P,), that give the `variables` (V,)."""

    above: Indices
    below: Indices
    variables: Indices
    weights: Floats


class Regression(Composable):
    """Contracts every variable that the equations' shared products determine, without linear programs.

    It says most where tolerances are small: what it leaves of a box does not depend on the box's size. Where a box
    holds legs of negative length, about which squares say nothing, hc4 leaves these out first. Constraints without
    polynomial form, and those that bound one side only, are ignored.
    """

    gives_weights = True

    def __init__(self, network: ConstraintNetwork, *, objective: str | None = None) -> None:
        sought = None if objective is None else network.names.index(objective)
        self._structures = Structures(network, sought)
        self._known: tuple[bytes, Combined] | None = None  # which coefficients they are of

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        if box.is_empty or not box.is_bounded:
            return Contraction(box)
        structure = self._structures.on(box, deadline)
        if not structure.positions:
            return Contraction(box)
        programs = LiftedPrograms("regression", structure, Relaxation(structure, box, whole=True), box)
        steps = tuple(self._steps(programs))
        lo, hi = box.lo.copy(), box.hi.copy()
        for step in steps:
            (lo if step.side == "lo" else hi)[box.names.index(str(step.variable))] = step.bound
        return Contraction(box.with_bounds(lo, hi), steps)

    def _combined(self, system: PolynomialSystem) -> Combined:
        """That of before, if it is of the same coefficients: what a box gives does not depend on the boxes before."""
        rows = system.origin.tobytes() + system.part.tobytes() + system.coefficients[0].mid.tobytes()
        key = repr(system.monomials).encode() + rows
        if self._known is None or self._known[0] != key:
            self._known = key, combined(system)
        return self._known[1]

    def _steps(self, programs: LiftedPrograms) -> Iterator[Step]:
        """A better bound of each variable on each side, where multipliers of rows prove one."""
        r, radius = programs.relaxation, programs.box.rad
        found = self._combined(programs.structure.system)
        place = np.full(len(programs.structure.system.origin), -1)
        place[r.kept] = np.arange(len(r.kept))
        for variable, weights in zip(found.variables.tolist(), found.weights, strict=True):
            if variable not in programs.columns or not radius[variable] > 0.0:
                continue
            for side, sign in (("lo", -1.0), ("hi", 1.0)):
                rows = place[np.where(sign * weights > 0.0, found.above, found.below)]
                if (rows[weights != 0.0] < 0).any():  # rows that overflowed say nothing
                    continue
                own = np.abs(weights) / radius[variable]
                rows, own = rows[own > 0.0], own[own > 0.0]
                multipliers = np.ldexp(own, r.exponents[rows])
                nowhere = np.zeros(programs.size)  # no program was solved
                carrying, aim = rows + len(r.products), programs.unit(variable, 1.0 if side == "lo" else -1.0)
                lowest = lower_bound(r.matrix, r.rhs, carrying, multipliers, aim, r.bounds)
                proposed = LinearSolution(LinearStatus.OPTIMAL, nowhere, carrying, multipliers, lowest)
                step = programs.bound(variable, side, proposed)
                if step is not None:
                    yield step


def combined(system: PolynomialSystem) -> Combined:
    """The variables that equations determine together, by least squares over their coefficients."""
    coefficients = system.coefficients[0].mid[:, 1:]
    above, below = _pairs(system, coefficients)
    equations = 0.5 * (coefficients[above] - coefficients[below])
    unit = np.maximum(np.abs(equations).max(axis=0, initial=0.0), 1e-300)
    columns, variables = (
        np.array([(k, m[0]) for k, m in enumerate(system.monomials[1:]) if len(m) == 1], np.intp).reshape(-1, 2).T
    )
    if not len(above) or not np.isfinite(equations / unit).all():
        return Combined(above, below, variables[:0], np.zeros((0, len(above))))
    weights = np.linalg.pinv(equations / unit, rcond=_RANK)[columns]
    weights /= unit[columns, None]
    reached = weights @ equations
    wanted = np.zeros_like(reached)
    wanted[np.arange(len(columns)), columns] = 1.0
    good = (np.abs(reached - wanted) * unit).max(axis=1) <= _SAME * unit[columns]
    return Combined(above, below, variables[good], weights[good])


def _pairs(system: PolynomialSystem, coefficients: Floats) -> tuple[Indices, Indices]:
    """Rows that bound one expression from above and from below: two parts of one constraint, opposite to each other."""
    above, below = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    for constraint in np.unique(system.origin[:, 0]):
        of_constraint = system.origin[:, 0] == constraint
        parts = [np.flatnonzero(of_constraint & (system.part == p)) for p in np.unique(system.part[of_constraint])]
        for one, other in combinations(parts, 2):
            if not np.array_equal(system.origin[one, 1], system.origin[other, 1]):
                continue
            x, y = coefficients[one], coefficients[other]
            with np.errstate(all="ignore"):
                cosine = (x * y).sum(axis=1) / np.sqrt((x * x).sum(axis=1) * (y * y).sum(axis=1))
            if (cosine < _OPPOSITE).all():
                above.append(one)
                below.append(other)
    return np.concatenate(above), np.concatenate(below)
