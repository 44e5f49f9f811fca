"""How far the readings' noise moves the calibration equations, and the weights that undo it.

First-order propagation (the paper, section 3.2; Wampler, Hollerbach and Arai 1995): with B = dF/dM the equations of
measurement k have the covariance

    Sigma_k = B_pose Sigma_pose B_pose' + diag(B_length^2 sigma_length^2)            n x n, one row a leg

The pose noise of a measurement is one and the same for all its legs, so Sigma_k is full: legs are independent in
their unknowns, not in their errors. (The paper writes `Sigma_F^-1 = dF/dM Sigma_M^-1`, whose shapes do not fit; this
is what its words say.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from cpcal.calibration.leg_equations import LegEquations
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import frozen_array
from cpcal.robot import Campaign

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
