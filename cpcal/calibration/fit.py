"""Least-squares fits x_c and x_c_sigma of a campaign's parameters (the paper, section 3.2). They prove nothing.

    x_c        minimises  sum_k ||F_k(x)||^2                             weights="none"
    x_c_sigma  minimises  sum_k F_k(x)' Sigma_k^-1 F_k(x)                weights="legs" (diagonal of Sigma_k) or "joint"

over legs' equations F of form "g" (mm, eq. 15) or "f" (mm^2, eq. 2). Sigma_k is that of leg_equations.py, taken at the
latest estimate and updated until the estimate rests: minimising over Sigma(x) too would favour a large Sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from cpcal.calibration.leg_equations import (
    LOSSES,
    Form,
    LegEquations,
    Loss,
    Noise,
    Weights,
    chances,
    noise_share,
    pseudo_residuals,
    robust_scale,
    sum_of_squares,
    weighted_jacobian,
    whitening,
)
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import listed
from cpcal.common.values import Floats
from cpcal.robot import Campaign

__all__ = ["Fit", "fit"]

# ------------------------------------------------------------------------------------------------------------------
# What a least-squares fit found, and how well the data determine it: covariance, intervals, rank, condition.
#
# With the weighted equations W_k F_k, their Jacobian A (N n, 7 n) and G = A^+ (its pseudo-inverse), the estimate errs
# to
# first order by -sum_k G_k W_k dF_k, so that its covariance is
#
#     sum_k G_k C_k G_k'        with C_k = W_k Sigma_k W_k' from the noise, or from the residuals' own scatter,
#
# for any weights, right or wrong; for weights="joint" and C_k = 1 it is (A'A)^-1. Errors of the readings within A
# itself
# are of second order and left out.

SYMBOLS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")

_IN_NULL_SPACE = 1e-6  # share of a parameter's direction that must be undetermined for it to be called so
_BIASED = 0.1  # share of the noise from which the sentence speaks of it
_SUSPICIOUS = 1e-3  # probability of residuals so large, or so small, by noise alone from which the sentence says so
_DOUBTFUL = 0.01  # probability of residuals so large by noise alone from which the covariance is taken from them


@dataclass(frozen=True, eq=False)
class Estimate:
    """A minimum as the solver left it: parameters (n, 7), weights W (N, n, n), the loss's scale (n,)."""

    equations: LegEquations
    parameters: Floats
    weight: Floats
    scale: Floats
    converged: bool
    passes: int

    @cached_property
    def svd(self) -> tuple[Floats, Floats, Floats]:
        """Of A, the Jacobian (N n, 7 n) of the weighted equations."""
        jacobian = weighted_jacobian(self.equations, self.weight, self.parameters)
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        return left, values, right


@dataclass(frozen=True, eq=False)
class Fit:
    """A least-squares fit of n legs; see `cpcal.calibration.fit`.

    legs      numbers from 1; rows of everything below
    form      of the equations: "g" in mm, "f" in mm^2
    source    what the covariance comes from: "noise" or "residuals"
    chosen    whether the residuals decided that, as they do where `fit` is not told
    """

    legs: tuple[int, ...]
    form: Form
    weights: Weights
    loss: Loss
    source: Literal["noise", "residuals"]
    estimate: Estimate
    noise: Noise | None
    chosen: bool = False

    @property
    def parameters(self) -> Floats:
        """(n, 7) mm, rows a_x a_y a_z b_x b_y b_z l."""
        return self.estimate.parameters

    @property
    def converged(self) -> bool:
        """Whether the fit of every leg converged, and the weights came to rest."""
        return self.estimate.converged

    @cached_property
    def residuals(self) -> Floats:
        """F(x), (N, n): mm (form g) or mm^2 (form f), not weighted."""
        return self.estimate.equations.values(self.parameters)

    @property
    def rank(self) -> int:
        """Of the weighted Jacobian: 7 n when the data determine all parameters to first order."""
        return int(np.sum(self._determined))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value of the weighted Jacobian; infinite when rank < 7 n."""
        values = self.estimate.svd[1]
        return float(values[0] / values[-1]) if self.rank == self.parameters.size else np.inf

    @property
    def freedom(self) -> float:
        """Residual degrees of freedom of each leg's scatter; with weights="joint" of all legs' together."""
        surplus = self.residuals.size - self.rank
        return float(surplus) if self.weights == "joint" else surplus / len(self.legs)

    @cached_property
    def covariance(self) -> Floats:
        """(7 n, 7 n) mm^2, parameters leg by leg; infinite variances (nan beside) where the data tell nothing."""
        if self.source == "residuals" and self.freedom <= 0:  # a fit through all points leaves no scatter to judge by
            size = self.parameters.size
            return np.where(np.eye(size) == 1.0, np.inf, np.nan)
        left, values, right = self.estimate.svd
        seen = self._determined
        count, legs = self.residuals.shape
        inverse = (right[seen].T / values[seen]) @ left[:, seen].T
        blocks = inverse.reshape(-1, count, legs)
        spread = np.einsum("pki,kij->pkj", blocks, self._scatter())
        result = spread.reshape(len(inverse), -1) @ inverse.T
        result = 0.5 * (result + result.T)
        lost = self.undetermined.ravel()
        result[lost, :] = result[:, lost] = np.nan
        result[lost, lost] = np.inf
        return np.asarray(result)

    @property
    def standard_errors(self) -> Floats:
        """(n, 7) mm: square roots of the covariance's diagonal."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)).reshape(-1, 7))

    @cached_property
    def undetermined(self) -> npt.NDArray[np.bool_]:
        """(n, 7): which parameters can change without changing any equation, to first order."""
        _, _, right = self.estimate.svd
        known = np.sum(right[self._determined] ** 2, axis=0)
        return np.asarray(1.0 - known > _IN_NULL_SPACE**2).reshape(-1, 7)

    def interval(self, level: float = 0.95) -> tuple[Floats, Floats]:
        """Lower and upper ends (n, 7), mm, of each parameter's confidence interval at that level, one at a time.

        Normal quantiles when the covariance comes from the noise, Student's with `freedom` when from the residuals.
        """
        from scipy import special  # here: it takes a third of a second to load

        if not 0 < level < 1:
            raise InputError([Problem("option level", f"has no meaning: {level!r}", "give a number between 0 and 1")])
        upper = 0.5 + 0.5 * level
        if self.source == "noise":
            quantile = float(special.ndtri(upper))
        else:
            quantile = float(special.stdtrit(self.freedom, upper)) if self.freedom > 0 else np.inf
        half = quantile * self.standard_errors
        return self.parameters - half, self.parameters + half

    @cached_property
    def noise_ratio(self) -> Floats | None:
        """(n,) root mean square (divisor N - 7) of residual / its standard deviation by the noise: 1 is expected.

        None when the noise is not known, or zero, or with N <= 7.
        """
        if self.noise is None or len(self.residuals) <= 7:
            return None
        sigma = self.noise.propagated(self.estimate.equations, self.parameters)
        variance = np.diagonal(sigma, axis1=1, axis2=2)
        if not (variance > 0).all():
            return None
        return np.asarray(np.sqrt(np.sum(self.residuals**2 / variance, axis=0) / (len(self.residuals) - 7)))

    @cached_property
    def noise_chances(self) -> tuple[float, float] | None:
        """Probabilities of residuals so small, and so large, by the noise alone, all legs together.

        Of the sum over poses of F_k' Sigma_k^-1 F_k. None when the noise is not known, or singular, or no residuals are
        left.
        """
        freedom = self.residuals.size - self.rank
        if self.noise is None or freedom <= 0:
            return None
        sigma = self.noise.propagated(self.estimate.equations, self.parameters)
        try:
            white = np.linalg.solve(np.linalg.cholesky(sigma), self.residuals[..., None])
        except np.linalg.LinAlgError:
            return None
        return chances(float(np.sum(white**2)), freedom, self.noise.freedom)

    @property
    def explained(self) -> bool:
        """Whether the residuals are no larger than the noise has them; true where that cannot be said."""
        found = self.noise_chances
        return found is None or found[1] >= _DOUBTFUL

    @cached_property
    def noise_share(self) -> float | None:
        """How much of the least determined direction is seen by the readings' noise alone, from 0 to about 1.

        See leg_equations.py. Estimates are drawn away from the truth there, the more the larger it is. None when the
        noise is not known.
        """
        if self.noise is None:
            return None
        estimate, seen = self.estimate, self._determined
        _, values, right = estimate.svd
        return noise_share(estimate.equations, estimate.weight, self.noise, self.parameters, values[seen], right[seen])

    @property
    def sentence(self) -> str:
        """Convergence, rank, condition, accuracy, and whether the noise explains the residuals."""
        said = [self._said_of_solver(), self._said_of_rank(), self._said_of_share(), self._said_of_residuals()]
        return " ".join(part for part in said if part)

    @property
    def _determined(self) -> npt.NDArray[np.bool_]:
        """Which singular values of A are not zero to working precision."""
        left, values, _ = self.estimate.svd
        return np.asarray(values > max(left.shape[0], self.parameters.size) * np.finfo(np.float64).eps * values[0])

    def _scatter(self) -> Floats:
        """C_k, (N, n, n): the covariance of the weighted equations' errors."""
        weight, legs = self.estimate.weight, len(self.legs)
        if self.source == "noise":
            assert self.noise is not None  # fit() has checked
            sigma = self.noise.propagated(self.estimate.equations, self.parameters)
            return np.asarray(weight @ sigma @ weight.transpose(0, 2, 1))
        weighted = np.einsum("kij,kj->ki", weight, self.residuals)
        pseudo = pseudo_residuals(weighted, self.loss, self.estimate.scale)
        square = np.eye(legs) * np.sum(pseudo**2) if self.weights == "joint" else pseudo.T @ pseudo
        return np.broadcast_to(square / self.freedom, weight.shape)

    def _said_of_solver(self) -> str:
        done = "converged" if self.converged else "DID NOT CONVERGE"
        unit = "mm" if self.form == "g" else "mm^2"
        how = {"none": "unweighted", "legs": "weighted leg by leg", "joint": "weighted jointly"}[self.weights]
        loss = "" if self.loss == "linear" else f", {self.loss} loss"
        count, legs = self.residuals.shape
        return (
            f"The fit of {legs} leg{'s' * (legs > 1)} to {count} measurements "
            f"(equations {self.form}, {unit}; {how}{loss}) {done}."
        )

    def _said_of_rank(self) -> str:
        size = self.parameters.size
        if self.rank < size:
            names = [
                f"{symbol} of leg {leg}"
                for leg, row in zip(self.legs, self.undetermined, strict=True)
                for symbol, lost in zip(SYMBOLS, row, strict=True)
                if lost
            ]
            return f"The data are RANK-DEFICIENT, {self.rank} of {size}: they do not determine {listed(names)}."
        said = f"Rank {self.rank} of {size}, condition {self.condition:.2g}"
        if not np.isfinite(self.standard_errors).all():
            return f"{said}; no measurements are left to tell the parameters' errors from."
        leg, symbol = np.unravel_index(np.argmax(self.standard_errors), self.standard_errors.shape)
        return (
            f"{said}; the largest standard error (from the {self.source}) "
            f"is {self.standard_errors[leg, symbol]:.3g} mm, of {SYMBOLS[symbol]} of leg {self.legs[leg]}."
        )

    def _said_of_share(self) -> str:
        share = self.noise_share
        if share is None or share < _BIASED:
            return ""
        return (
            f"In some direction {100 * min(share, 1.0):.0f} % OF WHAT SEEMS TO DETERMINE THE PARAMETERS IS THE NOISE "
            "ITSELF: the poses differ too little, the fit is biased there, and the standard errors are too small."
        )

    def _said_of_residuals(self) -> str:
        ratio = self.noise_ratio
        if self.noise is None:
            return "The readings' noise is not known, so whether it explains the residuals is not said."
        if ratio is None:
            return "Whether the noise explains the residuals cannot be said: too few measurements, or a noise of zero."
        freedom = len(self.residuals) - 7
        found = [chances(float(r**2) * freedom, freedom, self.noise.freedom) for r in ratio]
        said = f"Residuals are {ratio.min():.3g} to {ratio.max():.3g} times what the noise explains, by leg"
        large, small = ([leg for leg, p in zip(self.legs, found, strict=True) if p[k] < _SUSPICIOUS] for k in (1, 0))
        if large:
            bad = ", ".join(map(str, large))
            taken = (
                "standard errors are from the residuals, and know nothing of what the model lacks"
                if self.source == "residuals"
                else "standard errors from it are too small"
            )
            return f"{said}: for leg {bad} THE NOISE DOES NOT EXPLAIN THEM; {taken}."
        if small:
            bad = ", ".join(map(str, small))
            causes = "is it shared by camera and sensors, or that of single readings?"
            return f"{said}: for leg {bad} THE NOISE IS OVERSTATED ({causes})."
        taken = ", though hardly; standard errors are from the residuals" if self.doubted else ""
        return f"{said}: as expected{taken}."

    @property
    def doubted(self) -> bool:
        """Whether the residuals decided against the noise."""
        return self.chosen and self.source == "residuals" and self.noise is not None


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


# ------------------------------------------------------------------------------------------------------------------
# The classical fit x_c of one leg: where certification looks around. It proves nothing.

_TOLERANCE = 1e-8  # a box of X0 is centred here, so closer adds nothing


def least_squares(campaign: Campaign, leg: int) -> Floats:
    """Parameters (7,) in mm that minimise the sum of squares of g (paper, eq. 15), from the nominal ones.

    Leg numbers count from 1. With fewer than 7 independent poses: one of the many minima, near the nominal.
    """
    return np.asarray(fit(campaign, legs=[leg], tolerance=_TOLERANCE).parameters[0])
