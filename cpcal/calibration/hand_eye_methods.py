"""Closed forms for `A X = X B` (hand-eye) and `A_i Z = X B_i` (robot-world and hand-eye at once).

Poses are those of pose_pairs.py, lengths without unit. vec(M) stacks the rows of M, so that
vec(A X B) = (A kron B^T) vec(X).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cpcal.calibration.pose_pairs import Pairs
from cpcal.common.arrays import Floats
from cpcal.robot import Pose, compose, inverse, quaternion_from_matrix

_MOTIONS_MAX = 5_000  # pairs of poses that Andreff's method uses


def shah(pairs: Pairs) -> tuple[Pose, Pose]:
    """X and Z of `X B_i = A_i Z` by Shah's closed form (J. Mechanisms and Robotics 5(3), 2013).

    R_X = R_A R_Z R_B^T, so with K = sum_i R_A kron R_B the vectors vec(R_X) and vec(R_Z) are its left and right
    singular vectors of the largest singular value (N, without noise), up to factors that make them rotations.
    """
    a, b = pairs.a.rotation, pairs.b.rotation
    kron = np.einsum("kij,kpq->ipjq", a, b).reshape(9, 9)
    left, _, right = np.linalg.svd(kron)
    x, z = left[:, 0].reshape(3, 3), right[0].reshape(3, 3)
    sign = np.sign(np.linalg.det(x))  # that of z is the same: K maps rotations to near-multiples of rotations
    return _translations(pairs, nearest_rotation(sign * x), nearest_rotation(sign * z))


def andreff(pairs: Pairs) -> tuple[Pose, Pose]:
    """X and Z of `X B_i = A_i Z` by the linear method for hand-eye (Andreff, Horaud and Espiau 1999).

    Z from the relative motions, (A_i^-1 A_j) Z = Z (B_i^-1 B_j); then R_X, the mean of R_A R_Z R_B^T, and both
    translations by least squares.
    """
    first, second = relative_pairs(len(pairs))
    z = andreff_hand_eye(_relative(pairs.a, first, second), _relative(pairs.b, first, second)).rotation
    x = nearest_rotation(np.einsum("kij,jl,kml->im", pairs.a.rotation, z, pairs.b.rotation))
    return _translations(pairs, x, z)


def andreff_hand_eye(a: Pose, b: Pose) -> Pose:
    """X of `A_i X = X B_i` for motions (N, 3), (N, 4): the linear system of Andreff, Horaud and Espiau 1999,

        [ I - R_A kron R_B      0     ] [ vec R_X ]   [  0  ]
        [   I kron t_B^T     I - R_A  ] [   t_X   ] = [ t_A ]

    by least squares; R_X is then replaced by the nearest rotation, and t_X solved for again.
    """
    count, turn, eye = len(a.position), a.rotation, np.eye(3)
    top = np.eye(9) - np.einsum("kij,kpq->kipjq", turn, b.rotation).reshape(count, 9, 9)
    arm = np.einsum("ij,kq->kijq", eye, b.position).reshape(count, 3, 9)
    rows = np.concatenate([top.reshape(-1, 9), arm.reshape(-1, 9)])
    still = eye - turn
    matrix = np.concatenate([rows, np.concatenate([np.zeros((9 * count, 3)), still.reshape(-1, 3)])], axis=1)
    right = np.concatenate([np.zeros(9 * count), a.position.ravel()])
    rotation = nearest_rotation(_solved(matrix, right)[:9].reshape(3, 3))
    # the rows of translations again, with that rotation: (I - R_A) t_X = t_A - R_X t_B
    rest = (a.position - b.position @ rotation.T).ravel()
    return Pose(_solved(still.reshape(-1, 3), rest), quaternion_from_matrix(rotation))


def _solved(matrix: Floats, right: Floats) -> Floats:
    """The least-squares solution."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)


def relative_pairs(count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices i < j of all pairs of `count` poses, evenly thinned out where there are very many."""
    first, second = np.triu_indices(count, 1)
    if len(first) > _MOTIONS_MAX:
        kept = np.linspace(0, len(first) - 1, _MOTIONS_MAX).astype(np.intp)
        first, second = first[kept], second[kept]
    return first, second


def nearest_rotation(matrix: Floats) -> Floats:
    """The rotation (3, 3) nearest to a matrix in the Frobenius norm."""
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def _relative(pose: Pose, first: npt.NDArray[np.intp], second: npt.NDArray[np.intp]) -> Pose:
    """The motions T_i^-1 T_j."""
    back = inverse(Pose(pose.position[first], pose.quaternion[first]))
    return compose(back, Pose(pose.position[second], pose.quaternion[second]))


def _translations(pairs: Pairs, x: Floats, z: Floats) -> tuple[Pose, Pose]:
    """Both motions, given their rotations: t_X - R_A t_Z = t_A - R_X t_B by least squares."""
    count = len(pairs)
    matrix = np.concatenate([np.tile(np.eye(3), (count, 1)), -pairs.a.rotation.reshape(-1, 3)], axis=1)
    right = pairs.a.position - pairs.b.position @ x.T
    found = _solved(matrix, right.ravel())
    return Pose(found[:3], quaternion_from_matrix(x)), Pose(found[3:], quaternion_from_matrix(z))
