"""The identification Jacobian: how the calibration equations of a leg depend on its seven parameters.

For x = (a, b, l), v = P + R b - a and u = v / ||v||,

    f(x, M) = ||v||^2 - (L + l)^2        df/dx = (-2 v,  2 R^T v,  -2 (L + l))       (the paper, eq. 2)
    g(x, M) = ||v|| - (L + l)            dg/dx = (-u,    R^T u,    -1)               (the paper, eq. 15)

dg/dx has no unit (mm per mm), its columns are of like size, and its rows weigh errors in mm alike. Where the
equations hold df/dx = 2 ||v|| dg/dx, which weighs long legs more.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
import numpy.typing as npt

from cpcal.calibration.leg_equations import Form, LegEquations
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
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
