"""lifted: linear programs over shared monomials (DESIGN section 5).

N measurements of one leg share their nonlinear monomials. Each monomial is one column, so the data are
linear rows, and McCormick, tangent and secant rows tie the columns to the variables over the box. Few rows
are ever active: the programs start with some dozens, and violated ones are added.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from contractors.directions import Directions, over_box
from contractors.relaxation import Relaxation, Structure
from contractors.structures import RestrictedStructures, Structures
from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.contract import Composable, Contraction, Step, StepWeights
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.linear import Dense, LinearEngine, LinearSolution, LinearStatus, lower_bound, tightened
from cpcal.solver.network import ConstraintNetwork

Carriers = tuple[tuple[tuple[int, int], ...], StepWeights]

_FEWER = 0.5  # of the rows: with less the boxes within begin
_WORTH = 2  # columns for each variable, from which on fewer are worth a try
_BENDS = 2.0  # beyond which what is not linear in a row, per half-width of the objective, makes a try vain
_BEYOND = 2.0  # how far linear parts may reach beyond the box, in its half-widths
_LOST = 0.01  # of what the objective's lower bound would rise by: what linear programs may lose


class Lifted(Composable):
    """Contracts every bounded box by two linear programs per variable, `objective` first.

    Constraints without polynomial form are ignored (combine with hc4). `point` of the contraction is the
    optimum of the first program.
    """

    gives_weights = True
    # Tangents touch a square at places that move with the box, and bounds met to 1e-3 are left as they are.
    monotone_tolerance = 0.05

    def __init__(
        self,
        network: ConstraintNetwork,
        *,
        objective: str | None = None,
        arithmetic: str = "float64",
        engine: Callable[[], LinearEngine] = Dense,
    ) -> None:
        self._arithmetic = get_arithmetic(arithmetic)
        self._engine = engine
        self._within: tuple[Structure, Box, Structure] | None = None  # what is left of the first on boxes in that one
        self._objective = None if objective is None else network.names.index(objective)
        self._network = network
        self._structures: Structures | RestrictedStructures = Structures(network, self._arithmetic, self._objective)

    @property
    def unused_constraints(self) -> frozenset[int]:
        """Those without polynomial form."""
        domain = self._network.domain
        if self._structures.by_box and not domain.is_bounded:
            return frozenset()
        system = self._structures.on(domain, self.deadline).system
        return frozenset(constraint for constraint, _ in system.leftover)

    def restricted_to(self, elements: Indices) -> Lifted:
        """See `cpcal.solver.contract.Restrictable`."""
        assert isinstance(self._structures, Structures)
        other = copy(self)
        other._structures, other._within = self._structures.restricted_to(elements), None
        return other

    def contract(self, box: Box) -> Contraction:
        if box.is_empty or not box.is_bounded:
            return Contraction(box)
        programs = self._programs(box, self._objective)
        return Contraction(box) if programs is None else tightened(programs, box, self._objective, self.deadline)

    def support_function(self, box: Box, directions: Floats) -> Floats:
        """Proved upper bounds (m,) of `directions @ x` over the solutions x in `box`, for `directions` (m, n).

        -inf for all when the box is proved to hold no solution.
        """
        if box.is_empty:
            return np.full(len(directions), -np.inf)
        widest = over_box(self._arithmetic, box, directions)
        if not box.is_bounded:
            return widest
        programs = self._programs(box)
        return widest if programs is None else np.minimum(widest, programs.support_function(directions))

    def _programs(self, box: Box, objective: int | None = None) -> _Programs | None:
        """None where no row has a polynomial form.

        Within the box before, the rows that no point of that one violates are left out from the start.
        """
        whole = self._structures.on(box, self.deadline)
        if not whole.positions:
            return None
        known = self._within
        structure = known[2] if known is not None and known[0] is whole and box.subset(known[1]) else whole
        programs = _Programs(structure, self._arithmetic, self._engine(), box, objective)
        kept, occurring = programs.rows
        if len(kept) < _FEWER * len(structure.system.origin):
            self._within = whole, box, structure.part(kept, occurring)
        return programs


class _Programs:
    """The linear programs on one box: one polyhedron, many objectives.

    Where the box is small for what its rows bend, and an `objective` is sought, the programs are those of the rows'
    linear parts alone, a third of the columns. That is no relaxation: their multipliers are proved with all monomials.
    """

    def __init__(
        self, structure: Structure, arithmetic: Arithmetic, engine: LinearEngine, box: Box, objective: int | None = None
    ) -> None:
        self._structure = structure
        self._arithmetic = arithmetic
        self._relaxation = Relaxation(structure, arithmetic, box)
        self._box = box
        columns = {column: k for k, column in enumerate(self._relaxation.columns.tolist())}
        self._positions = {variable: columns[k] for variable, k in structure.positions.items()}
        self._variables = np.array(list(self._positions), np.intp)
        self._columns = np.array(list(self._positions.values()), np.intp)
        self._engine, self.count = engine, 0
        self._linear: Indices | None = None  # the columns of the programs; None: all
        if objective is None or not self._bends_little(objective):
            self._linear = None
            self._relaxation.load(engine)

    def _bends_little(self, objective: int) -> bool:
        """Whether little of the objective's bound is lost to what is not linear. Then the linear programs are loaded.

        Linear parts may leave no point below the box's upper end, so they reach beyond it: as far as the loss.
        """
        r, place = self._relaxation, self._positions.get(objective)
        linear = np.flatnonzero(self._structure.linear[r.columns])
        if place is None or not self._box.rad[objective] > 0.0 or len(r.columns) < _WORTH * len(linear):
            return False
        rows = np.abs(r.matrix[len(r.products) :])
        bends, grows = rows.sum(axis=1) - rows[:, linear].sum(axis=1), rows[:, place]
        if np.count_nonzero(bends <= _BENDS * grows) < 0.5 * len(rows):
            return False
        self._linear, mine = linear, int(np.searchsorted(linear, place))
        self._load(mine, 1.0 + _BEYOND)
        solution = self.minimize(objective, 1.0)
        if solution.status is not LinearStatus.OPTIMAL:
            return False
        reached = float(solution.point[place])
        lost = reached - self._proved(solution, self._objective(objective, 1.0))
        if not lost <= _LOST * (reached + 1.0):
            return False
        self._load(mine, max(1.0, reached + lost))
        return True

    def _load(self, place: int, highest: float) -> None:
        """The linear parts of the rows, one column reaching up to `highest`."""
        r, first = self._relaxation, len(self._relaxation.products)
        lower, upper = r.bounds.lo[self._linear], r.bounds.hi[self._linear].copy()
        upper[place] = highest
        self._engine.load(r.matrix[first:, self._linear], r.rhs[first:], lower, upper)

    @property
    def rows(self) -> tuple[Indices, Bools]:
        """The rows of the structure that some point of the box may violate, and the monomials that occur in any."""
        return self._relaxation.kept, self._relaxation.occurring

    @property
    def variables(self) -> Collection[int]:
        return self._positions

    def support_function(self, directions: Floats) -> Floats:
        """Proved upper bounds (m,) of `directions @ x`; infinite where a program fails."""
        count = len(self._relaxation.columns)
        asked = Directions(self._arithmetic, self._box, self._positions, count, directions)
        lowest = np.empty(len(directions))
        for k, objective in enumerate(asked.objectives):
            lowest[k] = self._lowest(objective)
            if lowest[k] == np.inf:
                return np.full(len(directions), -np.inf)
        return asked.highest(lowest)

    def _lowest(self, objective: Floats) -> float:
        """A proved lower bound of an objective: inf when the box is proved empty, -inf when none is known."""
        solution = self._minimized(objective)
        if solution.status is LinearStatus.INFEASIBLE and self.empty(solution) is not None:
            return np.inf
        return self._proved(solution, objective) if solution.status is LinearStatus.OPTIMAL else -np.inf

    def minimize(self, variable: int, sign: float) -> LinearSolution:
        return self._minimized(self._objective(variable, sign))

    def _minimized(self, objective: Floats) -> LinearSolution:
        self.count += 1
        if self._linear is None:
            return self._engine.minimize(objective)
        found = self._engine.minimize(objective[self._linear])
        point = np.zeros(len(objective))
        point[self._linear] = found.point
        return replace(found, point=point, rows=found.rows + len(self._relaxation.products))

    def coordinates(self, solution: LinearSolution) -> Floats:
        u = np.zeros(len(self._box))
        u[self._variables] = solution.point[self._columns]
        return u

    def _objective(self, variable: int, sign: float) -> Floats:
        objective = np.zeros(len(self._relaxation.columns))
        objective[self._positions[variable]] = sign
        return objective

    # proofs ---------------------------------------------------------------------------------------------

    def _proved(self, solution: LinearSolution, objective: Floats) -> float:
        """Rigorous lower bound of the objective from the multipliers."""
        r = self._relaxation
        return lower_bound(self._arithmetic, r.matrix, r.rhs, solution.rows, solution.multipliers, objective, r.bounds)

    def _carriers(self, solution: LinearSolution) -> Carriers:
        """The rows that carry a proof, and their weights in a form that can be checked.

        Products of more than two variables, which no certificate has, are left out: the others prove less.
        """
        first, names, scales = len(self._relaxation.products), self._names, self._scales
        rows: list[tuple[int, int, int, float]] = []
        pairs: list[tuple[int, int, float, float, float]] = []
        tangents: list[tuple[int, float, float]] = []
        for row, weight in zip(solution.rows.tolist(), solution.multipliers.tolist(), strict=True):
            if row >= first:
                rows.append((*names[row - first], weight * scales[row - first]))
                continue
            form = self._structure.products.forms[self._relaxation.products[row]]
            if form is not None and len(form) == 4:
                pairs.append((*form, weight))
            elif form is not None:
                tangents.append((*form, weight))
        return tuple([(c, k) for c, _, k, _ in rows]), StepWeights(tuple(rows), tuple(pairs), tuple(tangents))

    @cached_property
    def _names(self) -> list[tuple[int, int, int]]:
        return self._structure.names(self._relaxation.kept)

    @cached_property
    def _scales(self) -> list[float]:
        """What a multiplier of each row is one of the system's row times."""
        return list(np.ldexp(1.0, -self._relaxation.exponents).tolist())

    def empty(self, solution: LinearSolution) -> Step | None:
        if not self._proved(solution, np.zeros(len(self._relaxation.columns))) > 0.0:
            return None
        return Step("lifted", None, "", np.nan, *self._carriers(solution))

    def bound(self, variable: int, side: str, solution: LinearSolution) -> Step | None:
        sign = 1.0 if side == "lo" else -1.0
        lowest = self._proved(solution, self._objective(variable, sign))
        if not -1.0 < lowest < np.inf:
            return None
        least, largest = self._relaxation.value(variable, sign * lowest)
        new = least if side == "lo" else largest
        old = self._box.lo[variable] if side == "lo" else self._box.hi[variable]
        if not sign * (new - old) > 0.0:
            return None
        return Step("lifted", self._box.names[variable], side, new, *self._carriers(solution))
