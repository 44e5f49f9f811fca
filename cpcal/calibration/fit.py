"""The noise of calibration equations, their least-squares fits x_c, x_c_sigma, and errors of validation poses: no
proofs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from cpcal.common.errors import refuse, unusable
from cpcal.common.files import listed
from cpcal.common.least_squares import least_squares
from cpcal.common.values import ArrayLike, Bools, Floats, Names, Numbers, Pair, Places, all_finite, floats, freeze
from cpcal.robot import Campaign, LegEquations, Robot, distances, forward_poses

# ------------------------------------------------------------------------------------------------------------------
# How far the readings' noise moves the calibration equations, and the weights that undo it.
#
# First-order propagation (the paper, section 3.2; Wampler, Hollerbach and Arai 1995): with B = dg/d(P, theta) the
# equations of measurement k have the covariance
#
#     Sigma_k = B Sigma_pose B' + Sigma_length            n x n, one row a leg
#
# The pose noise of a measurement is one and the same for all its legs, so Sigma_k is full: legs are independent in
# their unknowns, not in their errors. (The paper writes `Sigma_F^-1 = dF/dM Sigma_M^-1`, whose shapes do not fit; this
# is what its words say.)


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariances of N measurements' readings; measurements are independent of one another.

    pose         (N, 6, 6): of the position (mm) and the rotation vector in the base frame (rad)
    length       (N, n): standard deviations of the leg readings, mm, independent of the pose and of one another
    freedom      degrees of freedom that these were estimated with; infinite where they are known

    Raises InputError when a shape is wrong, or a number is negative or not finite.
    """

    pose: Floats
    length: Floats
    freedom: float = np.inf

    def __post_init__(self) -> None:
        freeze(self, "pose", "length")
        pose, length = self.pose, self.length
        shaped = pose.ndim == 3 and pose.shape[1:] == (6, 6) and length.ndim == 2 and len(length) == len(pose)
        good = all_finite(pose) and all_finite(length) and (length >= 0).all()
        shapes = f"has the shapes {pose.shape} and {length.shape}"
        refuse(
            (not shaped, "noise", shapes, "give pose (N, 6, 6) and length (N, n)"),
            (shaped and not good, "noise", "holds a negative or non-finite number", "give finite numbers >= 0"),
        )

    @classmethod
    def from_sigmas(cls, position: ArrayLike, rotation: ArrayLike, length: ArrayLike, *, count: int) -> "Noise":
        """Uncorrelated readings: standard deviations of position (mm) and rotation (rad) (3,) or (N, 3), and of
        the leg readings (mm) (n,) or (N, n), for `count` measurements."""
        rows = [np.atleast_1d(floats(values)) for values in (position, rotation, length)]
        try:
            position, rotation, length = (np.broadcast_to(row, (count, row.shape[-1])) for row in rows)
        except ValueError as error:
            raise unusable("noise", str(error), "give (3,), (3,) and (n,), or one row each") from None
        pose = np.hstack([position, rotation])
        return cls(pose[:, :, None] ** 2 * np.eye(pose.shape[1]), length)

    @classmethod
    def of(cls, campaign: Campaign, factor: float | None = None) -> "Noise":
        """From a campaign's half-widths, row by row: sigma = half-width / factor.

        `factor` is what the campaign declares when not given. InputError when it declares none: half-widths alone do
        not tell a standard deviation.
        """
        declared = campaign.uncertainty.factor if campaign.uncertainty is not None else None
        divisor = declared if factor is None else factor
        if campaign.exact or divisor is None or not 0 < divisor < np.inf:
            what = "declares exact readings" if campaign.exact else "does not say how many sigma its half-widths are"
            raise unusable("campaign", what, "give the standard deviations: factor=, or Noise.from_sigmas")
        radii = (campaign.position_radius, campaign.rotation_radius, campaign.length_radius)
        return cls.from_sigmas(*(radius / divisor for radius in radii), count=len(campaign))

    def propagated(self, equations: LegEquations, x: Floats) -> Floats:
        """Sigma_k of every measurement, (N, n, n), mm^2."""
        by_pose = equations.by_pose(x)
        return by_pose @ self.pose @ by_pose.transpose(0, 2, 1) + self.length[:, :, None] ** 2 * np.eye(len(x))


def whitening(sigma: Floats) -> Floats:
    """W_k (N, n, n) with W Sigma W' = 1, from Sigma_k (N, n, n): the inverse of the Cholesky factor."""
    variance = np.diagonal(sigma, axis1=1, axis2=2)
    if not (variance > 0).all():
        row = int(np.flatnonzero(~(variance > 0).all(axis=1))[0])
        what = f"leaves an equation of row {row} without any error: its weight would be infinite"
        raise unusable("noise", what, "give every reading a standard deviation > 0")
    deviation = np.sqrt(variance)
    try:  # of the correlations, whose entries are of order one whatever the units
        factor = np.linalg.cholesky(sigma / (deviation[:, :, None] * deviation[:, None, :]))
    except np.linalg.LinAlgError:
        what = "makes the legs' errors exactly dependent: their covariance has no inverse"
        raise unusable("noise", what, "give lengths a sigma > 0") from None
    return np.asarray(np.linalg.solve(factor, np.eye(sigma.shape[1]) / deviation[:, :, None]))


def chances(square: float, freedom: float, known: float) -> Pair:
    """Of so small, and so large, a sum of squares in standard deviations known with so many degrees of freedom."""
    from scipy import special  # here: it takes a third of a second to load

    if np.isinf(known):
        return float(special.chdtr(freedom, square)), float(special.chdtrc(freedom, square))
    ratio = square / freedom
    return float(special.fdtr(freedom, known, ratio)), float(special.fdtrc(freedom, known, ratio))


# ------------------------------------------------------------------------------------------------------------------
# Least-squares fits x_c and x_c_sigma of a campaign's parameters (the paper, section 3.2). They prove nothing.
#
#     x_c        minimises  sum_k ||g_k(x)||^2
#     x_c_sigma  minimises  sum_k g_k(x)' Sigma_k^-1 g_k(x)                weighted=True, all legs together
#
# over legs' equations g (mm, eq. 15). Sigma_k is that of the noise above, taken at the latest estimate and updated
# until the estimate rests: minimising over Sigma(x) too would favour a large Sigma.
#
# With the weighted equations W_k g_k, their Jacobian A (N n, 7 n) and G = A^+ (its pseudo-inverse), the estimate errs
# to first order by -sum_k G_k W_k dg_k, so that its covariance is
#
#     sum_k G_k C_k G_k'        with C_k = W_k Sigma_k W_k' from the noise, or from the residuals' own scatter,
#
# for any weights, right or wrong; for x_c_sigma and C_k = 1 it is (A'A)^-1. Errors of the readings within A itself
# are of second order and left out.

SYMBOLS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")

_IN_NULL_SPACE = 1e-6  # share of a parameter's direction that must be undetermined for it to be called so
_SUSPICIOUS = 1e-3  # probability of residuals so large, or so small, by noise alone from which the sentence says so
_DOUBTFUL = 0.01  # probability of residuals so large by noise alone from which the covariance is taken from them
_PASSES = 20  # of the weights' update, at most
_AT_REST = 1e-6  # mm: the largest change of a parameter by the last update


@dataclass(frozen=True, eq=False)
class Fit:
    """A least-squares fit of n legs.

    legs        numbers from 1; rows of everything below
    parameters  (n, 7) mm, rows a_x a_y a_z b_x b_y b_z l
    weight      (N, n, n) W_k, the identity for x_c
    weighted    whether it is x_c_sigma
    converged   whether the fit of every leg converged, and the weights came to rest
    source      what the covariance comes from: "noise" or "residuals"
    doubted     whether the residuals decided against the noise that was given
    """

    legs: Places
    equations: LegEquations
    parameters: Floats
    weight: Floats
    weighted: bool
    converged: bool
    source: Literal["noise", "residuals"]
    noise: Noise | None
    doubted: bool = False

    @cached_property
    def svd(self) -> tuple[Floats, Floats, Floats]:
        """Of A, the Jacobian (N n, 7 n) of the weighted equations."""
        jacobian = self.equations.weighted_by_parameters(self.weight, self.parameters)
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        return left, values, right

    @cached_property
    def residuals(self) -> Floats:
        """g(x), (N, n) mm, not weighted."""
        return self.equations.values(self.parameters)

    @cached_property
    def determined(self) -> Bools:
        """Which singular values of A are not zero to working precision."""
        left, values, _ = self.svd
        return np.asarray(values > max(left.shape[0], self.parameters.size) * np.finfo(np.float64).eps * values[0])

    @property
    def rank(self) -> int:
        """Of A: 7 n when the data determine all parameters to first order."""
        return int(np.sum(self.determined))

    @property
    def freedom(self) -> float:
        """Residual degrees of freedom of each leg's scatter; of x_c_sigma of all legs' together."""
        surplus = self.residuals.size - self.rank
        return float(surplus) if self.weighted else surplus / len(self.legs)

    @cached_property
    def sigma(self) -> Floats:
        """(N, n, n) mm^2: the equations' covariances by the noise, which is known."""
        assert self.noise is not None
        return self.noise.propagated(self.equations, self.parameters)

    @cached_property
    def covariance(self) -> Floats:
        """(7 n, 7 n) mm^2, parameters leg by leg; infinite variances (nan beside) where the data tell nothing."""
        if self.source == "residuals" and self.freedom <= 0:  # a fit through all points leaves no scatter to judge by
            size = self.parameters.size
            return np.where(np.eye(size) == 1.0, np.inf, np.nan)
        result, lost = self.determined_covariance, self.undetermined.ravel()
        result[lost, :] = result[:, lost] = np.nan
        result[lost, lost] = np.inf
        return result

    @property
    def determined_covariance(self) -> Floats:
        """The same of what the data tell, along whose other directions nothing varies."""
        (left, values, right), seen, weight = self.svd, self.determined, self.weight
        count, legs = self.residuals.shape
        if self.source == "noise":  # C_k, (N, n, n): the covariance of the weighted equations' errors
            scatter = weight @ self.sigma @ weight.transpose(0, 2, 1)
        else:
            white = np.einsum("kij,kj->ki", weight, self.residuals)
            square = np.eye(legs) * np.sum(white**2) if self.weighted else white.T @ white
            scatter = np.broadcast_to(square / self.freedom, weight.shape)
        inverse = (right[seen].T / values[seen]) @ left[:, seen].T
        spread = np.einsum("pki,kij->pkj", inverse.reshape(-1, count, legs), scatter)
        result = spread.reshape(len(inverse), -1) @ inverse.T
        return np.asarray(0.5 * (result + result.T))

    @property
    def standard_errors(self) -> Floats:
        """(n, 7) mm: square roots of the covariance's diagonal."""
        return np.sqrt(np.diagonal(self.covariance)).reshape(-1, 7)

    @cached_property
    def undetermined(self) -> Bools:
        """(n, 7): which parameters can change without changing any equation, to first order."""
        known = np.sum(self.svd[2][self.determined] ** 2, axis=0)
        return np.asarray(1.0 - known > _IN_NULL_SPACE**2).reshape(-1, 7)

    @cached_property
    def noise_ratio(self) -> Floats | None:
        """(n,) root mean square (divisor N - 7) of residual / its standard deviation by the noise: 1 is expected.

        None when the noise is not known, or zero, or with N <= 7.
        """
        if self.noise is None or len(self.residuals) <= 7:
            return None
        variance = np.diagonal(self.sigma, axis1=1, axis2=2)
        if not (variance > 0).all():
            return None
        return np.asarray(np.sqrt(np.sum(self.residuals**2 / variance, axis=0) / (len(self.residuals) - 7)))

    @cached_property
    def explained(self) -> bool:
        """Whether the residuals, all legs together, are no larger than the noise has them; true where that cannot be
        said: the noise is not known, or singular, or no residuals are left."""
        freedom = self.residuals.size - self.rank
        if self.noise is None or freedom <= 0:
            return True
        try:
            white = np.linalg.solve(np.linalg.cholesky(self.sigma), self.residuals[..., None])
        except np.linalg.LinAlgError:
            return True
        return chances(float(np.sum(white**2)), freedom, self.noise.freedom)[1] >= _DOUBTFUL

    @property
    def sentence(self) -> str:
        """Convergence, rank, condition, accuracy, and whether the noise explains the residuals."""
        done = "converged" if self.converged else "DID NOT CONVERGE"
        count, legs = self.residuals.shape
        how = "weighted by the noise of all legs together" if self.weighted else "unweighted"
        said = f"The fit of {legs} leg{'s' * (legs > 1)} to {count} measurements ({how}) {done}."
        return f"{said} {self._said_of_rank()} {self._said_of_residuals()}"

    def _said_of_rank(self) -> str:
        size = self.parameters.size
        if self.rank < size:
            names = [f"{SYMBOLS[k]} of leg {self.legs[leg]}" for leg, k in np.argwhere(self.undetermined).tolist()]
            return f"The data are RANK-DEFICIENT, {self.rank} of {size}: they do not determine {listed(names)}."
        values = self.svd[1]
        said = f"Rank {self.rank} of {size}, condition {values[0] / values[-1]:.2g}"
        errors = self.standard_errors
        if not all_finite(errors):
            return f"{said}; no measurements are left to tell the parameters' errors from."
        leg, symbol = np.unravel_index(np.argmax(errors), errors.shape)
        return (
            f"{said}; the largest standard error (from the {self.source}) "
            f"is {errors[leg, symbol]:.3g} mm, of {SYMBOLS[symbol]} of leg {self.legs[leg]}."
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
        small, large = (
            ", ".join(str(leg) for leg, p in zip(self.legs, found, strict=True) if p[k] < _SUSPICIOUS) for k in (0, 1)
        )
        if large:
            taken = (
                "standard errors are from the residuals, and know nothing of what the model lacks"
                if self.source == "residuals"
                else "standard errors from it are too small"
            )
            return f"{said}: for leg {large} THE NOISE DOES NOT EXPLAIN THEM; {taken}."
        if small:
            causes = "is it shared by camera and sensors, or that of single readings?"
            return f"{said}: for leg {small} THE NOISE IS OVERSTATED ({causes})."
        taken = ", though hardly; standard errors are from the residuals" if self.doubted else ""
        return f"{said}: as expected{taken}."


def fit(
    campaign: Campaign,
    *,
    legs: Sequence[int] | None = None,
    weighted: bool = False,
    noise: Noise | None = None,
    covariance: Literal["noise", "residuals"] | None = None,
    start: ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> Fit:
    """The parameters (n, 7) in mm that fit the equations of the `legs` (numbers from 1; all) best.

    weighted    False: x_c. True: x_c_sigma of all legs together, with the errors that legs share because they share a
                pose; it needs the noise
    noise       of the readings, for all legs of the campaign. See `Noise.of`
    covariance  "noise": propagated from `noise`, what repeating the measurements would show if the model holds.
                "residuals": from their scatter, correlations between legs included; takes model error for noise.
                Left out: "noise" if given, unless it does not explain the residuals
    start       (n, 7) mm; left out: the campaign's nominal parameters
    tolerance   ends where a step changes sum of squares and parameters by less than this share

    Data that do not determine all parameters give one of the many minima, near the start, and the fit says so. Raises
    InputError for options without a meaning.
    """
    chosen = tuple(range(1, campaign.legs + 1)) if legs is None else tuple(legs)
    columns = [leg - 1 for leg in chosen]
    known_legs, shape = set(range(1, campaign.legs + 1)), (len(campaign), campaign.legs)
    senseless = not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= known_legs
    lacking, other = (
        noise is None and (weighted or covariance == "noise"),
        noise is not None and noise.length.shape != shape,
    )
    refuse(
        (senseless, "option legs", f"has no meaning: {legs}", f"give different numbers from 1 to {campaign.legs}"),
        (lacking, "option noise", "is missing", "give noise=Noise.of(campaign)"),
        (other, "option noise", "is for other leg readings", f"give {shape}"),
    )
    first = campaign.robot.parameters[columns] if start is None else np.array(start)
    known = None if noise is None else replace(noise, length=noise.length[:, columns])
    equations = LegEquations.of(campaign, chosen)
    plain = np.broadcast_to(np.eye(len(chosen)), (len(campaign), len(chosen), len(chosen)))
    if not weighted or known is None:
        x, weight, reached = first.copy(), plain, True
        for leg in range(len(chosen)):
            alone = LegEquations(equations.position, equations.rotation, equations.length[:, [leg]])
            x[leg], good = _solved(alone, plain[:, :1, :1], first[leg], tolerance)
            reached = reached and good
    else:
        x, reached = first, False
        for _ in range(_PASSES):  # fits with weights, and weights at the fit, in turns until they agree
            before, weight = x, whitening(known.propagated(equations, x))
            x, good = _solved(equations, weight, before, tolerance)
            if np.max(np.abs(x - before), initial=0.0) <= _AT_REST:
                reached = good
                break
    source = covariance or ("noise" if known is not None else "residuals")
    found = Fit(chosen, equations, x, weight, weighted, reached, source, known)
    doubted = covariance is None and not found.explained
    return replace(found, source="residuals", doubted=True) if doubted else found


def _solved(equations: LegEquations, weight: Floats, start: Floats, tolerance: float) -> tuple[Floats, bool]:
    """Parameters of the shape of `start`, and whether a criterion was met, for legs that are fitted together."""

    found = least_squares(
        lambda x: np.einsum("kij,kj->ki", weight, equations.values(x.reshape(-1, 7))).ravel(),
        lambda x: equations.weighted_by_parameters(weight, x.reshape(-1, 7)),
        start.ravel(),
        tolerance=tolerance,
    )
    return found.at.reshape(start.shape), found.settled


def robust_scale(residuals: Floats) -> float:
    """1.4826 times the median of |r|: the standard deviation of normal residuals, whatever a minority of them does."""
    return 1.482602218505602 * float(np.median(np.abs(residuals)))


# ------------------------------------------------------------------------------------------------------------------
# Errors of validation poses before and after calibration (the paper, section 3.3: table 6 and figure 5).
#
# For measured leg readings the forward kinematics of a parameter vector says where the platform should be; the camera
# says where it was. Nothing of it is proved: it is a mean over the poses that were tried.

KINDS = ("position", "orientation")


@dataclass(frozen=True)
class Validation:
    """Errors of the same N poses with the parameters before and after calibration.

    names        of the poses
    position     (2, N) mm, before and after; orientation (2, N) rad, the angle that remains; nan where the forward
                 kinematics did not converge. Figures are over the poses where both did; `failed` names the others
    floor        root mean squares (mm, rad) that the noise of these readings makes of perfect parameters; where known
    """

    names: Names
    position: tuple[Numbers, Numbers]
    orientation: tuple[Numbers, Numbers]
    floor: Pair | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for columns that differ in length."""
        if any(len(column) != len(self.names) for column in (*self.position, *self.orientation)):
            raise ValueError("a validation has not one error for each name")

    @property
    def compared(self) -> Bools:
        """(N,) which poses converged with both."""
        return np.asarray(np.isfinite(self.position).all(axis=0))

    @property
    def failed(self) -> Names:
        """Poses for which the forward kinematics did not converge, before or after."""
        return tuple(name for name, good in zip(self.names, self.compared, strict=True) if not good)

    def errors(self, kind: str) -> Floats:
        """(2, M) of the compared poses, before and after; `kind` is "position" (mm) or "orientation" (rad)."""
        return np.array(getattr(self, kind))[:, self.compared]

    def figures(self, kind: str) -> dict[str, Floats]:
        """(2,) each: columns "before calibration" and "after calibration" of table 6, in mm or rad."""
        errors = self.errors(kind)
        if not errors.size:
            return dict.fromkeys(("mean", "std. dev.", "rms", "largest"), np.full(2, np.nan))
        deviation = errors.std(axis=1, ddof=1) if errors.shape[1] > 1 else np.full(2, np.nan)
        squares = np.sqrt(np.mean(errors**2, axis=1))
        return {"mean": errors.mean(axis=1), "std. dev.": deviation, "rms": squares, "largest": errors.max(axis=1)}

    @property
    def sentence(self) -> str:
        """Mean errors before and after, how many poses got worse, and which did not converge."""
        compared = int(self.compared.sum())
        lost = f" The forward kinematics did NOT CONVERGE for {', '.join(self.failed)}." if self.failed else ""
        if not compared:
            return f"None of {len(self.names)} poses could be compared.{lost}"
        place, turn = map(self.figures, KINDS)
        turns, (worse, turned) = np.degrees(turn["mean"]), (np.sum(np.diff(self.errors(k), axis=0) > 0) for k in KINDS)
        said = (
            f"Mean error of {compared} of {len(self.names)} poses: position {place['mean'][0]:.3g} mm before and "
            f"{place['mean'][1]:.3g} mm after, orientation {turns[0]:.3g} and {turns[1]:.3g} degrees; "
            f"worse after: {worse} in position, {turned} in orientation."
        )
        if self.floor is not None:
            left, noise = f"{place['rms'][1]:.2g}", f"{self.floor[0]:.2g}"
            said += (
                f" Root mean squares after it are {left} mm and {np.degrees(turn['rms'][1]):.2g} degrees; noise of "
                f"these readings alone makes {noise} mm and {np.degrees(self.floor[1]):.2g} degrees."
            )
        return said + lost


def pose_errors(campaign: Campaign, parameters: ArrayLike) -> tuple[Numbers, Numbers]:
    """How far the poses that parameters (n, 7) mm give for the campaign's leg readings are from its measured poses, on
    the assembly branch of these: (N,) mm and (N,) rad, nan where they do not converge. InputError for other shapes."""
    x = floats(parameters)
    if x.shape != (campaign.legs, 7) or not all_finite(x):
        what = f"have the shape {x.shape}, or a number that is not finite"
        raise unusable("parameters", what, f"give ({campaign.legs}, 7) finite numbers, mm")
    found, _ = forward_poses(Robot.from_parameters("", x), campaign.length, campaign.poses)
    apart, turn = (tuple(part.tolist()) for part in distances(found, campaign.poses))
    return apart, turn


def validate(campaign: Campaign, parameters: ArrayLike, *, noise: Noise | None = None) -> Validation:
    """Pose errors on the campaign with `parameters` (n, 7), mm, against those of the nominal ones.

    Take a campaign whose poses were not used for calibration; with repeated runs, average it first (`averaged`).
    `noise` of its readings gives the floor below which no parameters can come, to first order: the forward kinematics
    of lengths that are off by s is off by J^-1 s, and the camera by c; they differ by J^-1 s - c.
    """
    each = [pose_errors(campaign, x) for x in (campaign.robot.parameters, parameters)]
    floor = None
    if noise is not None:
        back = np.linalg.pinv(LegEquations.of(campaign).by_pose(floats(parameters)))
        square = np.einsum("kij,kj->ki", back**2, noise.length**2) + np.diagonal(noise.pose, axis1=1, axis2=2)
        of_place, of_turn = np.sqrt(square.mean(axis=0).reshape(2, 3).sum(axis=1)).tolist()
        floor = of_place, of_turn
    position, orientation = ((each[0][k], each[1][k]) for k in (0, 1))
    return Validation(campaign.measurement_ids, position, orientation, floor)
