"""Local minima by sequential linear programming and by SLSQP, and the best point that is proved. Fits prove nothing.

Minimises one variable (the objective, say eps) subject to the rows of a network, each at the readings in their sets
that suit it best. For `|g_k(x)| <= eps` this is Chebyshev approximation: the optimum is a vertex, so that linear
programs, each about the point before, converge quadratically.
"""

import time
import warnings
from collections.abc import Iterator
from copy import copy
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from cpcal.common.values import Floats, Indices, all_finite, floats
from cpcal.solver.contract import Limits
from cpcal.solver.existence.unique import reads
from cpcal.solver.interval import Box
from cpcal.solver.linear import Dense, LinearStatus
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.network import restricted
from cpcal.solver.network.rows import Rows, RowValues
from cpcal.solver.optimize.witness import Equations, Prepared, Witness, WitnessProver

_ITERATIONS = 60
_PENALTY = 1e3  # weight of a violated row that the objective cannot mend, per unit
_TOLERANCE = 1e-13  # relative decrease below which the fit has converged
_ROUGH = 1e-3  # and while measurements may still be missing
_SMALLEST_RADIUS = 1e-12  # of the trust region, relative to the box
_MANY = 2048  # elements of constraints, beyond which those that matter are looked for
_WORST = 64  # of each side of a constraint, those that enter at a time
_EXTENSIONS = 8  # times that they enter
_MIDDLE = 1e-9  # of the box: a start this near to its middle begins there
_FLOOR = 1e-12  # an objective below this is small enough whatever the model promises


class _State(NamedTuple):
    """A point whose objective component has been moved to its smallest value; the rows there; the merit."""

    point: Floats
    rows: RowValues
    merit: float


class _Problem:
    def __init__(self, rows: Rows, objective: int, box: Box) -> None:
        self._rows, self.objective, self._box = rows, objective, box
        self.free = np.arange(len(box.names)) != objective
        width = np.where(np.isfinite(box.width), box.width, np.maximum(np.abs(box.mid), 1.0))
        self.scale = np.where(self.free, np.maximum(width, 1e-300), 1.0)

    def state(self, point: Floats) -> _State:
        point = np.where(self.free, np.clip(point, self._box.lo, self._box.hi), point)
        excess, jacobian = self._rows.linearize(point)
        slope = jacobian[:, self.objective]
        mended = slope < -1e-12
        move = float(np.max(excess[mended] / -slope[mended], initial=-np.inf))
        if np.isfinite(move):
            point = point.copy()
            point[self.objective] += move
            excess = excess + slope * move
        merit = float(point[self.objective]) + _PENALTY * float(np.max(excess[~mended], initial=0.0))
        return _State(point, RowValues(excess, jacobian), merit if np.isfinite(merit) else np.inf)

    def step(self, state: _State, radius: float) -> Floats | None:
        """The step to the minimum of the linearised problem within the trust region, or None."""
        reach = np.where(self.free, radius * self.scale, max(abs(state.merit), radius))
        lower = np.where(self.free, np.maximum(-1.0, (self._box.lo - state.point) / reach), -1.0)
        upper = np.where(self.free, np.minimum(1.0, (self._box.hi - state.point) / reach), 1.0)
        matrix = state.rows.jacobian * reach
        largest = np.maximum(np.abs(matrix).max(axis=1, initial=0.0), 1e-300)
        slack = -state.rows.values
        engine = Dense(
            matrix / largest[:, None], np.maximum(slack, 0.0) / largest, np.minimum(lower, 0.0), np.maximum(upper, 0.0)
        )
        solution = engine.minimize(1.0 * ~self.free)
        return reach * solution.point if solution.status is LinearStatus.OPTIMAL else None


class Fitted(NamedTuple):
    """A local minimiser, and of each constraint the elements (along its leading axis) that it was found with, if there
    are many."""

    point: Floats
    chosen: list[Indices]


def fit_of_many(network: ConstraintNetwork, rows: Rows, objective: int, start: Floats, box: Box) -> Fitted:
    """The same in a part of the network's domain, for many measurements: of those that matter, which are few.

    Measurements that the fitted point violates more than it may are added, and the fit goes on. The one from the middle
    of a box, which several questions ask for, is made once.
    """
    many = sum(c.body.size for c in network.constraints) > _MANY
    free = np.arange(len(start)) != objective
    in_middle = bool((np.abs(start - box.mid) <= _MIDDLE * box.width)[free].all())
    if many and in_middle:  # all that ask begin with the same numbers
        start = np.where(free, box.mid, start)

    def fitted() -> Fitted:
        if not many:
            return Fitted(fit(rows, objective, box, start), [])
        point, chosen = start, rows.telling(start, _WORST)
        for _ in range(_EXTENSIONS):
            some = Rows(restricted(network, chosen), every=rows.every)
            point = fit(some, objective, box, point, _ROUGH)
            worst = rows.violated(point, _WORST)
            more = [np.union1d(old, new) for old, new in zip(chosen, worst, strict=True)]
            if all(map(np.array_equal, more, chosen)):
                break
            chosen = more
        return Fitted(fit(some, objective, box, point), chosen)

    if not in_middle:
        return fitted()
    what = ("fit", rows.every, start.tobytes(), box.lo[free].tobytes(), box.hi[free].tobytes())
    return network.once(what, fitted)


def fit(rows: Rows, objective: int, box: Box, start: Floats, tolerance: float = _TOLERANCE) -> Floats:
    """A local minimiser in `box`, from `start` (n,); `objective` is the component to minimise.

    It ends where the next step promises a relative decrease below `tolerance`.

    The objective's own lower bound is ignored: a negative optimum means room to spare.
    """
    problem = _Problem(rows, objective, box)
    state = problem.state(floats(start))
    radius = 0.1
    for _ in range(_ITERATIONS if np.isfinite(state.merit) else 0):
        step = problem.step(state, radius)
        if step is None:
            break
        promised = -float(step[objective])
        if not promised > tolerance * max(abs(state.merit), _FLOOR):
            break
        trial = problem.state(state.point + step)
        length = float(np.max(np.abs(step / problem.scale), where=problem.free, initial=0.0))
        gained = (state.merit - trial.merit) / promised
        if gained > 0.0:
            state = trial
        if gained > 0.75 and length > 0.9 * radius:
            radius *= 4.0
        elif gained > 0.25:
            radius = min(radius, 10.0 * length) if length > 0.0 else radius
        else:
            radius = 0.25 * min(radius, length) if length > 0.0 else 0.25 * radius
        if radius < _SMALLEST_RADIUS:
            break
    return state.point


# ------------------------------------------------------------------------------------------------------------------
# Local minima of general problems: proposes points that are nearly optimal and a little inside. Proves nothing.
#
# SLSQP (scipy) from any start; after it the shortest steps move its point so that the equations hold to rounding and
# every inequality with a small margin. A proof in outward rounded arithmetic needs that margin: at the optimum itself
# rounding alone would violate each active row.

MARGINS = (1e-12, 1e-11, 1e-10, 1e-9, 3e-9)  # in the unit of a row: its gradient times the components' scales
_SEARCH_ITERATIONS = 100
_GRACE = 0.5  # seconds that a local method has beyond the time limit: without any point there is no upper bound
_LARGEST = 600  # rows and components, beyond which a dense local method takes too long
_REACH = 1e-5  # how far, in scales, such a step moves at most
_ROUNDS = 4

_WIDE = 1e4  # a domain beyond this says nothing about the size of its component


class LocalSearch:
    """Local minimisation over one network's domain, or a part of it, of these `rows`.

    `applies` where the network is small and has no readings. It stops at `deadline` (of time.monotonic()), where it is.
    """

    def __init__(
        self, network: ConstraintNetwork, rows: Rows, objective: int, equations: Equations, deadline: float, domain: Box
    ) -> None:
        self._deadline, self._domain = deadline, domain
        self._objective, self._equations = objective, equations
        self._rows = Rows(equations.rest) if equations.count else rows
        size = sum(c.body.size for c in network.constraints)
        self.applies = max(size, len(network.names)) <= _LARGEST and not any(map(reads, network.constraints))

    def proposals(self, start: Floats) -> Iterator[Floats]:
        """Points to prove, the best first: each with a larger margin than the one before."""
        width, usual = self._domain.width, np.maximum(np.abs(start), 1.0)
        scale = np.where(np.isfinite(width) & (width < _WIDE) & (width > 0.0), width, usual)
        point = self._slsqp(start, scale)
        if point is None:
            return
        for margin in MARGINS:
            inside = self.inside(point, margin, scale)
            if inside is not None:
                yield inside

    @np.errstate(all="ignore")
    def inside(self, point: Floats, margin: float, scale: Floats) -> Floats | None:
        """A point near the given one that holds the equations, and the inequalities with a margin, to first order."""
        for _ in range(_ROUNDS):
            rows, (value, jacobian) = self._rows.linearize(point), self._equations.rows.linearize(point)
            matrix, equal = rows.jacobian * scale, jacobian * scale
            sizes = np.maximum(np.abs(matrix).max(axis=1, initial=0.0), 1e-300)
            missing = rows.values / sizes + margin
            broken = missing > 0.0
            size = np.maximum(np.abs(equal).sum(axis=1), 1e-300)
            system = np.concatenate([equal / size[:, None], (matrix / sizes[:, None])[broken]])
            need = np.concatenate([value / size, missing[broken]])
            if not (all_finite(system) and all_finite(need)):
                return None
            step = np.clip(-np.linalg.lstsq(system, need, rcond=None)[0], -_REACH, _REACH)
            point = np.clip(point + step * scale, self._domain.lo, self._domain.hi)
            if float(np.max(np.abs(step), initial=0.0)) < 1e-13:
                break
        return point

    def _slsqp(self, start: Floats, scale: Floats) -> Floats | None:
        """A local minimum in scaled components, or wherever it stops."""
        from scipy import optimize  # here: it takes half a second to load, and few problems need it

        minimize: Any = optimize.minimize  # typed for other arguments than these
        lo, hi = self._domain.lo / scale, self._domain.hi / scale
        late = max(self._deadline, time.monotonic() + _GRACE)
        asked = list[Floats]()  # the last point
        sizes = list[Floats]()  # of rows and equations, where the search begins

        @lru_cache(maxsize=1)
        def known(at: bytes) -> list[Floats]:
            """Rows and equations with their derivatives, each in the unit of its gradient at the first point."""
            if asked and time.monotonic() > late:
                raise _LateError
            asked[:] = [np.frombuffer(at)]
            rows, (value, jacobian) = (one.linearize(asked[0] * scale) for one in (self._rows, self._equations.rows))
            matrix, equal = rows.jacobian * scale, jacobian * scale
            if not sizes:
                sizes.extend(np.clip(np.abs(part).max(axis=1, initial=0.0), 1e-6, 1e12) for part in (matrix, equal))
            found = rows.values / sizes[0], matrix / sizes[0][:, None], value / sizes[1], equal / sizes[1][:, None]
            return [np.asarray(np.nan_to_num(part, nan=1e10, posinf=1e10, neginf=-1e10)) for part in found]

        constraints = [
            {"type": "ineq", "fun": lambda y: -known(y.tobytes())[0], "jac": lambda y: -known(y.tobytes())[1]},
            {"type": "eq", "fun": lambda y: known(y.tobytes())[2], "jac": lambda y: known(y.tobytes())[3]},
        ]
        direction = np.eye(len(start))[self._objective]
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            try:
                last = minimize(
                    lambda y: float(y[self._objective]),
                    np.clip(start / scale, lo, hi),
                    jac=lambda y: direction,
                    bounds=list(zip(lo, hi, strict=True)),
                    constraints=constraints if self._equations.count else constraints[:1],
                    method="SLSQP",
                    options={"maxiter": _SEARCH_ITERATIONS, "ftol": 1e-13},
                ).x
            except _LateError:
                last = asked[0]
            except (ValueError, np.linalg.LinAlgError):
                return None
        point = np.asarray(last * scale)
        return np.clip(point, self._domain.lo, self._domain.hi) if all_finite(point) else None


class _LateError(Exception):
    """The time limit came first."""


# ------------------------------------------------------------------------------------------------------------------
# The best point that is proved so far: the one thing that the nodes of a branch and bound have in common.


class Known(NamedTuple):
    """The best point that is proved, and how often points were proposed."""

    witness: Witness | None
    calls: int


class Incumbent:
    """Proves points that local fits propose, and says what a box can still improve. It only ever gets better."""

    def __init__(
        self, prepared: Prepared, limits: Limits, deadline: float, domain: Box, best: Known | None = None
    ) -> None:
        self.objective, self.domain = prepared.objective, domain
        self._prepared, self._limits, self._deadline = prepared, limits, deadline
        self._one_value = bool(self.domain.lo[self.objective] == self.domain.hi[self.objective])
        self.calls = 0  # of `propose`
        self.witness = None if best is None else best.witness

    @property
    def hi(self) -> float:
        """Its objective; infinite while there is none."""
        return np.inf if self.witness is None else self.witness.value

    @property
    def gap(self) -> float:
        """The width at which a bracket below it counts as closed."""
        return max(self._limits.gap * abs(self.hi), self._limits.gap_absolute)

    @property
    def floor(self) -> float:
        """The second-order effect of the readings at it (0 without one)."""
        if self.witness is None:
            return 0.0
        return self._prepared.rows.second_order(self.witness.point)

    @property
    def served(self) -> bool:
        """Whether another fit can wait while boxes shrink: there is a point, or a fit found none for the one value."""
        return self.witness is not None or (self._one_value and self._prepared.minimax and self.calls > 0)

    @property
    def state(self) -> Known:
        """What decisions depend on."""
        return Known(self.witness, self.calls)

    def at(self, state: Known) -> "Incumbent":
        """Another one of the same problem, in that state."""
        other = copy(self)
        other.witness, other.calls = state.witness, state.calls
        return other

    def learn(self, state: Known, since: Known) -> None:
        """Keep what another one has found from the state `since` on, if it is better."""
        self.calls += state.calls - since.calls
        if state.witness is not None and state.witness.value < self.hi:
            self.witness = state.witness

    @np.errstate(all="ignore")  # fits run where numbers overflow, too: what they propose is proved or dropped
    def propose(self, start: Floats) -> bool:
        """Fit from a point and keep what is proved, if it is better; whether it is.

        Where every constraint bounds the objective, the sequence of linear programs ends in the optimum, a vertex,
        which tells whether there is a point for one value that is asked about, too.
        Other problems have a local search that takes longer: it runs at the first proposals, then ever less often.
        """
        self.calls += 1
        better, o = False, self.objective
        if not np.isfinite(self.domain.hi[o] - self.domain.lo[o]):  # the middle of a half-line is of no use
            start = start.copy()
            start[o] = np.clip(0.0, self.domain.lo[o], self.domain.hi[o])
        if self._one_value and self._keep(start):  # no other point is better
            return True
        if self._prepared.minimax or not self._local.applies:
            prepared = self._prepared
            better = self._keep(fit_of_many(prepared.network, prepared.rows, o, start, self.domain).point)
        better = better or (not self._one_value and self._keep(start))
        if not (self._prepared.minimax and (better or self._one_value)) and self._local.applies and _due(self.calls):
            for point in self._local.proposals(start):
                kept = self._keep(point)
                better = better or kept
                if kept or point[self.objective] >= self.hi:  # no improvement, whatever its margin
                    break
        return better

    @cached_property
    def _prover(self) -> WitnessProver:
        return self._prepared.prover.within(self.domain)

    @cached_property
    def _local(self) -> LocalSearch:
        prepared, equations = self._prepared, self._prover.equations
        return LocalSearch(prepared.network, prepared.rows, self.objective, equations, self._deadline, self.domain)

    def _keep(self, point: Floats) -> bool:
        """Prove a point; keep it if it is better."""
        if point[self.objective] >= self.hi and not self._prepared.minimax:
            return False
        witness = self._prover.prove(point)
        if witness is None or witness.value >= self.hi:
            return False
        self.witness = witness
        return True

    def cut(self, box: Box) -> Box:
        """Drop what is worse than it."""
        return box if box.hi[self.objective] <= self.hi else box.replace(self.objective, hi=self.hi)

    def closed(self, box: Box) -> bool:
        """Whether the box can raise the bracket's lower end no further than the gap asked for."""
        return not box.is_empty and bool(box.lo[self.objective] >= self.hi - self.gap)

    def settled(self, box: Box) -> bool:
        """Whether dividing the box is pointless: it is closed, or down to the second order of the readings."""
        return self.closed(box) or (not box.is_empty and bool(box.lo[self.objective] >= self.hi - self.floor))


def _due(call: int) -> bool:
    """1, 2, 3, 4, 6, 8, 12, 16, 24, ..."""
    power = 1 << (call.bit_length() - 1)
    return call == power or 2 * call == 3 * power
