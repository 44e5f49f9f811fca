"""Least squares on rigid motions for `X B_i = A_i Z`, and for `X B_i = A_i X` (Z tied to X).

The residuals of a pair compare B with what A tells of it, C = X^-1 A Z, in B's reference frame,

    position   t_B - t_C          rotation   log(R_B R_C^T), a rotation vector in rad

because that is where a camera's errors have their axes (it sees depth worse than the rest). A motion is varied as
(P + p, exp(w) R) with w a rotation vector in the motion's reference frame. Lengths have the unit of the pairs. The
order of the unknowns is (p_X, w_X, p_Z, w_Z).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.calibration.pose_pairs import Pairs
from cpcal.common.arrays import Floats
from cpcal.robot import Pose, compose, inverse, quaternion_from_rotation_vector, quaternion_product, rotation_vector

_TELL_AXES = 10  # pairs from which on the axes have standard deviations of their own
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
    sigma_position: Floats
    sigma_rotation: Floats
    unit_weight: float
    covariance: Floats


def residuals(pairs: Pairs, x: Pose, z: Pose) -> tuple[Floats, Floats]:
    """Position (N, 3) and rotation (N, 3) rad of the text above."""
    told = compose(inverse(x), compose(pairs.a, z))
    return pairs.b.position - told.position, rotation_vector(compose(pairs.b, inverse(told)).quaternion)


def refined(
    pairs: Pairs,
    x: Pose,
    z: Pose,
    *,
    sigma_position: npt.ArrayLike | None = None,
    sigma_rotation: npt.ArrayLike | None = None,
    tied: bool = False,
    move: bool = True,
) -> Refined:
    """The motions with the smallest weighted sum of squares near x and z (or, without `move`, x and z themselves).

    Standard deviations, one or three each, are of the components of the residuals. None: they are estimated together
    with the motions, axis by axis where there are pairs enough to tell them apart. The covariance is that of
    linearised least squares, scaled by the residuals' own size (`unit_weight` squared, near 1 for right ones).
    """
    given = np.concatenate([_three(sigma_position), _three(sigma_rotation)])
    pooled = len(pairs) < _TELL_AXES
    rms = np.sqrt(np.mean(np.concatenate(residuals(pairs, x, z), axis=1) ** 2, axis=0))
    sigma = np.where(np.isnan(given), np.maximum(_FLOOR, np.repeat(rms.reshape(2, 3).max(axis=1), 3)), given)
    for _ in range(_ROUNDS):
        if move:
            x, z = _moved_to_minimum(pairs, x, z, sigma, tied)
        values, jacobian = _values(pairs, x, z, sigma), _columns(pairs, x, z, sigma, tied)
        cofactor: Floats = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
        used, found = sigma, np.maximum(sigma * _sizes(values, jacobian, cofactor, pooled), _FLOOR)
        sigma = np.where(np.isnan(given), found, given)
        if np.allclose(sigma, used, rtol=_SETTLED, atol=0.0):
            break
    freedom = len(values) - jacobian.shape[1]
    weight = float(np.linalg.norm(values)) / np.sqrt(freedom)
    return Refined(x, z, used[:3], used[3:], float(weight), weight**2 * cofactor)


def _three(sigma: npt.ArrayLike | None) -> Floats:
    return np.broadcast_to(np.asarray(np.nan if sigma is None else sigma, dtype=np.float64), 3)


def _sizes(values: Floats, jacobian: Floats, cofactor: Floats, pooled: bool) -> Floats:
    """Size (6,) of the weighted residuals of each component, per degree of freedom; `pooled` over three axes.

    Residuals are smaller than errors because they were minimised: element i by its leverage, its share of the fit.
    This is the restricted maximum likelihood estimate of variance components, by its fixed point.
    """
    leverage = np.einsum("ij,jk,ik->i", jacobian, cofactor, jacobian).reshape(-1, 6)
    freedom, square = np.sum(1.0 - leverage, axis=0), np.sum(values.reshape(-1, 6) ** 2, axis=0)
    if pooled:
        freedom, square = (np.repeat(sums.reshape(2, 3).sum(axis=1), 3) for sums in (freedom, square))
    return np.asarray(np.sqrt(square / np.maximum(freedom, 1e-3)), dtype=np.float64)


def _moved_to_minimum(pairs: Pairs, x: Pose, z: Pose, sigma: Floats, tied: bool) -> tuple[Pose, Pose]:
    """Levenberg-Marquardt on the vector of steps away from x and z."""
    size = 6 if tied else 12

    def at(step: Floats) -> tuple[Pose, Pose]:
        return (_moved(x, step[:6]),) * 2 if tied else (_moved(x, step[:6]), _moved(z, step[6:]))

    def slopes(step: Floats) -> Floats:
        columns = _columns(pairs, *at(step), sigma, tied)
        for k in range(3, size, 6):  # exp(w + dw) = exp(J dw) exp(w)
            columns[:, k : k + 3] = columns[:, k : k + 3] @ left_jacobian(step[k : k + 3])
        return columns

    def values(step: Floats) -> Floats:
        return _values(pairs, *at(step), sigma)

    start = np.zeros(size)
    from scipy.optimize import least_squares  # here: it takes half a second to load

    found = least_squares(values, start, jac=slopes, method="lm", xtol=_END, ftol=_END, gtol=_END, max_nfev=_STEPS)
    return at(found.x)


def _values(pairs: Pairs, x: Pose, z: Pose, sigma: Floats) -> Floats:
    """Weighted residuals (6 N,)."""
    return np.asarray((np.concatenate(residuals(pairs, x, z), axis=1) / sigma).ravel())


def _columns(pairs: Pairs, x: Pose, z: Pose, sigma: Floats, tied: bool) -> Floats:
    """Their derivative (6 N, 12), or (6 N, 6) where Z is X."""
    jacobian = _jacobian(pairs, x, z) / sigma[:, None]
    columns = jacobian[:, :, :6] + jacobian[:, :, 6:] if tied else jacobian
    return np.asarray(columns.reshape(6 * len(pairs), -1))


def _moved(pose: Pose, step: Floats) -> Pose:
    turn = quaternion_from_rotation_vector(step[3:])
    return Pose(pose.position + step[:3], quaternion_product(turn, pose.quaternion))


def _jacobian(pairs: Pairs, x: Pose, z: Pose) -> Floats:
    """Derivative (N, 6, 12) of (position, rotation) by the unknowns, at x and z."""
    error = residuals(pairs, x, z)[1]
    back, turned = x.rotation.T, x.rotation.T @ pairs.a.rotation
    target = compose(pairs.a, z).position  # in A's reference frame
    log = np.linalg.inv(left_jacobian(-error))  # of log(E exp(v)) by v: the right Jacobian is the left one at -e
    jacobian = np.zeros((len(pairs), 6, 12))
    jacobian[:, :3, :3] = back
    jacobian[:, :3, 3:6] = -back @ cross_matrix(target - x.position)
    jacobian[:, :3, 6:9] = -turned
    jacobian[:, 3:, 3:6] = log @ back
    jacobian[:, 3:, 9:] = -log @ turned
    return jacobian


def cross_matrix(vector: npt.ArrayLike) -> Floats:
    """The matrix of v -> vector x v, (..., 3) -> (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def left_jacobian(vector: npt.ArrayLike) -> Floats:
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
