"""The calibration equations of some legs and their derivatives, in plain floating point, vectorised over N poses.

With v = P + R b - a (mm, base frame), leg by leg (the paper, eq. 15):

    g(x, M) = ||v|| - (L + l)        mm

A turn theta (rotation vector in the base frame, so R becomes R(theta) R) moves v by theta x R b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats, fill, frozen_array
from cpcal.robot import Campaign, quaternion_from_rotation_vector, rotation_matrix

_SHORTEST = 1e-300  # mm: the norm of a leg of length zero, where g has no derivative, instead of a division by zero


@dataclass(frozen=True, eq=False)
class LegEquations:
    """g(x) of n legs at N measurements, mm, for parameters x (n, 7) in mm: rows a_x a_y a_z b_x b_y b_z l.

    position (N, 3) mm; rotation (N, 3, 3); length (N, n) mm.
    """

    position: Floats
    rotation: Floats
    length: Floats

    @classmethod
    def of(cls, campaign: Campaign, legs: Sequence[int] | None = None) -> LegEquations:
        """Of the legs with these numbers, from 1 (left out: all), at the centres of the campaign's reading sets."""
        columns = [leg - 1 for leg in legs or range(1, campaign.legs + 1)]
        return cls(campaign.position, rotation_matrix(campaign.quaternion), campaign.length[:, columns])

    def values(self, x: Floats) -> Floats:
        """g, (N, n)."""
        return np.asarray(np.linalg.norm(self.vectors(x)[0], axis=-1) - (self.length + x[:, 6]))

    def by_parameters(self, x: Floats) -> Floats:
        """dg/dx, (N, n, 7): [-v/||v||, R' v/||v||, -1]."""
        along, _ = self._directions(x)
        turned = np.einsum("kni,kij->knj", along, self.rotation)
        return np.concatenate([-along, turned, np.full((*along.shape[:2], 1), -1.0)], axis=-1)

    def by_pose(self, x: Floats) -> Floats:
        """dg/d(P, theta), (N, n, 6): [v, R b x v] / ||v||; per mm and per rad. By the leg readings it is -1."""
        along, arm = self._directions(x)
        return np.concatenate([along, np.cross(arm, along)], axis=-1)

    def vectors(self, x: Floats) -> tuple[Floats, Floats]:
        """v and R b, each (N, n, 3)."""
        arm = np.einsum("kij,nj->kni", self.rotation, x[:, 3:6])
        return np.asarray(self.position[:, None, :] + arm - x[:, :3]), np.asarray(arm)

    def _directions(self, x: Floats) -> tuple[Floats, Floats]:
        """v / ||v|| and R b, each (N, n, 3)."""
        vector, arm = self.vectors(x)
        return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), _SHORTEST)), arm


def weighted_jacobian(equations: LegEquations, weight: Floats, x: Floats) -> Floats:
    """d(W_k g_k)/dx of all measurements, (N n, 7 n), for weights W (N, n, n): rows by measurement, then leg."""
    product = weight[..., None] * equations.by_parameters(x)[:, None, :, :]
    count, legs = equations.length.shape
    return np.asarray(product.reshape(count * legs, 7 * legs))


# ------------------------------------------------------------------------------------------------------------------
# How far the readings' noise moves the calibration equations, and the weights that undo it.
#
# First-order propagation (the paper, section 3.2; Wampler, Hollerbach and Arai 1995): with B = dg/d(P, theta) the
# equations of measurement k have the covariance
#
#     Sigma_k = B Sigma_pose B' + Sigma_length            n x n, one row a leg
#
# The pose noise of a measurement is one and the same for all its legs, so Sigma_k is full: legs are independent in
# their unknowns, not in their errors. (The paper writes `Sigma_F^-1 = dF/dM Sigma_M^-1`, whose shapes do not fit; this
# is what its words say.)

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
        fill(self, pose=frozen_array(self.pose), length=frozen_array(self.length))
        if self.correlation is not None:
            fill(self, correlation=frozen_array(self.correlation))
        pose, length, joint = self.pose, self.length, self.correlation
        if pose.ndim != 3 or pose.shape[1:] != (6, 6) or length.ndim != 2 or len(length) != len(pose):
            what, remedy = f"has the shapes {pose.shape} and {length.shape}", "give pose (N, 6, 6) and length (N, n)"
        elif not (np.isfinite(pose).all() and np.isfinite(length).all() and (length >= 0).all()):
            what, remedy = "holds a negative or non-finite number", "give finite numbers >= 0"
        elif len(bad := np.flatnonzero(~_positive(pose))):
            what = f"the pose's matrix of row {bad[0]} is not symmetric and positive semidefinite"
            remedy = "give covariances"
        elif joint is None or (
            joint.shape == (length.shape[1],) * 2 and np.allclose(np.diagonal(joint), 1.0) and _positive(joint[None])[0]
        ):
            return
        else:
            what = f"the correlation, of shape {joint.shape}, is none of {length.shape[1]} leg readings"
            remedy = "give (n, n), symmetric, positive semidefinite, 1 on the diagonal"
        raise InputError([Problem("noise", what, remedy)])

    @classmethod
    def from_sigmas(
        cls, position: npt.ArrayLike, rotation: npt.ArrayLike, length: npt.ArrayLike, *, count: int
    ) -> Noise:
        """Uncorrelated readings: standard deviations of position (mm) and rotation (rad) (3,) or (N, 3), and of
        the leg readings (mm) (n,) or (N, n), for `count` measurements."""
        rows = [np.atleast_1d(np.asarray(values, dtype=np.float64)) for values in (position, rotation, length)]
        try:
            position, rotation, length = (np.broadcast_to(row, (count, row.shape[-1])) for row in rows)
        except ValueError as error:
            raise InputError([Problem("noise", str(error), "give (3,), (3,) and (n,), or one row each")]) from None
        pose = np.concatenate([position, rotation], axis=1)
        return cls(pose[:, :, None] ** 2 * np.eye(pose.shape[1]), length)

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
        if self.correlation is None:
            return self.length[:, :, None] * np.eye(self.length.shape[1])
        return np.asarray(self.length[:, :, None] * root(self.correlation))

    def propagated(self, equations: LegEquations, x: Floats) -> Floats:
        """Sigma_k of every measurement, (N, n, n), mm^2."""
        by_pose, read = equations.by_pose(x), self.length_root
        return np.asarray(by_pose @ self.pose @ by_pose.transpose(0, 2, 1) + read @ read.transpose(0, 2, 1))


def root(covariance: Floats) -> Floats:
    """A (..., k, k) with A A' the covariance."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def _positive(matrices: Floats) -> npt.NDArray[np.bool_]:
    """Which (N,) of the matrices (N, k, k) are symmetric and positive semidefinite."""
    size = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    skew = np.abs(matrices - matrices.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    good = (skew <= _SYMMETRIC * size) & np.isfinite(size)
    least = np.linalg.eigvalsh(np.where(good[:, None, None], matrices, 0.0))[:, 0]
    return np.asarray(good & (least >= -_SYMMETRIC * size * len(matrices[0])))


def whitening(sigma: Floats) -> Floats:
    """W_k (N, n, n) with W Sigma W' = 1, from Sigma_k (N, n, n): the inverse of the Cholesky factor."""
    variance = np.diagonal(sigma, axis1=1, axis2=2)
    if not (variance > 0).all():
        row = int(np.flatnonzero(~(variance > 0).all(axis=1))[0])
        what = f"leaves an equation of row {row} without any error: its weight would be infinite"
        raise InputError([Problem("noise", what, "give every reading a standard deviation > 0")])
    deviation = np.sqrt(variance)
    try:  # of the correlations, whose entries are of order one whatever the units
        factor = np.linalg.cholesky(sigma / (deviation[:, :, None] * deviation[:, None, :]))
    except np.linalg.LinAlgError:
        what = "makes the legs' errors exactly dependent: their covariance has no inverse"
        raise InputError([Problem("noise", what, "give lengths a sigma > 0")]) from None
    return np.asarray(np.linalg.solve(factor, np.eye(sigma.shape[1]) / deviation[:, :, None]))


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
# Leg readings do not enter A.


def noise_share(
    equations: LegEquations, weight: Floats, noise: Noise, x: Floats, values: Floats, right: Floats
) -> float:
    """The ratio above for x (n, 7) and weights W (N, n, n), over the row space of A.

    values (r,) and right (r, 7 n) are singular values of A, all > 0, and its right singular vectors.
    """
    scaled = np.zeros((len(values), len(values)))
    basis, roots = right.T / values, root(noise.pose)
    for axis in range(6):
        step = roots[:, :, axis]
        change = np.zeros((weight.shape[0] * weight.shape[1], len(values)))
        for sign in (1.0, -1.0):
            turn = rotation_matrix(quaternion_from_rotation_vector(0.5 * sign * step[:, 3:]))
            position = equations.position + 0.5 * sign * step[:, :3]
            moved = LegEquations(position, turn @ equations.rotation, equations.length)
            change += sign * weighted_jacobian(moved, weight, x) @ basis
        scaled += change.T @ change
    return float(np.linalg.eigvalsh(scaled)[-1])


def chances(square: float, freedom: float, known: float) -> tuple[float, float]:
    """Of so small, and so large, a sum of squares in standard deviations known with so many degrees of freedom."""
    from scipy import special  # here: it takes a third of a second to load

    if np.isinf(known):
        return float(special.chdtr(freedom, square)), float(special.chdtrc(freedom, square))
    ratio = square / freedom
    return float(special.fdtr(freedom, known, ratio)), float(special.fdtrc(freedom, known, ratio))
