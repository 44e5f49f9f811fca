"""The identification Jacobian: how the calibration equations of a leg depend on its seven parameters.

For x = (a, b, l), v = P + R b - a and u = v / ||v||,

    f(x, M) = ||v||^2 - (L + l)^2        df/dx = (-2 v,  2 R^T v,  -2 (L + l))       (the paper, eq. 2)
    g(x, M) = ||v|| - (L + l)            dg/dx = (-u,    R^T u,    -1)               (the paper, eq. 15)

dg/dx has no unit (mm per mm), its columns are of like size, and its rows weigh errors in mm alike. Where the
equations hold df/dx = 2 ||v|| dg/dx, which weighs long legs more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
import numpy.typing as npt

from cpcal.calibration.leg_equations import Form, LegEquations
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.robot import Pose, Robot


def leg_jacobian(
    parameters: npt.ArrayLike, pose: Pose, length: npt.ArrayLike | None = None, *, form: Form = "g"
) -> Floats:
    """dg/dx (form "g") or df/dx ("f") of one leg, (N, 7), columns a_x a_y a_z b_x b_y b_z l.

    parameters  (7,) mm; pose N poses; length (N,) mm, the readings, which only df/dl depends on (None: those with
                which the equations hold, L + l = ||v||)

    InputError for other shapes, and for a pose that brings the two joints together, where g has no derivative.
    """
    x = np.asarray(parameters, dtype=np.float64)
    if x.shape != (7,) or pose.position.ndim != 2:
        what = f"have the shape {x.shape}, for positions of shape {pose.position.shape}"
        raise InputError([Problem("parameters", what, "give 7 parameters in mm and N poses, (N, 3) and (N, 4)")])
    if form not in get_args(Form):
        raise InputError([Problem("form", f"is {form!r}", 'choose "f" (eq. 2) or "g" (eq. 15)')])
    distance = np.linalg.norm(pose.position + pose.rotation @ x[3:6] - x[:3], axis=1)
    if form == "g" and not (distance > 0.0).all():
        where = f"pose {int(np.argmin(distance > 0.0))} (from 0)"
        raise InputError([Problem(where, "gives the leg the length 0", "correct the pose or the parameters")])
    readings = distance - x[6] if length is None else np.broadcast_to(np.asarray(length, np.float64), distance.shape)
    equations = LegEquations(pose.position, pose.rotation, readings[:, None], form)
    return equations.by_parameters(x[None])[:, 0]


def robot_jacobian(robot: Robot, pose: Pose, *, form: Form = "g") -> Floats:
    """The Jacobians of all n legs, (n, N, 7), for readings with which the equations hold.

    The legs share no parameter: the Jacobian of the whole robot is block diagonal, with these blocks.
    """
    return np.stack([leg_jacobian(row, pose, form=form) for row in robot.parameters])


# ------------------------------------------------------------------------------------------------------------------
# How well a set of poses determines the parameters: observability indices of the identification Jacobian.
#
# With sigma_1 >= ... >= sigma_p the singular values of the Jacobian of m rows, columns scaled (see `Observability`):
#
#     product               (sigma_1 ... sigma_p)^(1/p) / sqrt(m)      Borm and Menq 1991
#     condition             sigma_1 / sigma_p                          Driels and Pathre 1990
#     smallest              sigma_p                                    Nahvi, Hollerbach and Hayward 1994
#     noise_amplification   sigma_p^2 / sigma_1                        Nahvi and Hollerbach 1996
#
# Larger is better, but for the condition. They are computed in floating point: a help to choose by, not a proof.


@dataclass(frozen=True, eq=False)
class Observability:
    """Singular values of a scaled Jacobian, and the indices made of them.

    singular_values  (p,), descending; for several legs, (n p,), those of the block diagonal Jacobian
    rows             m, the number of its rows; for several legs, of each block
    weakest          (n, p): the change of the parameters, of norm 1 in scaled units, that the equations notice least
    """

    singular_values: Floats
    rows: int
    weakest: Floats

    @property
    def product(self) -> float:
        """Geometric mean of the singular values over sqrt(rows); 0 where the parameters are not determined."""
        return float(_product(self.singular_values)) / float(np.sqrt(self.rows))

    @property
    def condition(self) -> float:
        """sigma_1 / sigma_p; infinite where the parameters are not determined."""
        return float(np.inf) if self.smallest == 0.0 else float(self.singular_values[0]) / self.smallest

    @property
    def smallest(self) -> float:
        return float(self.singular_values[-1])

    @property
    def noise_amplification(self) -> float:
        return float(_noise_amplification(self.singular_values))


def observability(jacobian: Floats, scale: npt.ArrayLike | None = None) -> Observability:
    """The indices of a Jacobian (m, p), or of the block diagonal one of n legs (n, m, p).

    scale  (p,) or (n, p): the step of each parameter that counts as 1, e.g. its expected error, or `column_scale`.
           None: 1 mm for all, which suits dg/dx of `leg_jacobian`. Indices compare only under the same scale.

    A singular value that rounding alone could make is 0. InputError for arrays that are no Jacobian.
    """
    blocks = scaled_blocks(jacobian, scale)
    legs, rows, size = blocks.shape
    if rows < size:
        blocks = np.concatenate([blocks, np.zeros((legs, size - rows, size))], axis=1)
    _, values, right = np.linalg.svd(blocks, full_matrices=False)
    noise = values[:, :1] * max(rows, size) * np.finfo(np.float64).eps
    values = np.where(values > noise, values, 0.0)
    worst = int(np.argmin(values[:, -1]))
    weakest = np.zeros((legs, size))
    weakest[worst] = right[worst, -1]
    return Observability(np.sort(values.ravel())[::-1], rows, weakest)


def column_scale(jacobian: Floats) -> Floats:
    """1 / rms of every column, (p,) or (n, p): scaled by it all columns have the same size. 1 for zero columns.

    Equal columns are within sqrt(p) of the scale with the smallest condition number (van der Sluis 1969).
    """
    rms = np.sqrt(np.mean(np.asarray(jacobian, dtype=np.float64) ** 2, axis=-2))
    return np.asarray(1.0 / np.where(rms > 0.0, rms, 1.0))


def scaled_blocks(jacobian: Floats, scale: npt.ArrayLike | None) -> Floats:
    """(n, m, p), columns times their scale."""
    array = np.asarray(jacobian, dtype=np.float64)
    remedy = "give a finite array of shape (poses, parameters) or (legs, poses, parameters), see robot_jacobian"
    if array.ndim not in (2, 3) or 0 in array.shape or not np.isfinite(array).all():
        raise InputError([Problem("jacobian", f"of shape {array.shape} is empty or not finite", remedy)])
    blocks = array.reshape(-1, *array.shape[-2:])
    factor = np.ones(blocks.shape[2]) if scale is None else np.asarray(scale, dtype=np.float64)
    good = factor.shape in (blocks.shape[2:], (blocks.shape[0], blocks.shape[2]))
    if not (good and np.isfinite(factor).all() and (factor > 0.0).all()):
        raise InputError([Problem("scale", "does not fit the jacobian", "give a positive number for each column")])
    return np.asarray(blocks * (factor if factor.ndim == 1 else factor[:, None, :]))


def _product(values: Floats) -> Floats:
    """Geometric mean over the last axis."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.exp(np.mean(np.log(values), axis=-1)))


def _noise_amplification(values: Floats) -> Floats:
    """sigma_p^2 / sigma_1 of descending values along the last axis."""
    return np.asarray(values[..., -1] ** 2 / np.maximum(values[..., 0], np.finfo(np.float64).tiny))


def _inverse_condition(values: Floats) -> Floats:
    return np.asarray(values[..., -1] / np.maximum(values[..., 0], np.finfo(np.float64).tiny))


def _smallest(values: Floats) -> Floats:
    return np.asarray(values[..., -1])


# What a selection makes large, of descending singular values along the last axis.
INDICES = {
    "product": _product,
    "condition": _inverse_condition,
    "smallest": _smallest,
    "noise_amplification": _noise_amplification,
}
