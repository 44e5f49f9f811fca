"""The interval Newton operators of Hansen and Sengupta, and of Krawczyk.

Both take m equations `F(x) in value + jacobian (x - c)` and m unknowns, the `columns` of the box X, multiply by the
approximate inverse C of the Jacobian's midpoint, and give a box N(X) that holds every zero of F in X. With
y = C F(c), A = C J:

    Hansen-Sengupta    N_i = c_i - (y_i + sum_{j != i} A_ij (x_j - c_j)) / A_ii, one i after the other, each using
                       the narrowed x_j before it (Gauss-Seidel); cut off (to rounding) at the ends of X
    Krawczyk           N   = c - y + (I - A) (X - c); not intersected with X

If F is continuous on X and N(X) lies in the interior of X, X holds exactly one zero of F, and it lies in N(X)
(Neumaier, Interval Methods for Systems of Equations, 1990, chapter 5; any matrix of slopes serves as J). For columns
that are not unknowns both hold for every value of them in X. The computation itself is in `square`.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

import numpy as np

from cpcal.common.arrays import Indices
from cpcal.solver.existence import square
from cpcal.solver.existence.deadline import stop_flag
from cpcal.solver.existence.equalities import Linearization
from cpcal.solver.interval import Arithmetic, IntervalArray
from cpcal.solver.network.engines import in_arithmetic


class Operator(Enum):
    """Which of the two."""

    HANSEN_SENGUPTA = 0
    KRAWCZYK = 1


hansen_sengupta, krawczyk = Operator


def square_of(engine: Arithmetic) -> Any:
    """The functions of `square`, by name, in an engine's arithmetic."""
    return in_arithmetic(engine.name, square)


def image(
    operator: Operator,
    engine: Arithmetic,
    linear: Linearization,
    columns: Indices,
    box: IntervalArray,
    deadline: float = math.inf,
) -> IntervalArray | None:
    """N(X) for as many equations as `columns`; NaN everywhere when X holds no zero.

    None where there is no inverse, or it was not finished at the deadline (of time.monotonic()).
    """
    bounds = np.stack([box.lo, box.hi], axis=1)
    out = np.full(bounds.shape, np.nan)
    rows = np.arange(len(columns))
    given = (_pairs(linear.value), _pairs(linear.jacobian), np.array(linear.center), rows, np.array(columns))
    with stop_flag(deadline, len(columns)) as stop:
        found = square_of(engine).newton_image(operator.value, *given, stop, bounds, out)
    return None if found < 0 else IntervalArray(out[:, 0].copy(), out[:, 1].copy())


def _pairs(x: IntervalArray) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.stack([x.lo, x.hi], axis=-1)


def inside(inner: IntervalArray, outer: IntervalArray, columns: Indices) -> bool:
    """Whether the unknowns of one box lie in the interior of another."""
    return bool((inner.lo > outer.lo)[columns].all() and (inner.hi < outer.hi)[columns].all())
