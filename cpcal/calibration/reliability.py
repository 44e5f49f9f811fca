"""How much of what seems to determine the parameters is the readings' noise itself.

The Jacobian A of a fit is formed with noisy readings. Where poses hardly differ in some respect, noise is what makes
them differ: A'A then has full rank by E[dA'dA] alone, estimates are drawn towards values that make the noise harmless
(errors in variables), and their standard errors know nothing of it. The largest ratio

    max over directions d of   d' E[dA'dA] d / d' A'A d

is near 0 for good data, where first-order propagation holds, and near 1 where some direction is seen by noise alone.
"""

from __future__ import annotations

import numpy as np

from cpcal.calibration.leg_equations import LegEquations, weighted_jacobian
from cpcal.calibration.weights import Noise
from cpcal.common.arrays import Floats
from cpcal.robot import quaternion_from_rotation_vector, rotation_matrix


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
