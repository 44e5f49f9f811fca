"""lifted: linear programs over shared monomials (DESIGN section 5).

N measurements of one leg share their nonlinear monomials. Each monomial is one column, so the data are
linear rows, and McCormick, tangent and secant rows tie the columns to the variables over the box. Few rows
are ever active: the programs start with some dozens, and violated ones are added.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from copy import copy

import numpy as np

from contractors.directions import Directions, over_box
from contractors.relaxation import Relaxation, Structure
from contractors.structures import RestrictedStructures, Structures
from cpcal.common.arrays import Bools, Floats, Indices
from cpcal.solver.contract import Composable, Contraction, Step, StepWeights
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.linear import Dense, LinearEngine, LinearSolution, LinearStatus, lower_bound, tightened
from cpcal.solver.network import ConstraintNetwork

Carriers = tuple[tuple[tuple[int, int], ...], StepWeights | None]

_FEWER = 0.5  # of the rows: with less the boxes within begin


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
        programs = self._programs(box)
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

    def _programs(self, box: Box) -> _Programs | None:
        """None where no row has a polynomial form.

        Within the box before, the rows that no point of that one violates are left out from the start.
        """
        whole = self._structures.on(box, self.deadline)
        if not whole.positions:
            return None
        known = self._within
        structure = known[2] if known is not None and known[0] is whole and _lies_in(box, known[1]) else whole
        programs = _Programs(structure, self._arithmetic, self._engine(), box)
        kept, occurring = programs.rows
        if len(kept) < _FEWER * len(structure.system.origin):
            self._within = whole, box, structure.part(kept, occurring)
        return programs


def _lies_in(box: Box, other: Box) -> bool:
    return bool((box.lo >= other.lo).all() and (box.hi <= other.hi).all())


class _Programs:
    """The linear programs on one box: one polyhedron, many objectives."""

    def __init__(self, structure: Structure, arithmetic: Arithmetic, engine: LinearEngine, box: Box) -> None:
        self._structure = structure
        self._arithmetic = arithmetic
        self._relaxation = Relaxation(structure, arithmetic, box)
        self._box = box
        columns = {column: k for k, column in enumerate(self._relaxation.columns.tolist())}
        self._positions = {variable: columns[k] for variable, k in structure.positions.items()}
        self._variables = np.array(list(self._positions), np.intp)
        self._columns = np.array(list(self._positions.values()), np.intp)
        self._engine = self._relaxation.load(engine)
        self.count = 0

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
        return self._engine.minimize(objective)

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
        """The rows that carry a proof, and their weights in a form that can be checked."""
        r, first = self._relaxation, len(self._relaxation.products)
        is_product = solution.rows < first
        rows, weights = solution.rows[~is_product] - first, solution.multipliers[~is_product]
        names = self._structure.names(r.kept[rows])
        weights = np.ldexp(weights, -r.exponents[rows])
        carried = tuple([(*name, weight) for name, weight in zip(names, weights.tolist(), strict=True)])
        products = r.products[solution.rows[is_product]].tolist(), solution.multipliers[is_product].tolist()
        return tuple([(c, k) for c, _, k in names]), self._weights(carried, zip(*products, strict=True))

    def _weights(
        self, rows: tuple[tuple[int, int, int, float], ...], products: Iterable[tuple[int, float]]
    ) -> StepWeights:
        """Products of more than two variables, which no certificate has, are left out: the others prove less."""
        pairs: list[tuple[int, int, float, float, float]] = []
        tangents: list[tuple[int, float, float]] = []
        forms = self._structure.products.forms
        for position, weight in products:
            form = forms[position]
            if form is None:
                continue
            if len(form) == 4:
                pairs.append((*form, weight))
            else:
                tangents.append((*form, weight))
        return StepWeights(rows, tuple(pairs), tuple(tangents))

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
        if sign * (new - old) <= 0.0:
            return None
        return Step("lifted", self._box.names[variable], side, new, *self._carriers(solution))
