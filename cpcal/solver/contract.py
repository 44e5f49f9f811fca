"""Every contract that crosses a border, on one page. Imports nothing of cpcal at run time."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from cpcal.solver.interval import Box


class Verdict(Enum):
    """What is known of a statement. `UNKNOWN` is never reported as a proof."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class StepWeights:
    """The multipliers that carry a step, for whoever proves it again: on the box that was contracted.

    `rows`: (constraint, part, element, weight), parts being the polynomial rows of one constraint in order;
    `products`: (variable i, variable j, p, q, weight) of the bound product (1 + p u_i)(1 + q u_j) in the box's
    coordinates u; `tangents`: (i, t, weight) of (u_i - t)^2. None of it need be trusted.
    """

    rows: tuple[tuple[int, int, int, float], ...]
    products: tuple[tuple[int, int, float, float, float], ...]
    tangents: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True)
class Step:
    """One proved removal: no solution of the network lies in `box` outside of what is left.

    `variable` is the component whose bound on `side` ("lo" or "hi") moved to `bound`, or None when the
    whole box was proved empty. `rows` are the (constraint, measurement) pairs that carry the proof.
    """

    contractor: str
    variable: str | None
    side: str
    bound: float
    rows: tuple[tuple[int, int], ...] = ()
    weights: StepWeights | None = None


@dataclass(frozen=True)
class Polyhedron:
    """Every solution in the box that was contracted satisfies `matrix @ x <= rhs`.

    In exact arithmetic on these float64 numbers: matrix (m, n), rhs (m,), x in the order of `names`.
    """

    names: tuple[str, ...]
    matrix: npt.NDArray[np.float64]
    rhs: npt.NDArray[np.float64]

    def __contains__(self, point: Iterable[float]) -> bool:
        """Whether a point satisfies every row, decided in exact fractions."""
        x = [Fraction(v) for v in point]
        rows = zip(self.matrix.tolist(), self.rhs.tolist(), strict=True)
        return all(sum((Fraction(a) * v for a, v in zip(row, x, strict=True) if a), Fraction()) <= b for row, b in rows)


@dataclass(frozen=True)
class Contraction:
    """What a contractor made of a box: a subset that holds all its solutions, and why.

    `point` is a promising point of the new box (one value per component), proposed without proof. Some
    contractors enclose the solutions by a polyhedron too: they lie in `box` and in `polyhedron`.
    """

    box: Box
    steps: tuple[Step, ...] = ()
    point: npt.NDArray[np.float64] | None = None
    programs: int = 0  # linear programs solved on the way
    polyhedron: Polyhedron | None = None


class Contractor(Protocol):
    """Removes from a box points that are no solutions, never a solution. Holds no state between calls.

    `idempotent` promises that a second call on the result changes nothing.
    """

    idempotent: bool

    def contract(self, box: Box) -> Contraction: ...


@runtime_checkable
class Supporting(Protocol):
    """What a contractor may offer besides: half-spaces that hold all solutions in a box."""

    def supports(self, box: Box, directions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Proved upper bounds (m,) of `directions @ x` over the solutions x in `box`; `directions` is (m, n).

        -inf for all when the box is proved to hold no solution.
        """
        ...


class Strategy(Protocol):
    """Chooses how to divide a box: a cover of it, or () when it is fine enough to be kept."""

    def split(self, box: Box) -> tuple[Box, ...]: ...


class LinearStatus(Enum):
    """What a linear engine says. No status is a proof: the multipliers decide."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True)
class LinearSolution:
    """Approximate answer to `min c.z : rows z <= rhs, lower <= z <= upper`; `multipliers` >= 0, one per row.

    With status INFEASIBLE the multipliers are those of the elastic program: a Farkas ray.
    """

    status: LinearStatus
    point: npt.NDArray[np.float64]  # (columns,)
    multipliers: npt.NDArray[np.float64]  # (rows,)


class LinearEngine(Protocol):
    """One polyhedron, many objectives. Proposes; rigorous arithmetic disposes."""

    def load(
        self,
        matrix: npt.NDArray[np.float64],
        rhs: npt.NDArray[np.float64],
        lower: npt.NDArray[np.float64],
        upper: npt.NDArray[np.float64],
    ) -> None:
        """Forget what was before and take `matrix z <= rhs`, `lower <= z <= upper` (finite bounds)."""
        ...

    def add_rows(self, matrix: npt.NDArray[np.float64], rhs: npt.NDArray[np.float64]) -> None: ...

    def minimize(self, objective: npt.NDArray[np.float64]) -> LinearSolution:
        """Minimise from the last basis."""
        ...


@dataclass(frozen=True)
class Limits:
    """Where a search stops at the latest, with what it has proved so far."""

    seconds: float | None = None
    nodes: int | None = None
    gap: float = 1e-6  # relative, of a bracket
    gap_absolute: float = 1e-9  # in the objective's unit

    def clock(self) -> Clock:
        """A clock that starts now."""
        return Clock(self, math.inf if self.seconds is None else time.monotonic() + self.seconds)


@dataclass(frozen=True)
class Clock:
    """Limits that began to count at some moment."""

    limits: Limits
    deadline: float

    def over(self, nodes: int = 0) -> bool:
        """Whether the time or the nodes are used up."""
        too_many = self.limits.nodes is not None and nodes >= self.limits.nodes
        return too_many or time.monotonic() > self.deadline
