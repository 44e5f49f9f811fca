"""What can be expected of a leg before it is certified: rank, observability, ranges. Floating point, no proofs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration import LegEquations, Observability, column_scale, observability
from cpcal.certify.undetermined import determination
from cpcal.common.arrays import Floats
from cpcal.legs import PLAIN
from cpcal.results.determination import Determination
from cpcal.robot import Campaign

_ROWS = 1_000  # in a linear program: fewer of them leave a range wider, never narrower


@dataclass(frozen=True, eq=False)
class LegOutlook:
    """Of one leg, counted from 1, at parameters x (7,) mm.

    determination  which parameters the poses leave open
    observability  indices of the Jacobian dg/dx with columns of equal size; see `cpcal.calibration.identification`
    ranges         (7,) mm, half-widths of all parameters that explain readings of a robot that is as the model says:
                   |J dx| <= what the reading sets allow, to first order. Infinite where a parameter is open, zero for
                   exact readings. Noise and model error shift readings, so the certified ranges are narrower
    """

    leg: int
    determination: Determination
    observability: Observability
    ranges: Floats


def outlook(campaign: Campaign, leg: int, x: Floats) -> LegOutlook:
    """The outlook of one leg at parameters x (7,) mm."""
    equations = LegEquations.of(campaign, [leg])
    jacobian = equations.by_parameters(x[None])[:, 0]
    return LegOutlook(
        leg,
        determination(campaign, leg, x, PLAIN),
        observability(jacobian, column_scale(jacobian)),
        _ranges(jacobian, slack(campaign, leg, x)),
    )


def slack(campaign: Campaign, leg: int, x: Floats) -> Floats:
    """(N,) mm: by how much the reading sets let each equation g vary, to first order."""
    by_pose = np.abs(LegEquations.of(campaign, [leg]).by_pose(x[None])[:, 0])
    pose = np.concatenate([campaign.position_radius, campaign.rotation_radius], axis=1)
    return np.asarray(np.sum(by_pose * pose, axis=1) + campaign.length_radius[:, leg - 1])


def _ranges(jacobian: Floats, allowed: Floats) -> Floats:
    """(7,): the largest |dx_i| with |J dx| <= allowed, by linear programming, columns scaled."""
    from scipy.optimize import linprog

    if not allowed.any():
        return np.zeros(jacobian.shape[1])
    rows = np.linspace(0, len(jacobian) - 1, min(_ROWS, len(jacobian))).astype(np.intp)
    scale, size = column_scale(jacobian), float(allowed.max())
    matrix, bound = jacobian[rows] * scale, allowed[rows] / size
    found = np.full(jacobian.shape[1], np.inf)
    for i in range(len(found)):
        cost = np.zeros(len(found))
        cost[i] = -1.0
        limits = np.concatenate([bound, bound])
        program = linprog(cost, np.concatenate([matrix, -matrix]), limits, bounds=(-1e7, 1e7), method="highs")
        if program.status == 0 and (reach := -float(program.fun or 0.0)) < 1e6:
            found[i] = reach * size * scale[i]
    return found
