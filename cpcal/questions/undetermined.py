"""Which parameters the measurements of a leg leave open: the rank of its Jacobian, in floating point."""

from __future__ import annotations

import numpy as np

from cpcal.common.values import Floats
from cpcal.models import LegModel, model_jacobian
from cpcal.questions.result import Determination
from cpcal.robot import Campaign

# Of the equations' change (root mean square), when each column of the Jacobian is scaled to one: a direction of the
# parameters that changes them less is not told from an error of 0.01 mm within some 10 mm.
_SEEN = 1e-3
_SHARE = 0.1  # of a parameter in such a direction, from which it is called undetermined


def determination(campaign: Campaign, leg: int, x: Floats, model: LegModel) -> Determination:
    """At parameters x (n,) of one leg and the centres of the reading sets."""
    jacobian = model_jacobian(campaign, leg, x, model)
    scale = np.sqrt(np.mean(jacobian**2, axis=0))
    columns = jacobian / np.where(scale > 0.0, scale, 1.0) / np.sqrt(len(jacobian))
    few = len(columns) < columns.shape[1]
    _, values, right = np.linalg.svd(columns, full_matrices=few)  # of many rows the left side alone fills the memory
    seen = np.zeros(len(right), dtype=bool)
    seen[: len(values)] = values > _SEEN
    hidden = np.linalg.norm(right[~seen], axis=0)
    names = tuple(name for name, share in zip(model.parameters, hidden, strict=True) if share > _SHARE)
    return Determination(measurements=len(jacobian), of=len(right), rank=int(seen.sum()), undetermined=names)
