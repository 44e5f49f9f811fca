"""Local minima of general problems: proposes points that are nearly optimal and a little inside. Proves nothing.

First linear programs about one point after the other, which end where the optimum is a vertex. Then, from any start,
SLSQP (scipy); after it one linear program moves its point so that the equations hold to rounding and every inequality
with a small margin, by the shortest step. A proof in outward rounded arithmetic needs that margin: at the optimum
itself rounding alone would violate each active row.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.solver.existence import reads
from cpcal.solver.interval import Box
from cpcal.solver.linear import Dense
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.rows import Rows, RowValues
from cpcal.solver.optimize.equations import Equations
from cpcal.solver.optimize.linear_steps import linear_steps

MARGINS = (1e-12, 1e-11, 1e-10, 1e-9, 3e-9)  # in the unit of a row: its gradient times the components' scales
_ITERATIONS = 100
_GRACE = 0.5  # seconds that a local method has beyond the time limit: without any point there is no upper bound
_LARGEST = 600  # rows and components, beyond which a dense local method takes too long
_REACH = 1e-5  # how far, in scales, the linear program moves at most
_ROUNDS = 4

_WIDE = 1e4  # a domain beyond this says nothing about the size of its component


class LocalSearch:
    """Local minimisation over one network's domain, or a part of it, of these `rows`.

    `applies` where the network is small and has no readings. It stops at `deadline` (of time.monotonic()), where it is.
    """

    def __init__(
        self,
        network: ConstraintNetwork,
        rows: Rows,
        objective: int,
        equations: Equations,
        deadline: float = math.inf,
        domain: Box | None = None,
    ) -> None:
        self._deadline, self._domain = deadline, network.domain if domain is None else domain
        self._objective, self._equations = objective, equations
        self._whole = network.whole
        self._rows = Rows(equations.rest) if equations.count else rows
        size = sum(int(np.prod(c.body.shape)) for c in network.constraints)
        self.applies = max(size, len(network.names)) <= _LARGEST and not any(map(reads, network.constraints))

    def proposals(self, start: Floats) -> Iterator[Floats]:
        """Points to prove, the best first: each with a larger margin than the one before."""
        scale = self._scale(start)
        yield from self._vertices(start, scale)
        point = self._slsqp(start, scale)
        if point is not None and self._whole.any():
            point = self._slsqp(np.where(self._whole, np.round(point), point), scale, fixed=True)
        if point is None:
            return
        for margin in MARGINS:
            inside = self.inside(point, margin, scale)
            if inside is not None:
                yield inside

    def _vertices(self, start: Floats, scale: Floats) -> Iterator[Floats]:
        """The optimum that linear programs reach, where it is a vertex of inequalities: see `linear_steps`."""
        if self._equations.count or self._whole.any():
            return
        cost = np.zeros(len(start))
        cost[self._objective] = 1.0
        for margin in MARGINS:
            found = linear_steps(
                self._rows, cost, self._domain, start, Dense(), scale=scale, margin=margin, deadline=self._deadline
            )
            if found is None:
                return
            yield found
            start = found

    def inside(self, point: Floats, margin: float, scale: Floats) -> Floats | None:
        """A point near the given one that holds the equations, and the inequalities with a margin, to first order."""
        for _ in range(_ROUNDS):
            step = self._step(point, margin, scale)
            if step is None:
                return None
            point = np.clip(point + step, self._domain.lo, self._domain.hi)
            if float(np.max(np.abs(step) / scale, initial=0.0)) < 1e-13:
                break
        return point

    def _step(self, point: Floats, margin: float, scale: Floats) -> Floats | None:
        rows = self._rows.linearize(point)
        matrix, right = self._scaled(rows, scale, margin)
        value, jacobian = self._equations.estimate(point)
        equal = jacobian * scale
        if not (np.isfinite(matrix).all() and np.isfinite(right).all() and np.isfinite(equal).all()):
            return None
        near = right < _REACH * np.abs(matrix).sum(axis=1)  # the others can not be reached
        size = np.abs(equal).sum(axis=1) + 1e-300
        with np.errstate(all="ignore"):
            limits, missing = right[near] / _REACH, -value / size / _REACH
        if not (np.isfinite(limits).all() and np.isfinite(missing).all()):  # a row that no step mends
            return None
        low = np.clip((self._domain.lo - point) / scale, -_REACH, 0.0) / _REACH
        high = np.clip((self._domain.hi - point) / scale, 0.0, _REACH) / _REACH
        low, high = np.where(self._whole, 0.0, low), np.where(self._whole, 0.0, high)
        linprog: Any = _scipy().linprog  # typed for other arguments than these
        n = len(point)  # the step is p - q, of the least sum |p| + |q|: where it need not move, it does not
        found = linprog(
            np.ones(2 * n),
            A_ub=_twice(matrix[near]) if near.any() else None,
            b_ub=limits if near.any() else None,
            A_eq=_twice(equal / size[:, None]) if len(equal) else None,
            b_eq=missing if len(equal) else None,
            bounds=np.stack([np.zeros(2 * n), np.concatenate([high, -low])], axis=1),
            method="highs",
            options={"primal_feasibility_tolerance": 1e-10},
        )
        return None if found.x is None else np.asarray((found.x[:n] - found.x[n:]) * _REACH * scale)

    def _scaled(self, rows: RowValues, scale: Floats, margin: float) -> tuple[Floats, Floats]:
        matrix = rows.jacobian * scale
        size = np.maximum(np.abs(matrix).max(axis=1, initial=0.0), 1e-300)
        return matrix / size[:, None], -rows.values / size - margin

    def _scale(self, start: Floats) -> Floats:
        width = self._domain.width
        usual = np.maximum(np.abs(start), 1.0)
        return np.where(np.isfinite(width) & (width < _WIDE) & (width > 0.0), width, usual)

    def _slsqp(self, start: Floats, scale: Floats, *, fixed: bool = False) -> Floats | None:
        """A local minimum in scaled components, or wherever it stops; `fixed`: whole numbers stay as they are."""
        stay = self._whole & fixed
        lo = np.where(stay, start, self._domain.lo) / scale
        hi = np.where(stay, start, self._domain.hi) / scale
        known = _Known(self._rows, self._equations, scale, max(self._deadline, time.monotonic() + _GRACE))
        constraints = [
            {"type": "ineq", "fun": lambda y: -known(y)[0], "jac": lambda y: -known(y)[1]},
            {"type": "eq", "fun": lambda y: known(y)[2], "jac": lambda y: known(y)[3]},
        ]
        direction = np.zeros(len(start))
        direction[self._objective] = 1.0
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            try:
                last = (
                    _scipy()
                    .minimize(
                        lambda y: float(y[self._objective]),
                        np.clip(start / scale, lo, hi),
                        jac=lambda y: direction,
                        bounds=list(zip(lo, hi, strict=True)),
                        constraints=constraints if self._equations.count else constraints[:1],
                        method="SLSQP",
                        options={"maxiter": _ITERATIONS, "ftol": 1e-13},
                    )
                    .x
                )
            except _LateError:
                last = known.last
            except (ValueError, np.linalg.LinAlgError):
                return None
        point = np.asarray(last * scale)
        return np.clip(point, self._domain.lo, self._domain.hi) if np.isfinite(point).all() else None


def _scipy() -> Any:
    """scipy's optimisers, which take half a second to load: few problems come here."""
    from scipy import optimize

    return optimize


class _LateError(Exception):
    """The time limit came first."""


class _Known:
    """Values and derivatives at the last point that was asked about, each row in units of its gradient there first.

    Raises _LateError after `deadline`; `last` is the point that was asked about before.
    """

    def __init__(self, rows: Rows, equations: Equations, scale: Floats, deadline: float) -> None:
        self._rows, self._equations, self._scale, self._deadline = rows, equations, scale, deadline
        self.last: Floats
        self._at: bytes = b""
        self._found: tuple[Floats, Floats, Floats, Floats]
        self._sizes: tuple[Floats, Floats] | None = None

    def __call__(self, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        if y.tobytes() != self._at:
            if self._at and time.monotonic() > self._deadline:
                raise _LateError
            self._at, self.last = y.tobytes(), y.copy()
            rows = self._rows.linearize(y * self._scale)
            value, jacobian = self._equations.estimate(y * self._scale)
            matrix, equal = rows.jacobian * self._scale, jacobian * self._scale
            if self._sizes is None:
                self._sizes = (_size(matrix), _size(equal))
            one, two = self._sizes
            found = rows.values / one, matrix / one[:, None], value / two, equal / two[:, None]
            self._found = tuple(_finite(part) for part in found)  # type: ignore[assignment]
        return self._found


def _finite(values: Floats) -> Floats:
    return np.asarray(np.nan_to_num(values, nan=1e10, posinf=1e10, neginf=-1e10))


def _size(matrix: Floats) -> Floats:
    return np.asarray(np.clip(np.abs(matrix).max(axis=1, initial=0.0), 1e-6, 1e12))


def _twice(matrix: Floats) -> Floats:
    return np.concatenate([matrix, -matrix], axis=1)
