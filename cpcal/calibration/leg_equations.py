"""The calibration equations of some legs and their derivatives, in plain floating point, vectorised over N poses.

With v = P + R b - a (mm, base frame), leg by leg (the paper, eq. 2 and 15):

    "f"    f(x, M) = ||v||^2 - (L + l)^2     mm^2
    "g"    g(x, M) = ||v||   - (L + l)       mm        f = (||v|| + L + l) g: the same zeros on legs of positive length

A turn theta (rotation vector in the base frame, so R becomes R(theta) R) moves v by theta x R b.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats, frozen_array
from cpcal.robot import Campaign, quaternion_from_rotation_vector, rotation_matrix

# ------------------------------------------------------------------------------------------------------------------
# Robust losses as scipy.optimize.least_squares defines them, and what a fit with one is worth (Huber's theory).
#
# A loss rho is a function of z = (r / c)^2 for a residual r and a scale c; r counts as if it were psi(r) = rho'(z) r.

Loss = Literal["linear", "soft_l1", "huber", "cauchy", "arctan"]
LOSSES: tuple[Loss, ...] = get_args(Loss)

_GAUSS = 1.482602218505602  # 1 / the standard normal law's upper quartile: from a MAD to a standard deviation

# rho'(z) and rho''(z)
_DERIVATIVES: dict[Loss, Callable[[Floats], tuple[Floats, Floats]]] = {
    "linear": lambda z: (np.ones_like(z), np.zeros_like(z)),
    "soft_l1": lambda z: ((1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    "huber": lambda z: (np.maximum(z, 1.0) ** -0.5, np.where(z > 1, -0.5 * np.maximum(z, 1.0) ** -1.5, 0.0)),
    "cauchy": lambda z: (1 / (1 + z), -1 / (1 + z) ** 2),
    "arctan": lambda z: (1 / (1 + z**2), -2 * z / (1 + z**2) ** 2),
}


def robust_scale(residuals: Floats) -> float:
    """1.4826 times the median of |r|: the standard deviation of normal residuals, whatever a minority of them does."""
    return _GAUSS * float(np.median(np.abs(residuals)))


def pseudo_residuals(residuals: Floats, loss: Loss, scale: Floats) -> Floats:
    """psi(r) / mean psi'(r), mean over rows: residuals (N, n) of the linear fit that errs as the robust one does.

    scale (n,). The covariance of these, in place of the residuals', gives that of the estimate (Huber, Robust
    Statistics, section 7.6: psi' replaced by its mean).
    """
    if loss == "linear":
        return residuals
    z = (residuals / scale) ** 2
    first, second = _DERIVATIVES[loss](z)
    return np.asarray(first * residuals / np.mean(first + 2 * z * second, axis=0))


# ------------------------------------------------------------------------------------------------------------------
# Least squares by Gauss-Newton steps, damped where they do not reduce the sum (Levenberg and Marquardt).

_STEPS = 200
_RANK = 1e-13  # of the largest singular value: a direction below it stays as it is
_FIRST = 1e-4  # damping, of the square of the largest singular value
_MOST = 1e12


def sum_of_squares(
    values: Callable[[Floats], Floats], jacobian: Callable[[Floats], Floats], start: Floats, tolerance: float
) -> tuple[Floats, bool]:
    """x (n,) that minimises the sum of squares of `values` (m,), near `start`, and whether the search came to rest.

    At rest: a step changes the sum, or x, by less than `tolerance` of itself, or the gradient vanishes to that.
    Directions of x that change nothing stay as they are, so of many minima it is one near the start.
    """
    x, found = start, values(start)
    damping = 0.0
    for _ in range(_STEPS):
        cost = float(found @ found)
        left, s, right = np.linalg.svd(jacobian(x), full_matrices=False)
        slope = left.T @ found
        if not cost > 0.0 or float(np.max(np.abs(right.T @ (s * slope)))) < tolerance:
            return x, True
        seen = s > _RANK * s[0]
        while True:
            factors = np.where(seen, s / np.where(seen, s**2 + damping * s[0] ** 2, 1.0), 0.0)
            step = -(right.T @ (factors * slope))
            after = values(x + step)
            new = float(after @ after)
            small = float(np.linalg.norm(step)) < tolerance * (tolerance + float(np.linalg.norm(x)))
            if new < cost:
                break
            if small or damping > _MOST:
                return x, True
            damping = max(10.0 * damping, _FIRST)
        x, found, damping = x + step, after, damping / 30.0 if damping > _FIRST else 0.0
        if small or cost - new < tolerance * cost:
            return x, True
    return x, False


Form = Literal["f", "g"]

_SHORTEST = 1e-300  # mm: the norm of a leg of length zero, where g has no derivative, instead of a division by zero


@dataclass(frozen=True, eq=False)
class LegEquations:
    """F(x) of n legs at N measurements, for parameters x (n, 7) in mm: rows a_x a_y a_z b_x b_y b_z l.

    position (N, 3) mm; rotation (N, 3, 3); length (N, n) mm. Values in mm (form "g") or mm^2 (form "f").
    """

    position: Floats
    rotation: Floats
    length: Floats
    form: Form = "g"

    @classmethod
    def of(cls, campaign: Campaign, legs: Sequence[int], form: Form = "g") -> LegEquations:
        """Of the legs with these numbers, from 1, at the centres of the campaign's reading sets."""
        columns = [leg - 1 for leg in legs]
        return cls(campaign.position, rotation_matrix(campaign.quaternion), campaign.length[:, columns], form)

    def only(self, columns: Sequence[int]) -> LegEquations:
        """Of some of these legs, counted from 0."""
        return LegEquations(self.position, self.rotation, self.length[:, list(columns)], self.form)

    def values(self, x: Floats) -> Floats:
        """F, (N, n)."""
        vector, _ = self.vectors(x)
        total = self.length + x[:, 6]
        if self.form == "f":
            return np.asarray(np.sum(vector**2, axis=-1) - total**2)
        return np.asarray(np.linalg.norm(vector, axis=-1) - total)

    def by_parameters(self, x: Floats) -> Floats:
        """dF/dx, (N, n, 7): [-2 v, 2 R' v, -2 (L + l)] for f; [-v/||v||, R' v/||v||, -1] for g."""
        along = self._along(x)
        turned = np.einsum("kni,kij->knj", along, self.rotation)
        return np.concatenate([-along, turned, self.by_length(x)[..., None]], axis=-1)

    def by_pose(self, x: Floats) -> Floats:
        """dF/d(P, theta), (N, n, 6): for f [2 v, 2 R b x v], for g [v, R b x v] / ||v||; per mm and per rad."""
        along = self._along(x)
        _, arm = self.vectors(x)
        return np.concatenate([along, np.cross(arm, along)], axis=-1)

    def by_length(self, x: Floats) -> Floats:
        """dF/dL, (N, n): -2 (L + l) for f, -1 for g."""
        return -2.0 * (self.length + x[:, 6]) if self.form == "f" else -np.ones_like(self.length)

    def vectors(self, x: Floats) -> tuple[Floats, Floats]:
        """v and R b, each (N, n, 3)."""
        arm = np.einsum("kij,nj->kni", self.rotation, x[:, 3:6])
        return np.asarray(self.position[:, None, :] + arm - x[:, :3]), np.asarray(arm)

    def _along(self, x: Floats) -> Floats:
        """dF/dv, (N, n, 3)."""
        vector, _ = self.vectors(x)
        if self.form == "f":
            return 2.0 * vector
        return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), _SHORTEST))


def weighted_jacobian(equations: LegEquations, weight: Floats, x: Floats) -> Floats:
    """d(W_k F_k)/dx of all measurements, (N n, 7 n), for weights W (N, n, n): rows by measurement, then leg."""
    product = weight[..., None] * equations.by_parameters(x)[:, None, :, :]
    count, legs = equations.length.shape
    return np.asarray(product.reshape(count * legs, 7 * legs))


# ------------------------------------------------------------------------------------------------------------------
# How far the readings' noise moves the calibration equations, and the weights that undo it.
#
# First-order propagation (the paper, section 3.2; Wampler, Hollerbach and Arai 1995): with B = dF/dM the equations of
# measurement k have the covariance
#
#     Sigma_k = B_pose Sigma_pose B_pose' + diag(B_length^2 sigma_length^2)            n x n, one row a leg
#
# The pose noise of a measurement is one and the same for all its legs, so Sigma_k is full: legs are independent in
# their unknowns, not in their errors. (The paper writes `Sigma_F^-1 = dF/dM Sigma_M^-1`, whose shapes do not fit; this
# is what its words say.)

Weights = Literal["none", "legs", "joint"]

_SYMMETRIC = 1e-9  # relative: how far a covariance may be from symmetric, and its eigenvalues below zero


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariances of N measurements' readings; measurements are independent of one another.

    pose         (N, 6, 6): of the position (mm) and the rotation vector in the base frame (rad)
    length       (N, n): standard deviations of the leg readings, mm, independent of the pose
    correlation  (n, n): of the leg readings of one measurement; None where they are independent of one another
    freedom      degrees of freedom that these were estimated with; infinite where they are known

    Raises InputError when a shape is wrong, or a matrix is no covariance.
    """

    pose: Floats
    length: Floats
    correlation: Floats | None = None
    freedom: float = np.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen_array(self.pose))
        object.__setattr__(self, "length", frozen_array(self.length))
        if self.correlation is not None:
            object.__setattr__(self, "correlation", frozen_array(self.correlation))
        pose, length = self.pose, self.length
        if pose.ndim != 3 or pose.shape[1:] != (6, 6) or length.ndim != 2 or len(length) != len(pose):
            what = f"has the shapes {pose.shape} and {length.shape}"
            raise InputError([Problem("noise", what, "give pose (N, 6, 6) and length (N, n)")])
        if not (np.isfinite(pose).all() and np.isfinite(length).all() and (length >= 0).all()):
            raise InputError([Problem("noise", "holds a negative or non-finite number", "give finite numbers >= 0")])
        size = np.abs(pose).max(axis=(1, 2), initial=0.0)
        skew = np.abs(pose - pose.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
        bad = np.flatnonzero((skew > _SYMMETRIC * size) | (np.linalg.eigvalsh(pose)[:, 0] < -_SYMMETRIC * size))
        if len(bad):
            what = f"the pose's matrix of row {bad[0]} is not symmetric and positive semidefinite"
            raise InputError([Problem("noise", what, "give covariances")])
        joint = self.correlation
        if joint is not None and not _is_correlation(joint, length.shape[1]):
            what = f"the correlation, of shape {joint.shape}, is none of {length.shape[1]} leg readings"
            raise InputError(
                [Problem("noise", what, "give (n, n), symmetric, positive semidefinite, 1 on the diagonal")]
            )

    @classmethod
    def from_sigmas(
        cls, position: npt.ArrayLike, rotation: npt.ArrayLike, length: npt.ArrayLike, *, count: int
    ) -> Noise:
        """Uncorrelated readings: standard deviations of position (mm) and rotation (rad) (3,) or (N, 3), and of
        the leg readings (mm) (n,) or (N, n), for `count` measurements."""
        try:
            pose = np.concatenate([_rows(position, count), _rows(rotation, count)], axis=1)
            lengths = _rows(length, count)
        except ValueError as error:
            raise InputError([Problem("noise", str(error), "give (3,), (3,) and (n,), or one row each")]) from None
        return cls(pose[:, :, None] ** 2 * np.eye(pose.shape[1]), lengths)

    @classmethod
    def of(cls, campaign: Campaign, factor: float | None = None) -> Noise:
        """From a campaign's half-widths, row by row: sigma = half-width / factor.

        `factor` is what the campaign declares when not given. InputError when it declares none: half-widths alone do
        not tell a standard deviation.
        """
        declared = campaign.uncertainty.factor if campaign.uncertainty is not None else None
        divisor = declared if factor is None else factor
        if campaign.exact or divisor is None or not 0 < divisor < np.inf:
            what = "declares exact readings" if campaign.exact else "does not say how many sigma its half-widths are"
            raise InputError([Problem("campaign", what, "give the standard deviations: factor=, or Noise.from_sigmas")])
        radii = (campaign.position_radius, campaign.rotation_radius, campaign.length_radius)
        return cls.from_sigmas(*(radius / divisor for radius in radii), count=len(campaign))

    def of_legs(self, columns: list[int]) -> Noise:
        """Of some of the legs, counted from 0."""
        joint = self.correlation
        kept = None if joint is None else joint[np.ix_(columns, columns)]
        return Noise(self.pose, self.length[:, columns], kept, self.freedom)

    @property
    def length_root(self) -> Floats:
        """(N, n, n): A with A A' the covariance of the leg readings of each measurement, mm."""
        size = self.length.shape[1]
        if self.correlation is None:
            return self.length[:, :, None] * np.eye(size)
        values, axes = np.linalg.eigh(self.correlation)
        return np.asarray(self.length[:, :, None] * (axes * np.sqrt(np.maximum(values, 0.0))))

    def propagated(self, equations: LegEquations, x: Floats) -> Floats:
        """Sigma_k of every measurement, (N, n, n): mm^2 for g, mm^4 for f."""
        by_pose = equations.by_pose(x)
        read = equations.by_length(x)[:, :, None] * self.length_root
        return np.asarray(by_pose @ self.pose @ by_pose.transpose(0, 2, 1) + read @ read.transpose(0, 2, 1))


def whitening(sigma: Floats, weights: Weights) -> Floats:
    """W_k (N, n, n) so that the weighted equations are W_k F_k, from Sigma_k (N, n, n).

    "none": the identity. "legs": each leg divided by its own standard deviation, which disregards that legs of one pose
    err together. "joint": the inverse of the Cholesky factor, W Sigma W' = 1: all legs together, the efficient choice.
    """
    count, legs = sigma.shape[:2]
    if weights == "none":
        return np.broadcast_to(np.eye(legs), (count, legs, legs))
    variance = np.diagonal(sigma, axis1=1, axis2=2)
    if not (variance > 0).all():
        row = int(np.flatnonzero(~(variance > 0).all(axis=1))[0])
        what = f"leaves an equation of row {row} without any error: its weight would be infinite"
        raise InputError([Problem("noise", what, "give every reading a standard deviation > 0")])
    deviation = np.sqrt(variance)
    scale = np.eye(legs) / deviation[:, :, None]
    if weights == "legs":
        return scale
    try:  # of the correlations, whose entries are of order one whatever the units
        factor = np.linalg.cholesky(sigma / (deviation[:, :, None] * deviation[:, None, :]))
    except np.linalg.LinAlgError:
        what = "makes the legs' errors exactly dependent: their covariance has no inverse"
        raise InputError([Problem("noise", what, 'give lengths a sigma > 0, or use weights="legs"')]) from None
    return np.asarray(np.linalg.solve(factor, scale))


def _is_correlation(matrix: Floats, size: int) -> bool:
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        return False
    near = np.allclose(matrix, matrix.T, atol=_SYMMETRIC) and np.allclose(np.diagonal(matrix), 1.0, atol=_SYMMETRIC)
    return bool(near and np.linalg.eigvalsh(matrix)[0] >= -_SYMMETRIC * size)


def _rows(values: npt.ArrayLike, count: int) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    return np.broadcast_to(array, (count, array.shape[-1] if array.ndim else 1))


# ------------------------------------------------------------------------------------------------------------------
# How much of what seems to determine the parameters is the readings' noise itself.
#
# The Jacobian A of a fit is formed with noisy readings. Where poses hardly differ in some respect, noise is what makes
# them differ: A'A then has full rank by E[dA'dA] alone, estimates are drawn towards values that make the noise harmless
# (errors in variables), and their standard errors know nothing of it. The largest ratio
#
#     max over directions d of   d' E[dA'dA] d / d' A'A d
#
# is near 0 for good data, where first-order propagation holds, and near 1 where some direction is seen by noise alone.


def noise_share(
    equations: LegEquations, weight: Floats, noise: Noise, x: Floats, values: Floats, right: Floats
) -> float:
    """The ratio above for x (n, 7) and weights W (N, n, n), over the row space of A.

    values (r,) and right (r, 7 n) are singular values of A, all > 0, and its right singular vectors.
    """
    scaled = np.zeros((len(values), len(values)))
    basis = right.T / values
    for move, turn, longer in _directions(noise):
        ahead, back = (_moved(equations, sign * move, sign * turn, sign * longer) for sign in (1.0, -1.0))
        change = 0.5 * (weighted_jacobian(ahead, weight, x) - weighted_jacobian(back, weight, x)) @ basis
        scaled += change.T @ change
    return float(np.linalg.eigvalsh(scaled)[-1])


def _directions(noise: Noise) -> list[tuple[Floats, Floats, Floats]]:
    """Independent moves (N, 3), turns (N, 3) and changes of length (N, n), of one standard deviation each."""
    variances, axes = np.linalg.eigh(noise.pose)
    roots = axes * np.sqrt(np.maximum(variances, 0.0))[:, None, :]
    legs, longer = noise.length.shape[1], noise.length_root
    nothing, still = np.zeros((len(roots), 3)), np.zeros_like(noise.length)
    poses = [(roots[:, :3, c], roots[:, 3:, c], still) for c in range(6)]
    return poses + [(nothing, nothing, longer[:, :, leg]) for leg in range(legs)]


def _moved(equations: LegEquations, move: Floats, turn: Floats, longer: Floats) -> LegEquations:
    rotation = rotation_matrix(quaternion_from_rotation_vector(turn)) @ equations.rotation
    return LegEquations(equations.position + move, rotation, equations.length + longer, equations.form)


def chances(square: float, freedom: float, known: float) -> tuple[float, float]:
    """Of so small, and so large, a sum of squares in standard deviations known with so many degrees of freedom."""
    from scipy import special  # here: it takes a third of a second to load

    if np.isinf(known):
        return float(special.chdtr(freedom, square)), float(special.chdtrc(freedom, square))
    ratio = square / freedom
    return float(special.fdtr(freedom, known, ratio)), float(special.fdtrc(freedom, known, ratio))
