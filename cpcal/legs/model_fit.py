"""Residuals, derivatives and least-squares fit of any leg model, from its expression. They prove nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cpcal.calibration.fit import least_squares
from cpcal.calibration.leg_equations import sum_of_squares
from cpcal.common.arrays import Floats
from cpcal.legs.equation import leg_box, leg_equation, residuals
from cpcal.legs.models import PLAIN, LegModel
from cpcal.robot import Campaign
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.network.rows import Extremes, Rows

Function = Callable[[Floats], Floats]

_TOLERANCE = 1e-8  # of the fit, relative: it proves nothing


class ModelResiduals:
    """g (N,) in mm and its Jacobian (N, n) at points x (n,) of one leg, at the centres of the reading sets."""

    def __init__(self, campaign: Campaign, leg: int, model: LegModel) -> None:
        zeros = {f"{name}_radius": np.zeros_like(getattr(campaign, f"{name}_radius")) for name in _READ}
        self._campaign, self._leg = replace(campaign, uncertainty=None, **zeros), leg
        box = leg_box(np.zeros(7), 0.0, model)
        equation = leg_equation(self._campaign, leg, box, engine=get_arithmetic("float64"), model=model)
        body = equation.body if equation.scale is None else equation.body / equation.scale
        equation.network.add(body <= 0.0)
        self._rows = Rows(equation.network)

    def values(self, x: npt.ArrayLike) -> Floats:
        return self._rows.linearize(np.asarray(x, np.float64)).values

    def jacobian(self, x: npt.ArrayLike) -> Floats:
        return self._rows.linearize(np.asarray(x, np.float64)).jacobian


_READ = ("position", "rotation", "length")


def model_residuals(campaign: Campaign, leg: int, x: npt.ArrayLike, model: LegModel = PLAIN) -> Floats:
    """`g(x, M_k)` in mm (N,) at the centres of the reading sets, in plain floating point."""
    if model.name == PLAIN.name:
        return residuals(campaign, leg, x)
    return ModelResiduals(campaign, leg, model).values(x)


def fit_model(campaign: Campaign, leg: int, model: LegModel = PLAIN, known: ModelResiduals | None = None) -> Floats:
    """Parameters (n,) that minimise the sum of squares of g, the extra ones within their half-widths of 0.

    From the fit of the plain model, with which it begins. `known`: the residuals, where they are there already.
    """
    start = np.append(least_squares(campaign, leg), np.zeros(len(model.extra)))
    free = np.append(np.ones(7, dtype=bool), model.half_widths > 0.0)
    if free.sum() == 7:
        return start
    of = ModelResiduals(campaign, leg, model) if known is None else known
    reach = np.append(np.full(7, np.inf), model.half_widths)[free]

    def full(x: Floats) -> Floats:
        out = start.copy()
        out[free] = x
        return out

    def values(x: Floats) -> Floats:
        return of.values(full(x))

    def jacobian(x: Floats) -> Floats:
        return of.jacobian(full(x))[:, free]

    inside, reached = sum_of_squares(values, jacobian, start[free], _TOLERANCE)
    if reached and bool(np.all(np.abs(inside) <= reach)):
        return full(inside)
    return full(_bounded(values, jacobian, start[free], reach))


def _bounded(values: Function, jacobian: Function, start: Floats, reach: Floats) -> Floats:
    from scipy import optimize  # here: it takes half a second to load

    scale = np.where(np.isfinite(reach), reach, 1.0)
    found = optimize.least_squares(values, start, jac=jacobian, bounds=(-reach, reach), x_scale=scale, method="trf")
    return np.asarray(found.x)


def reading_sensitivities(campaign: Campaign, leg: int, x: npt.ArrayLike, model: LegModel) -> Floats:
    """Half the range (N,) of g in mm over the reading sets at x, between the ends that a first-order look chooses."""
    point = np.asarray(x, np.float64)
    box = leg_box(np.zeros(7), 0.0, model)
    equation = leg_equation(campaign, leg, box, engine=get_arithmetic("float64"), model=model)
    ends = Extremes(equation.network, equation.body)
    if not ends.tape.readings:
        return np.zeros(len(campaign))
    low, high = (ends.values(point, readings) for readings in ends.at(point))
    return np.asarray(0.5 * np.abs(high - low))
