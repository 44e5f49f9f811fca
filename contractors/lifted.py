"""lifted: linear programs over shared monomials (DESIGN section 5).

N measurements of one leg share their nonlinear monomials. Each monomial is one column, so the data are
linear rows, and McCormick, tangent and secant rows tie the columns to the variables over the box. Few rows
are ever active: the programs start with some dozens, and violated ones are added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from contractors.relaxation import Relaxation, Structure
from cpcal.solver.contract import Composable, Contraction, StepWeights
from cpcal.solver.existence.unique import reads
from cpcal.solver.interval import Box, Floats, Indices, IntervalArray
from cpcal.solver.linear import Dense, LinearSolution, LinearStatus, Programs
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.expression import positions
from cpcal.solver.network.network import restricted
from cpcal.solver.network.polynomial import PolynomialForms, PolynomialSystem
from cpcal.solver.network.rows import DecisiveReadings, Rows
from cpcal.solver.optimize.local import fit_of_many

# ------------------------------------------------------------------------------------------------------------------
# Directions in the variables of a box as objectives in its columns, and back: nothing is lost to rounding.
#
# On a box with midpoint c and radius r, `d.x = d.c + sum_i d_i r_i u_i` with u in [-1, 1]^n. Linear programs bound the
# sum with each d_i r_i rounded to a float64; what the rounding leaves out is added to their bounds.


class Directions:
    """`directions` (m, n) on a bounded box; `columns` says which of `count` columns is the coordinate of a variable.

    `objectives` (m, count) are to be minimised: they point the other way.
    """

    def __init__(self, box: Box, columns: Mapping[int, int], count: int, directions: Floats) -> None:
        shape = directions.shape
        center, radius = (IntervalArray.point(np.broadcast_to(of, shape)) for of in (box.mid, box.rad))
        scaled, self._exponents = _scaled(directions, box.rad)
        unit = IntervalArray.point(scaled)
        slopes = unit * radius
        variables, places = list(columns), list(columns.values())
        self.objectives = np.zeros((len(directions), count))
        self.objectives[:, places] = -slopes.mid[:, variables]
        beside = slopes.mag
        beside[:, variables] = slopes.rad[:, variables]
        self._rest = np.concatenate([beside, (unit * center).hi], axis=1)

    def highest(self, lowest: Floats) -> Floats:
        """Upper bounds (m,) of `directions @ x` from lower bounds (m,) of the objectives."""
        terms = IntervalArray.point(np.concatenate([-lowest[:, None], self._rest], axis=1))
        bounds = terms.sum(1).hi
        # a step up: powers of two are exact but for numbers that are nearly too small
        return np.where(self._exponents == 0, bounds, np.nextafter(np.ldexp(bounds, self._exponents), np.inf))


def _scaled(directions: Floats, radius: Floats) -> tuple[Floats, npt.NDArray[np.intc]]:
    """`directions` over powers of two, and the exponents: the size that the tolerances of programs are made for."""
    exponents = np.frexp(np.max(np.abs(directions) * radius, axis=1, initial=0.0))[1]
    scaled = np.ldexp(directions, -exponents[:, None])
    exact = (np.ldexp(scaled, exponents[:, None]) == directions).all(axis=1)
    return np.where(exact[:, None], scaled, directions), np.where(exact, exponents, 0)


def over_box(box: Box, directions: Floats) -> Floats:
    """Upper bounds (m,) of `directions @ x` over all of a box, which need not be bounded."""
    bounds = IntervalArray(np.broadcast_to(box.lo, directions.shape), np.broadcast_to(box.hi, directions.shape))
    with np.errstate(invalid="ignore"):
        terms = bounds * directions
    highest = np.where(directions == 0.0, 0.0, terms.hi)  # zero times an infinite bound is nothing
    return IntervalArray.point(highest).sum(1).hi


# ------------------------------------------------------------------------------------------------------------------
# The structures of a network's relaxations: of all measurements where they are few, else of those that say most.
#
# Few rows are ever active. Where a network has very many rows for its unknowns, a box gets those that its midpoint
# violates most, and some that are spread over all: the others could only make its relaxation tighter, so leaving them
# out loses no solution.

_MANY = 4096  # elements of constraints, beyond which only those that say most about a box are expanded,
_MANY_EACH = 64  # if they are so many for each unknown
_TELLING = 128  # of them for each side of a constraint, and as many that are spread over all
_ENCLOSING = 1024  # the same where no objective is sought: then the enclosure is the answer
_SHARE = 256  # one of so many, where that is more: of 31,000 measurements 128 left out some that decide
_KEPT = 8  # structures of other reading sets
_DECIDED = 0.9  # of the readings' components: while fewer decide at an end, the box is so wide that all sets stay whole


class Structures:
    """Those of one network on any boxes. What two boxes in a row have in common is made once.

    `objective`: the variable whose smallest value is sought on boxes where it has a width; few rows decide that.
    """

    def __init__(self, network: ConstraintNetwork, objective: int | None) -> None:
        self._network, self._objective = network, objective
        elements = sum(int(np.prod(c.body.shape[:1])) for c in network.constraints)
        self._share = elements // _SHARE
        self._rows = Rows(network) if elements > max(_MANY, _MANY_EACH * len(network.names)) else None
        self.by_box = self._rows is not None or any(map(reads, network.constraints))  # else one serves all boxes
        self._keep: list[Indices] | None = None  # of each constraint the elements that are expanded; None: all
        self._forms: PolynomialForms | None = None
        self._decisive: DecisiveReadings | None = None
        self._given: PolynomialSystem | None = None  # where no readings decide, if it need not be expanded
        self._known = dict[bytes, Structure]()  # of the expanded ones, by the reading sets, the latest last

    def on(self, box: Box, deadline: float) -> Structure:
        """For a bounded box (any box where `by_box` is false), with the readings at the ends that decide on all of it
        (of an objective: if most of them do). Rows that are not expanded at `deadline` are missing.

        Structures of the boxes before are kept: another question about the network comes by the same ends.
        """
        seeking = self._objective is not None and bool(box.rad[self._objective] > 0.0)
        keep = None if self._rows is None else self._telling(self._rows, box, seeking)
        if self._forms is None or not all(map(np.array_equal, keep or (), self._keep or ())):
            some = self._network if keep is None else restricted(self._network, keep)
            self._keep, self._forms, self._known = keep, PolynomialForms(some, deadline), {}
            self._decisive = DecisiveReadings(some) if any(map(reads, some.constraints)) else None
        sets = None if self._decisive is None else self._decisive.on(box, _DECIDED if seeking else 0.0)
        key = b"".join(b for own in sets or () for part in own.values() for b in (part.lo.tobytes(), part.hi.tobytes()))
        structure = self._known.pop(key, None)
        if structure is None:
            system = self._forms.on(sets) if key or self._given is None else self._given
            if keep is not None:
                system = system._replace(origin=_original(system.origin, self._network, keep))
            structure = Structure(system)
            while len(self._known) >= _KEPT:
                del self._known[next(iter(self._known))]
        self._known[key] = structure
        return structure

    def among(self, network: ConstraintNetwork, elements: Indices) -> Structures:
        """Those of a network with some elements of each constraint, in one axis: their forms are rows of these."""
        other, whole = Structures(network, self._objective), self._known.get(b"")
        if whole is not None and self._keep is None:
            other._given = whole.system.among(elements)
        return other

    def _telling(self, rows: Rows, box: Box, seeking: bool) -> list[Indices]:
        """Those that a fit in the whole domain took, if the box holds its point, with what encloses more than that
        point; else those that say most around the midpoint. The box alone decides which."""
        at, chosen, most = box.mid, None, max(_TELLING if seeking else _ENCLOSING, self._share)
        domain, objective = self._network.domain, self._objective
        if objective is not None and domain.is_bounded:
            start = domain.mid.copy()
            start[objective] = np.clip(0.0, domain.lo[objective], domain.hi[objective])
            fitted = fit_of_many(self._network, rows, objective, start, domain)
            outside = (fitted.point < box.lo) | (box.hi < fitted.point)
            if not np.delete(outside, objective).any():
                at, chosen = fitted
        if chosen is not None and seeking:
            return chosen
        telling = rows.telling(at, most)
        return telling if chosen is None else list(map(np.union1d, chosen, telling))

    def __getstate__(self) -> dict[str, object]:
        """Without those that were made, which may be large."""
        return self.__dict__ | {"_known": {}}


def _original(origin: Indices, network: ConstraintNetwork, keep: list[Indices]) -> Indices:
    """Constraint and element in the whole network of each row of a restricted one."""
    kept = [c for c, rows in enumerate(keep) if rows.size or not network.constraints[c].body.shape]
    out = origin.copy()
    for new, old in enumerate(kept):
        mine, shape = origin[:, 0] == new, network.constraints[old].body.shape
        out[mine, 0] = old
        if shape:
            out[mine, 1] = positions(shape)[keep[old]].ravel()[origin[mine, 1]]
    return out


_ROUNDINGS, _LEAST = 2.0**-51, 1e-290  # four units; more than what is lost below all normal numbers


class LiftedPrograms(Programs):
    """The linear programs of a relaxation."""

    name = "lifted"

    def __init__(self, structure: Structure, box: Box) -> None:
        self.structure, self.relaxation = structure, (relaxation := Relaxation(structure, box))
        places = {column: k for k, column in enumerate(relaxation.columns.tolist())}
        columns = {variable: places[k] for variable, k in structure.positions.items() if k in places}
        super().__init__(box, columns, len(relaxation.columns))
        bounds = relaxation.bounds
        self.engine = Dense(relaxation.matrix, relaxation.rhs, bounds.lo, bounds.hi, len(relaxation.products))

    def support_function(self, directions: Floats) -> Floats:
        """Proved upper bounds (m,) of `directions @ x`; infinite where a program fails."""
        asked = Directions(self.box, self.columns, self.size, directions)
        lowest = np.full(len(directions), -np.inf)
        for k, objective in enumerate(asked.objectives):
            solution = self.engine.minimize(objective)
            if solution.status is LinearStatus.INFEASIBLE and self.empty(solution) is not None:
                return np.full(len(directions), -np.inf)
            if solution.status is LinearStatus.OPTIMAL:
                lowest[k] = solution.lowest
        return asked.highest(lowest)

    # proofs ---------------------------------------------------------------------------------------------

    def reached(self, variable: int, side: str, solution: LinearSolution) -> float:
        """An end of `c + r u`: four roundings, each of at most a unit of these sizes."""
        sign = 1.0 if side == "lo" else -1.0
        center, reach = self.relaxation.center[variable], self.relaxation.radius[variable] * sign * solution.lowest
        return center + reach - sign * (_ROUNDINGS * (abs(center) + abs(reach)) + _LEAST)

    def carriers(self, solution: LinearSolution) -> tuple[tuple[tuple[int, int], ...], StepWeights]:
        found = map(self._origins.__getitem__, solution.rows.tolist())
        return tuple(filter(None, found)), _Weights(self, solution)

    def weights(self, solution: LinearSolution) -> StepWeights:
        """Products of more than two variables, which no certificate has, are left out: the others prove less."""
        r, parts, forms = self.relaxation, self.structure.system.part, self.structure.products.forms
        first = len(r.products)
        rows, pairs, tangents = [], [], []
        for row, weight in zip(solution.rows.tolist(), solution.multipliers.tolist(), strict=True):
            origin = self._origins[row]
            if origin is not None:
                constraint, element = origin
                part, exponent = int(parts[r.kept[row - first]]), int(r.exponents[row - first])
                rows.append((constraint, part, element, math.ldexp(weight, -exponent)))
                continue
            form = forms[r.products[row]]
            if form is not None and len(form) == 4:
                pairs.append((*form, weight))
            elif form is not None:
                tangents.append((*form, weight))
        return StepWeights(tuple(rows), tuple(pairs), tuple(tangents))

    @cached_property
    def _origins(self) -> list[tuple[int, int] | None]:
        """Constraint and element of each row, none of products."""
        origins, products = self.structure.origins, self.relaxation.products
        return [None] * len(products) + [origins[k] for k in self.relaxation.kept.tolist()]


class _Weights(StepWeights):
    """Formed when somebody looks at them: most searches write no certificate."""

    def __init__(self, programs: LiftedPrograms, solution: LinearSolution) -> None:
        vars(self)["_of"] = programs, solution

    def __getattr__(self, name: str) -> Any:
        programs, solution = vars(self)["_of"]
        formed = programs.weights(solution)
        vars(self).update(vars(formed))
        return getattr(formed, name)

    def __reduce__(self) -> tuple[Any, ...]:
        return StepWeights, (self.rows, self.products, self.tangents)


class Lifted(Composable):
    """Contracts every bounded box by two linear programs per variable, `objective` first.

    Constraints without polynomial form are ignored (combine with hc4). `point` of the contraction is the
    optimum of the first program.
    """

    gives_weights = True

    def __init__(self, network: ConstraintNetwork, *, objective: str | None = None) -> None:
        self._objective = None if objective is None else network.names.index(objective)
        self._network, self._tells = network, True
        self._structures = Structures(network, self._objective)

    @property
    def unused_constraints(self) -> frozenset[int]:
        """Those without polynomial form."""
        domain = self._network.domain
        if self._structures.by_box and not domain.is_bounded:
            return frozenset()
        system = self._structures.on(domain, math.inf).system
        return frozenset(constraint for constraint, _ in system.leftover)

    def among(self, network: ConstraintNetwork, elements: Indices) -> Lifted:
        other = copy(self)
        other._network, other._structures, other._tells = network, self._structures.among(network, elements), False
        return other

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        if box.is_empty or not box.is_bounded:
            return Contraction(box)
        programs = self._programs(box, deadline)
        return Contraction(box) if programs is None else programs.tightened(self._objective, deadline, self._tells)

    def support_function(self, box: Box, directions: Floats) -> Floats:
        """Proved upper bounds (m,) of `directions @ x` over the solutions x in `box`, for `directions` (m, n).

        -inf for all when the box is proved to hold no solution.
        """
        if box.is_empty:
            return np.full(len(directions), -np.inf)
        widest = over_box(box, directions)
        if not box.is_bounded:
            return widest
        programs = self._programs(box, math.inf)
        return widest if programs is None else np.minimum(widest, programs.support_function(directions))

    def _programs(self, box: Box, deadline: float) -> LiftedPrograms | None:
        """None where no row has a polynomial form."""
        structure = self._structures.on(box, deadline)
        if not structure.positions:
            return None
        return LiftedPrograms(structure, box)
