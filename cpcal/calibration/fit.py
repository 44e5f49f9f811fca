"""Least-squares fits x_c and x_c_sigma of a campaign's parameters (the paper, section 3.2). They prove nothing.

    x_c        minimises  sum_k ||F_k(x)||^2                             weights="none"
    x_c_sigma  minimises  sum_k F_k(x)' Sigma_k^-1 F_k(x)                weights="legs" (diagonal of Sigma_k) or "joint"

over legs' equations F of form "g" (mm, eq. 15) or "f" (mm^2, eq. 2). Sigma_k is that of weights.py, taken at the
latest estimate and updated until the estimate rests: minimising over Sigma(x) too would favour a large Sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from cpcal.calibration.estimate import Estimate, Fit
from cpcal.calibration.leg_equations import Form, LegEquations, weighted_jacobian
from cpcal.calibration.losses import LOSSES, Loss, robust_scale
from cpcal.calibration.sum_of_squares import sum_of_squares
from cpcal.calibration.weights import Noise, Weights, whitening
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.robot import Campaign

__all__ = ["Fit", "fit"]

_PASSES = 20  # of the weights' update, at most
_AT_REST = 1e-6  # mm: the largest change of a parameter by the last update


@dataclass(frozen=True)
class _Options:
    form: Form
    weights: Weights
    loss: Loss
    loss_scale: float | None
    tolerance: float


def fit(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    form: Form = "g",
    weights: Weights = "none",
    noise: Noise | None = None,
    loss: Loss = "linear",
    loss_scale: float | None = None,
    covariance: Literal["noise", "residuals"] | None = None,
    start: npt.ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> Fit:
    """The parameters (n, 7) in mm that fit the equations of the `legs` (numbers from 1; all) best.

    form        "g" in mm, or "f" in mm^2; weighted, both give the same up to second order in the noise
    weights     "none": x_c. "legs": x_c_sigma leg by leg. "joint": x_c_sigma of all legs together, with the errors that
                legs share because they share a pose
    noise       of the readings, for all legs of the campaign; weights need it. See `Noise.of`
    loss        scipy's; "huber", "soft_l1", ... bound what a gross error does. With weights="joint" one in one leg
                spreads over its pose's decorrelated equations; "legs" keeps it where it is
    loss_scale  residuals beyond it count as large: mm (g), mm^2 (f), or standard deviations when weighted. Left out:
                1.4826 median |residual| of the plain fit, for each leg (joint: for all together)
    covariance  "noise": propagated from `noise`, what repeating the measurements would show if the model holds.
                "residuals": from their scatter, correlations between legs included; takes model error for noise.
                Left out: "noise" if given and the loss is linear, unless it does not explain the residuals
    start       (n, 7) mm; left out: the campaign's nominal parameters
    tolerance   ends where a step changes sum of squares and parameters by less than this share (scipy's ftol, xtol)

    Data that do not determine all parameters give one of the many minima, near the start, and the fit says so. Raises
    InputError for options without a meaning.
    """
    chosen = tuple(range(1, campaign.legs + 1)) if legs is None else tuple(legs)
    options = _Options(form, weights, loss, loss_scale, tolerance)
    _check(campaign, chosen, options, noise, covariance)
    columns = [leg - 1 for leg in chosen]
    first = _start(campaign.robot.parameters[columns] if start is None else start, len(chosen))
    known = None if noise is None else noise.of_legs(columns)
    equations = LegEquations.of(campaign, chosen, form)
    source = covariance or ("noise" if known is not None and loss == "linear" else "residuals")
    found = Fit(
        legs=chosen,
        form=form,
        weights=weights,
        loss=loss,
        source=source,
        estimate=_estimate(equations, known, first, options),
        noise=known,
        chosen=covariance is None,
    )
    return found if covariance is not None or found.explained else replace(found, source="residuals")


def _estimate(equations: LegEquations, noise: Noise | None, start: Floats, options: _Options) -> Estimate:
    """Fits with weights, and weights at the fit, in turns until they agree."""
    found = _weighted(equations, noise, start, options)
    if options.weights == "none":
        return found
    for number in range(2, _PASSES + 1):
        before = found.parameters
        found = replace(_weighted(equations, noise, before, options), passes=number)
        if np.max(np.abs(found.parameters - before), initial=0.0) <= _AT_REST:
            return found
    return replace(found, converged=False)


def _weighted(equations: LegEquations, noise: Noise | None, start: Floats, options: _Options) -> Estimate:
    """The fit with the weights of `start`: legs one by one, or together when they are weighted jointly."""
    count, legs = equations.length.shape
    sigma = np.zeros((count, legs, legs)) if noise is None else noise.propagated(equations, start)
    weight = whitening(sigma, options.weights)
    together = options.weights == "joint"
    groups = [list(range(legs))] if together else [[leg] for leg in range(legs)]
    x, scale = start.copy(), np.ones(legs)
    converged = True
    for group in groups:
        part = weight[:, group][:, :, group]
        x[group], scale[group], reached = _solved(equations.only(group), part, start[group], options)
        converged = converged and reached
    return Estimate(equations, x, weight, scale, converged, 1)


def _solved(equations: LegEquations, weight: Floats, start: Floats, options: _Options) -> tuple[Floats, float, bool]:
    """Parameters (m, 7), the loss's scale, and whether a criterion was met, for legs that are fitted together."""

    def values(x: Floats) -> Floats:
        return np.asarray(np.einsum("kij,kj->ki", weight, equations.values(x.reshape(-1, 7))).ravel())

    def jacobian(x: Floats) -> Floats:
        return weighted_jacobian(equations, weight, x.reshape(-1, 7))

    def minimum(x: Floats, loss: Loss, scale: float) -> tuple[Floats, bool]:
        from scipy import optimize  # here: it takes half a second to load, for robust losses alone

        t = options.tolerance
        found = optimize.least_squares(values, x, jac=jacobian, loss=loss, f_scale=scale, ftol=t, xtol=t, gtol=t)
        return np.asarray(found.x, dtype=np.float64), bool(found.success)

    x, reached = sum_of_squares(values, jacobian, start.ravel(), options.tolerance)
    if options.loss == "linear":
        return x.reshape(-1, 7), 1.0, reached
    scale = options.loss_scale or robust_scale(values(x)) or 1.0  # residuals that are all zero need no scale
    x, reached = minimum(x, options.loss, scale)
    return x.reshape(-1, 7), scale, reached


def _start(values: npt.ArrayLike, legs: int) -> Floats:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError([Problem("option start", str(error), f"give numbers, ({legs}, 7)")]) from None
    if array.shape != (legs, 7) or not np.isfinite(array).all():
        what = f"has the shape {array.shape}, or a number that is not finite"
        raise InputError([Problem("option start", what, f"give ({legs}, 7) finite numbers, mm")])
    return array


def _check(
    campaign: Campaign, legs: tuple[int, ...], options: _Options, noise: Noise | None, covariance: str | None
) -> None:
    """InputError that names every option without a meaning."""
    problems: list[Problem] = []

    def demand(good: bool, name: str, what: str, remedy: str) -> None:
        if not good:
            problems.append(Problem(f"option {name}", what, remedy))

    known = set(range(1, campaign.legs + 1))
    good = len(legs) > 0 and len(set(legs)) == len(legs) and set(legs) <= known
    demand(good, "legs", f"has no meaning: {legs}", f"give different numbers from 1 to {campaign.legs}")
    for name, value, allowed in (
        ("form", options.form, get_args(Form)),
        ("weights", options.weights, get_args(Weights)),
        ("loss", options.loss, LOSSES),
        ("covariance", covariance, (None, "noise", "residuals")),
    ):
        demand(value in allowed, name, f"has no meaning: {value!r}", f"give one of {', '.join(map(repr, allowed))}")
    scale = options.loss_scale
    demand(scale is None or 0 < scale < np.inf, "loss_scale", f"has no meaning: {scale!r}", "give a number > 0")
    demand(0 < options.tolerance < 1, "tolerance", f"has no meaning: {options.tolerance!r}", "give a number like 1e-10")
    if noise is None:
        lacking = "needs the noise of the readings"
        demand(options.weights == "none", "weights", lacking, "give noise=Noise.of(campaign)")
        demand(covariance != "noise", "covariance", lacking, "give noise=Noise.of(campaign)")
    else:
        shape = (len(campaign), campaign.legs)
        demand(noise.length.shape == shape, "noise", f"is for {noise.length.shape} leg readings", f"give {shape}")
    if covariance == "noise":
        demand(options.loss == "linear", "covariance", "cannot be propagated through a robust loss", 'use "residuals"')
    if problems:
        raise InputError(problems)
