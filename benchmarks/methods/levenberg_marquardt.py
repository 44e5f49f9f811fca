"""Least squares by Levenberg and Marquardt: the classical calibration. A point, and no bound from below."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from benchmarks.methods.method import TaskQuestion, Work
from benchmarks.records import MethodAnswer
from benchmarks.tasks import Unsupported
from cpcal.common.values import Floats
from cpcal.robot import rotation_matrix


class LeastSquares:
    """From the nominal parameters, with analytic derivatives."""

    guarantee = "a point only"

    def missing(self) -> str | None:
        return None

    def prepare(self, question: TaskQuestion) -> Work:
        if question.task.kind != "minimise":
            raise Unsupported("bounds nothing")
        campaign, k = question.leg.campaign, question.leg.leg - 1
        rotations, length = rotation_matrix(campaign.quaternion), campaign.length[:, k]
        robot = campaign.robot
        nominal = np.concatenate([robot.base[k], robot.mobile[k], [robot.offset[k]]])

        def vectors(x: Floats) -> Floats:
            return np.asarray(campaign.position + rotations @ x[3:6] - x[:3])

        def values(x: Floats) -> Floats:
            return np.asarray(np.linalg.norm(vectors(x), axis=1) - length - x[6])

        def jacobian(x: Floats) -> Floats:
            v = vectors(x)
            unit = v / np.linalg.norm(v, axis=1)[:, None]
            return np.concatenate([-unit, np.einsum("ki,kij->kj", unit, rotations), -np.ones((len(unit), 1))], axis=1)

        def work() -> MethodAnswer:
            found = optimize.least_squares(values, nominal, jac=jacobian, method="lm")
            return MethodAnswer(False, {"hi": float(np.abs(found.fun).max())}, "no lower bound")

        return work
