"""Least squares on rigid motions for `X B_i = A_i Z`, and for `X B_i = A_i X` (Z tied to X).

The residuals of a pair are the two ways to the same pose compared in A's reference frame,

    position   t_X + R_X t_B - t_A - R_A t_Z          rotation   log(R_X R_B (R_A R_Z)^T), a rotation vector in rad

and a motion is varied as (P + p, exp(w) R) with w a rotation vector in the motion's reference frame. Lengths have
the unit of the pairs. The order of the unknowns is (p_X, w_X, p_Z, w_Z).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from cpcal.calibration.pose_pairs import Pairs
from cpcal.robot import Pose, compose, inverse, quaternion_from_rotation_vector, quaternion_product, rotation_vector

Array = npt.NDArray[np.float64]

_FLOOR = 1e-13  # of standard deviations, for data without noise
_ROUNDS = 30  # of weights from residuals and residuals from weights
_STEPS = 100  # of Levenberg-Marquardt, in each round
_END = 1e-13  # its relative tolerances
_SETTLED = 1e-4  # the relative change of the weights that ends them


@dataclass(frozen=True, eq=False)
class Refined:
    """The motions, the weights that were used, and the covariance (12, 12) or, tied, (6, 6)."""

    x: Pose
    z: Pose
    sigma_position: float
    sigma_rotation: float
    unit_weight: float
    covariance: Array


def residuals(pairs: Pairs, x: Pose, z: Pose) -> tuple[Array, Array]:
    """Position (N, 3) and rotation (N, 3) rad of the text above."""
    left, right = compose(x, pairs.b), compose(pairs.a, z)
    turn = compose(left, inverse(right))
    return left.position - right.position, rotation_vector(turn.quaternion)


def refined(
    pairs: Pairs,
    x: Pose,
    z: Pose,
    *,
    sigma_position: float | None = None,
    sigma_rotation: float | None = None,
    tied: bool = False,
    move: bool = True,
) -> Refined:
    """The motions with the smallest weighted sum of squares near x and z (or, without `move`, x and z themselves).

    A standard deviation that is None is estimated together with the motions. The covariance is that of linearised
    least squares, scaled by the residuals' own size (`unit_weight` squared, near 1 for right standard deviations).
    """
    given = np.array([np.nan if s is None else s for s in (sigma_position, sigma_rotation)])
    rms = [max(_FLOOR, float(np.sqrt(np.mean(e**2)))) for e in residuals(pairs, x, z)]
    sigma = np.where(np.isnan(given), rms, given)
    for _ in range(_ROUNDS):
        if move:
            x, z = _moved_to_minimum(pairs, x, z, sigma, tied)
        values, jacobian = _values(pairs, x, z, sigma), _columns(pairs, x, z, sigma, tied)
        cofactor: Array = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
        used, found = sigma, np.maximum(sigma * _sizes(values, jacobian, cofactor), _FLOOR)
        sigma = np.where(np.isnan(given), found, given)
        if np.allclose(sigma, used, rtol=_SETTLED, atol=0.0):
            break
    freedom = len(values) - jacobian.shape[1]
    weight = float(np.linalg.norm(values)) / np.sqrt(freedom)
    return Refined(x, z, float(used[0]), float(used[1]), float(weight), weight**2 * cofactor)


def _sizes(values: Array, jacobian: Array, cofactor: Array) -> Array:
    """Size (2,) of the weighted residuals of position and rotation, per degree of freedom of each.

    Residuals are smaller than errors because they were minimised: element i by its leverage, its share of the fit.
    This is the restricted maximum likelihood estimate of two variance components, by its fixed point.
    """
    leverage = np.einsum("ij,jk,ik->i", jacobian, cofactor, jacobian).reshape(-1, 2, 3)
    freedom = np.sum(1.0 - leverage, axis=(0, 2))
    square = np.sum(values.reshape(-1, 2, 3) ** 2, axis=(0, 2))
    return np.asarray(np.sqrt(square / np.maximum(freedom, 1e-3)), dtype=np.float64)


def _moved_to_minimum(pairs: Pairs, x: Pose, z: Pose, sigma: Array, tied: bool) -> tuple[Pose, Pose]:
    """Levenberg-Marquardt on the vector of steps away from x and z."""
    size = 6 if tied else 12

    def at(step: Array) -> tuple[Pose, Pose]:
        return (_moved(x, step[:6]),) * 2 if tied else (_moved(x, step[:6]), _moved(z, step[6:]))

    def slopes(step: Array) -> Array:
        columns = _columns(pairs, *at(step), sigma, tied)
        for k in range(3, size, 6):  # exp(w + dw) = exp(J dw) exp(w)
            columns[:, k : k + 3] = columns[:, k : k + 3] @ left_jacobian(step[k : k + 3])
        return columns

    def values(step: Array) -> Array:
        return _values(pairs, *at(step), sigma)

    start = np.zeros(size)
    found = least_squares(values, start, jac=slopes, method="lm", xtol=_END, ftol=_END, gtol=_END, max_nfev=_STEPS)
    return at(found.x)


def _values(pairs: Pairs, x: Pose, z: Pose, sigma: Array) -> Array:
    """Weighted residuals (6 N,)."""
    return np.asarray((np.concatenate(residuals(pairs, x, z), axis=1) / np.repeat(sigma, 3)).ravel())


def _columns(pairs: Pairs, x: Pose, z: Pose, sigma: Array, tied: bool) -> Array:
    """Their derivative (6 N, 12), or (6 N, 6) where Z is X."""
    jacobian = _jacobian(pairs, x, z) / np.repeat(sigma, 3)[:, None]
    columns = jacobian[:, :, :6] + jacobian[:, :, 6:] if tied else jacobian
    return np.asarray(columns.reshape(6 * len(pairs), -1))


def _moved(pose: Pose, step: Array) -> Pose:
    turn = quaternion_from_rotation_vector(step[3:])
    return Pose(pose.position + step[:3], quaternion_product(turn, pose.quaternion))


def _jacobian(pairs: Pairs, x: Pose, z: Pose) -> Array:
    """Derivative (N, 6, 12) of (position, rotation) by the unknowns, at x and z."""
    error = residuals(pairs, x, z)[1]
    turned = pairs.a.rotation
    jacobian = np.zeros((len(pairs), 6, 12))
    jacobian[:, :3, :3] = np.eye(3)
    jacobian[:, :3, 3:6] = -cross_matrix(pairs.b.position @ x.rotation.T)
    jacobian[:, :3, 6:9] = -turned
    jacobian[:, 3:, 3:6] = np.linalg.inv(left_jacobian(error))
    jacobian[:, 3:, 9:] = -np.linalg.inv(left_jacobian(-error)) @ turned  # the right Jacobian is the left one at -e
    return jacobian


def cross_matrix(vector: npt.ArrayLike) -> Array:
    """The matrix of v -> vector x v, (..., 3) -> (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def left_jacobian(vector: npt.ArrayLike) -> Array:
    """J with exp(v + dv) = exp(J dv) exp(v) to first order, (..., 3) rad -> (..., 3, 3): the closed form

    J = I + (1 - cos t) / t^2 [v] + (t - sin t) / t^3 [v]^2 for t = |v|.
    """
    v = np.asarray(vector, dtype=np.float64)
    square = np.sum(v**2, axis=-1)[..., None, None]
    t = np.sqrt(square)
    once = 0.5 * np.sinc(0.5 * t / np.pi) ** 2
    small = t < 1e-2  # there t - sin t cancels; two terms of its series are exact to rounding
    safe = np.where(small, 1.0, t)
    twice = np.where(small, (1.0 - square / 20.0) / 6.0, (safe - np.sin(safe)) / safe**3)
    matrix = cross_matrix(v)
    return np.asarray(np.eye(3) + once * matrix + twice * (matrix @ matrix))
