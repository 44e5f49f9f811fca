"""Least squares: the one loop. Gauss-Newton steps, damped where they do not lower the cost (Levenberg and Marquardt).

Proposes a point; proves nothing. Unknowns that many residuals share and unknowns of single blocks of residuals (the
poses of views, the readings of images) are told apart by `Blocks`: each block's own are eliminated (Schur complement),
so that time grows with the number of blocks and no faster. With s the shared step and o_v that of block v,

    [ A  B' ] [s]   [a]         (A - sum_v B_v' C_v^-1 B_v) s = a - sum_v B_v' C_v^-1 c_v
    [ B  C  ] [o] = [c]         o_v = C_v^-1 (c_v - B_v s)
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from cpcal.common.values import TINY, ArrayPair, Floats, all_finite

T = TypeVar("T")

_RANK = 1e-13  # of the largest singular value: a direction below it stays as it is
_FIRST = 1e-4  # damping: of the square of the largest singular value, or of the diagonal of normal equations
_MOST = 1e12


@dataclass(frozen=True)
class Fit(Generic[T]):
    """Where the search ended, the cost there, and whether it came to rest."""

    at: T
    cost: float
    settled: bool


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of unknowns that all residuals share and of those of v blocks, which meet only the shared ones.

    shared  (s, s)     A        shared_side (s,)    a = -J'r
    mixed   (v, k, s)  B
    own     (v, k, k)  C        own_side    (v, k)  c
    """

    shared: Floats
    shared_side: Floats
    mixed: Floats
    own: Floats
    own_side: Floats

    def reduced(self) -> ArrayPair:
        """The equations (s, s), (s,) of the shared unknowns alone. Raises LinAlgError where a block is singular."""
        both = np.concatenate([self.mixed, self.own_side[..., None]], axis=2)
        size = len(self.shared)
        gone = self.mixed.reshape(-1, size).T @ np.linalg.solve(self.own, both).reshape(-1, size + 1)
        return self.shared - gone[:, :-1], self.shared_side - gone[:, -1]

    def step(self, damping: float) -> Floats:
        """(s + v k,) the shared unknowns' step, then block by block; nan where the equations are singular."""
        damped = replace(
            self,
            shared=self.shared + damping * np.diag(np.diag(self.shared)),
            own=self.own + damping * self.own * np.eye(self.own.shape[1]),
        )
        try:
            matrix, side = damped.reduced()
            scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), TINY))
            shared = scale * np.linalg.solve(matrix * scale[:, None] * scale, side * scale)
            own = np.linalg.solve(damped.own, (self.own_side - self.mixed @ shared)[..., None])
        except np.linalg.LinAlgError:
            return np.full(len(self.shared) + self.own_side.size, np.nan)
        return np.concatenate([shared, own.ravel()])

    @property
    def slope(self) -> float:
        """The largest element of J'r."""
        return max(float(np.max(np.abs(side), initial=0.0)) for side in (self.shared_side, self.own_side))


class _Rows:
    """The same of a whole Jacobian, by singular values: directions that change nothing stay as they are."""

    def __init__(self, residual: Floats, jacobian: Floats) -> None:
        left, self._s, self._right = np.linalg.svd(jacobian, full_matrices=False)
        self._along = left.T @ residual.ravel()
        self.slope = float(np.max(np.abs(self._right.T @ (self._s * self._along)), initial=0.0))

    def step(self, damping: float) -> Floats:
        s = self._s
        seen = s > _RANK * s[0]
        factors = np.where(seen, s / np.where(seen, s**2 + damping * s[0] ** 2, 1.0), 0.0)
        return -(self._right.T @ (factors * self._along))


def least_squares(
    residual: Callable[[T], Floats],
    jacobian: Callable[[T], Floats | Blocks],
    start: T,
    *,
    tolerance: float,
    moved: Callable[[T, Floats], T | None] = operator.add,
    steps: int = 200,
) -> Fit[T]:
    """A place near `start` that minimises the sum of squares of `residual`, m numbers in any shape.

    jacobian   its derivative (m, n), or the normal equations in `Blocks`
    moved      the place that a step (n,) leads to, None where there is none; by default steps are added
    tolerance  it is at rest where a step changes the cost, or an array, by less than this share, or where the gradient
               vanishes to this number

    Places whose cost is not finite are never entered. Directions that change nothing stay as they are, so of many
    minima it is one near the start.
    """

    def costs(x: T) -> tuple[float, Floats]:
        found = residual(x)
        value = float(found.ravel() @ found.ravel())
        return (value if np.isfinite(value) else np.inf), found

    at, damping = start, 0.0
    now, found = costs(at)
    for _ in range(steps):
        linear = jacobian(at)
        model = linear if isinstance(linear, Blocks) else _Rows(found, linear)
        if not now > 0.0 or model.slope < tolerance:
            return Fit(at, now, True)
        while True:
            step = model.step(damping)
            trial = moved(at, step) if all_finite(step) else None
            new, after = (np.inf, found) if trial is None else costs(trial)
            size = float(np.linalg.norm(at)) if isinstance(at, np.ndarray) else 0.0
            small = float(np.linalg.norm(step)) < tolerance * (tolerance + size)
            if trial is not None and new < now:
                break
            if small or damping > _MOST:
                return Fit(at, now, True)
            damping = max(10.0 * damping, _FIRST)
        gained, before = now - new, now
        at, now, found, damping = trial, new, after, damping / 30.0 if damping > _FIRST else 0.0
        if small or gained < tolerance * before:
            return Fit(at, now, True)
    return Fit(at, now, False)
