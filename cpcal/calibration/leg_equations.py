"""The calibration equations of some legs and their derivatives, in plain floating point, vectorised over N poses.

With v = P + R b - a (mm, base frame), leg by leg (the paper, eq. 2 and 15):

    "f"    f(x, M) = ||v||^2 - (L + l)^2     mm^2
    "g"    g(x, M) = ||v||   - (L + l)       mm        f = (||v|| + L + l) g: the same zeros on legs of positive length

A turn theta (rotation vector in the base frame, so R becomes R(theta) R) moves v by theta x R b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot import Campaign, rotation_matrix

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
