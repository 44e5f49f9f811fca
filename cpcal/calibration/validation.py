"""Errors of validation poses before and after calibration (the paper, section 3.3: table 6 and figure 5).

For measured leg readings the forward kinematics of a parameter vector says where the platform should be; the camera
says where it was. Nothing of it is proved: it is a mean over the poses that were tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cpcal.calibration.leg_equations import LegEquations, Noise
from cpcal.calibration.statistics import group_means, grouped, mean_rotations
from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Bools, Floats, frozen_array
from cpcal.robot import Campaign, Pose, quaternion_conjugate, quaternion_product, rotation_vector

_DRAWS = 20_000

# forward(parameters (n, 7), lengths (N, n), guess): position (N, 3) mm, quaternion (N, 4), converged (N,). The guess
# holds the N measured poses: the solution wanted is that of their assembly branch.
Forward = Callable[[Floats, Floats, Pose], tuple[Floats, Floats, Bools]]


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of N poses: position (N,) mm; orientation (N,) rad, the angle that remains; nan where not converged."""

    position: Floats
    orientation: Floats
    converged: Bools


@dataclass(frozen=True)
class ErrorSummary:
    """Over poses, mm for positions and rad for orientations: means, standard deviations (divisor N - 1), largest
    errors, and those that 95 % of the poses do not exceed."""

    position_mean: float
    position_deviation: float
    orientation_mean: float
    orientation_deviation: float
    position_largest: float
    orientation_largest: float
    position_95: float
    orientation_95: float


@dataclass(frozen=True)
class NoiseFloor:
    """What perfect parameters would show on the same poses, by the noise of their readings: mm and rad.

    position_mean, orientation_mean    expected means of the errors' sizes
    position_square, orientation_square    expected means of their squares
    """

    position_mean: float
    orientation_mean: float
    position_square: float
    orientation_square: float


@dataclass(frozen=True, eq=False)
class Validation:
    """Errors of the same poses with the parameters before and after calibration.

    names   of the N poses; `compared` (N,) tells where the forward kinematics of both converged. Means, deviations
            and improvements are over these, so that before and after are of the same poses; `failed` names the others
    floor   what the readings' noise alone makes of it, where that is known
    """

    names: tuple[str, ...]
    before: PoseErrors
    after: PoseErrors
    floor: NoiseFloor | None = None

    @property
    def compared(self) -> Bools:
        """(N,) which poses converged with both."""
        return np.asarray(self.before.converged & self.after.converged)

    @property
    def failed(self) -> tuple[str, ...]:
        """Poses for which the forward kinematics did not converge, before or after."""
        return tuple(name for name, good in zip(self.names, self.compared, strict=True) if not good)

    @cached_property
    def summary_before(self) -> ErrorSummary:
        """Column "before calibration" of table 6."""
        return self._summary(self.before)

    @cached_property
    def summary_after(self) -> ErrorSummary:
        """Column "after calibration" of table 6."""
        return self._summary(self.after)

    @property
    def beyond_noise(self) -> tuple[float, float] | None:
        """Root mean squares (mm, rad) of the errors after calibration, less what the noise of the validation's own
        readings adds; 0 where that is all. None where the floor is not known."""
        if self.floor is None or not self.compared.any():
            return None
        squares = [float(np.mean(v[self.compared] ** 2)) for v in (self.after.position, self.after.orientation)]
        noise = (self.floor.position_square, self.floor.orientation_square)
        left = [float(np.sqrt(max(0.0, a - b))) for a, b in zip(squares, noise, strict=True)]
        return left[0], left[1]

    @cached_property
    def position_improvement(self) -> Floats:
        """(N,) percent, 100 (before - after) / before; negative where the error grew, nan where not compared."""
        return _improvement(self.before.position, self.after.position)

    @cached_property
    def orientation_improvement(self) -> Floats:
        """(N,) percent, likewise."""
        return _improvement(self.before.orientation, self.after.orientation)

    def sorted_improvement(self, of: str = "position") -> tuple[tuple[str, float], ...]:
        """Pose and improvement in percent, worst first, of "position" or "orientation": figure 5. Compared poses."""
        if of not in ("position", "orientation"):
            raise InputError([Problem("option of", f"has no meaning: {of!r}", "give 'position' or 'orientation'")])
        values = self.position_improvement if of == "position" else self.orientation_improvement
        rows = [(self.names[k], float(values[k])) for k in np.flatnonzero(self.compared)]
        return tuple(sorted(rows, key=lambda row: row[1]))

    @property
    def sentence(self) -> str:
        """Mean errors before and after, how many poses got worse, and which did not converge."""
        compared = int(self.compared.sum())
        lost = f" The forward kinematics did NOT CONVERGE for {', '.join(self.failed)}." if self.failed else ""
        if not compared:
            return f"None of {len(self.names)} poses could be compared.{lost}"
        old, new = self.summary_before, self.summary_after
        worse = int(np.sum(self.after.position[self.compared] > self.before.position[self.compared]))
        turned = int(np.sum(self.after.orientation[self.compared] > self.before.orientation[self.compared]))
        return (
            f"Mean error of {compared} of {len(self.names)} poses: position {old.position_mean:.3g} mm before and "
            f"{new.position_mean:.3g} mm after, orientation {np.degrees(old.orientation_mean):.3g} and "
            f"{np.degrees(new.orientation_mean):.3g} degrees; "
            f"worse after: {worse} in position, {turned} in orientation.{self._said_of_floor()}{lost}"
        )

    def _said_of_floor(self) -> str:
        left = self.beyond_noise
        if self.floor is None or left is None:
            return ""
        return (
            f" Noise of these readings alone would show {self.floor.position_mean:.3g} mm and "
            f"{np.degrees(self.floor.orientation_mean):.2g} degrees; beyond it the errors after calibration are "
            f"{left[0]:.2g} mm and {np.degrees(left[1]):.2g} degrees (root mean squares)."
        )

    def _summary(self, errors: PoseErrors) -> ErrorSummary:
        chosen = [values[self.compared] for values in (errors.position, errors.orientation)]
        if not len(chosen[0]):
            return ErrorSummary(*(8 * [np.nan]))
        (mean, apart), (turn, turned) = (_moments(values) for values in chosen)
        return ErrorSummary(
            position_mean=mean,
            position_deviation=apart,
            orientation_mean=turn,
            orientation_deviation=turned,
            position_largest=float(np.max(chosen[0])),
            orientation_largest=float(np.max(chosen[1])),
            position_95=float(np.quantile(chosen[0], 0.95)),
            orientation_95=float(np.quantile(chosen[1], 0.95)),
        )


def _moments(values: Floats) -> tuple[float, float]:
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else np.nan


def pose_errors(campaign: Campaign, parameters: npt.ArrayLike, forward: Forward) -> PoseErrors:
    """How far the poses that `forward` finds for the campaign's leg readings are from its measured poses.

    parameters (n, 7) mm. Raises InputError when they, or what `forward` returns, have the wrong shape.
    """
    x = np.asarray(parameters, dtype=np.float64)
    if x.shape != (campaign.legs, 7) or not np.isfinite(x).all():
        what = f"have the shape {x.shape}, or a number that is not finite"
        raise InputError([Problem("parameters", what, f"give ({campaign.legs}, 7) finite numbers, mm")])
    guess = Pose(campaign.position, campaign.quaternion)
    found = forward(x, campaign.length, guess)
    position, quaternion = (np.asarray(values, dtype=np.float64) for values in found[:2])
    converged = np.asarray(found[2], dtype=np.bool_)
    count = len(campaign)
    if position.shape != (count, 3) or quaternion.shape != (count, 4) or converged.shape != (count,):
        what = f"returned the shapes {position.shape}, {quaternion.shape} and {converged.shape}"
        raise InputError([Problem("option forward", what, f"return ({count}, 3), ({count}, 4) and ({count},)")])
    good = converged & np.isfinite(position).all(axis=1) & np.isfinite(quaternion).all(axis=1)
    apart, turn = np.full(count, np.nan), np.full(count, np.nan)
    apart[good] = np.linalg.norm(position[good] - campaign.position[good], axis=1)
    remaining = quaternion_product(quaternion[good], quaternion_conjugate(campaign.quaternion[good]))
    turn[good] = np.linalg.norm(rotation_vector(remaining), axis=1)
    return PoseErrors(frozen_array(apart), frozen_array(turn), good)


def validate(
    campaign: Campaign,
    parameters: npt.ArrayLike,
    forward: Forward,
    *,
    before: npt.ArrayLike | None = None,
    noise: Noise | None = None,
) -> Validation:
    """Pose errors on the campaign with `parameters` (n, 7), mm, against those `before` (left out: the nominal ones).

    Take a campaign whose poses were not used for calibration; with repeated runs, average it first (`averaged`).
    `noise` of its readings gives the floor below which no parameters can come.
    """
    old = pose_errors(campaign, campaign.robot.parameters if before is None else before, forward)
    new = pose_errors(campaign, parameters, forward)
    floor = None if noise is None else noise_floor(campaign, np.asarray(parameters, dtype=np.float64), noise)
    return Validation(tuple(campaign.measurement_ids), old, new, floor)


def noise_floor(campaign: Campaign, parameters: Floats, noise: Noise) -> NoiseFloor:
    """The pose errors that the readings' noise alone shows, to first order.

    The forward kinematics of lengths that are off by s is off by J^-1 s, and the camera by c: they differ by
    J^-1 s - c. Means of sizes are from draws with a fixed seed, to about a percent.
    """
    equations = LegEquations.of(campaign, range(1, campaign.legs + 1))
    back = np.linalg.pinv(equations.by_pose(parameters))
    read = back @ noise.length_root
    covariance = read @ read.transpose(0, 2, 1) + noise.pose
    values, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    draws = max(10, _DRAWS // len(campaign))
    drawn = np.einsum("kij,dkj->dki", root, np.random.default_rng(0).standard_normal((draws, len(campaign), 6)))
    sizes = [float(np.mean(np.linalg.norm(drawn[..., part], axis=-1))) for part in (slice(0, 3), slice(3, 6))]
    squares = np.mean(np.diagonal(covariance, axis1=1, axis2=2), axis=0)
    return NoiseFloor(sizes[0], sizes[1], float(squares[:3].sum()), float(squares[3:].sum()))


def _improvement(before: Floats, after: Floats) -> Floats:
    """Percent; 0 where both are 0, -inf where only the error before is."""
    result = np.full(before.shape, np.nan)
    some = before > 0
    result[some] = 100.0 * (before[some] - after[some]) / before[some]
    result[(before == 0) & (after == 0)] = 0.0
    result[(before == 0) & (after > 0)] = -np.inf
    return result


# ------------------------------------------------------------------------------------------------------------------
# Pose accuracy AP and pose repeatability RP, by the formulas of ISO 9283 (7.2 and 7.3).
#
# A pose is commanded n times. With attained positions p_j, their mean p and the commanded position c, and the same for
# the angles a about each axis,
#
#     AP = ||p - c||        l_j = ||p_j - p||        RP = mean(l) + 3 s(l)        AP_a = |a - a_c|        RP_a = 3 s(a)
#
# where s divides by n - 1. What is commanded are leg readings: the commanded pose is where the controller's parameters
# put the platform for them. The standard asks for five poses in a cube, 30 cycles, and stated load and speed; a study's
# validation has its own poses and cycles, which are named with the figures. Attained poses are the camera's: its
# noise is
# in RP, and in AP by the root of n less.

Numbers = tuple[float, ...]
Rows = tuple[Numbers, ...]


@dataclass(frozen=True)
class PosePerformance:
    """Of K poses with `cycles` runs each; mm and rad. Angles are rotation vectors about the axes of the camera frame.

    accuracy_before, accuracy_after    AP with the drawing's parameters in the controller, and with the calibrated ones;
                  nan where the forward kinematics did not converge
    repeatability    RP
    angle_before, angle_after, angle_repeatability    AP_a, AP_b, AP_c and RP_a, RP_b, RP_c: three for each pose
    """

    names: tuple[str, ...]
    cycles: tuple[int, ...]
    accuracy_before: Numbers
    accuracy_after: Numbers
    repeatability: Numbers
    angle_before: Rows
    angle_after: Rows
    angle_repeatability: Rows

    def __post_init__(self) -> None:
        """Raises ValueError for columns that differ in length."""
        columns = (self.accuracy_before, self.accuracy_after, self.repeatability, self.cycles)
        rows = (self.angle_before, self.angle_after, self.angle_repeatability)
        if any(len(column) != len(self.names) for column in (*columns, *rows)) or not self.names:
            raise ValueError("a pose performance has not one number for each pose")
        if any(len(row) != 3 for part in rows for row in part):
            raise ValueError("a pose performance has not three angles for each pose")

    @property
    def sentence(self) -> str:
        """Largest and mean AP and RP."""
        before, after, again = (
            np.array(part) for part in (self.accuracy_before, self.accuracy_after, self.repeatability)
        )
        fewest, most = min(self.cycles), max(self.cycles)
        runs = f"{most}" if fewest == most else f"{fewest} to {most}"
        return (
            f"By the formulas of ISO 9283 (not its five poses and 30 cycles), over {len(self.names)} poses of {runs} "
            f"cycles: pose accuracy AP {_both(before)} with the drawing's parameters and {_both(after)} with "
            f"x_c_sigma; pose repeatability RP {_both(again)}, the camera's noise included."
        )


def _both(values: Floats) -> str:
    good = values[np.isfinite(values)]
    return f"{good.mean():.3g} mm (largest {good.max():.3g})" if len(good) else "unknown"


def pose_performance(runs: Campaign, before: Floats, after: Floats, forward: Forward) -> PosePerformance | None:
    """From runs of commanded configurations; None where some configuration has one run only.

    before, after  (n, 7) mm: parameters of the controller, in the frames of the campaign's poses
    """
    group, names = grouped(runs.pose, repeated=False)
    cycles = np.bincount(group)
    if cycles.min() < 2:
        return None
    place = group_means(runs.position, group, len(names))
    turn = mean_rotations(runs.quaternion, group, len(names))
    apart = np.linalg.norm(runs.position - place[group], axis=1)
    turned = rotation_vector(quaternion_product(runs.quaternion, quaternion_conjugate(turn[group])))
    attained = Pose(place, turn)
    length = group_means(runs.length, group, len(names))
    accuracy = [_accuracy(attained, forward(x, length, attained)) for x in (before, after)]
    mean = np.bincount(group, apart) / cycles
    spread = _deviation(apart[:, None] - mean[group, None], group, cycles)[:, 0]
    return PosePerformance(
        names=names,
        cycles=tuple(map(int, cycles)),
        accuracy_before=tuple(accuracy[0][0].tolist()),
        accuracy_after=tuple(accuracy[1][0].tolist()),
        repeatability=tuple((mean + 3.0 * spread).tolist()),
        angle_before=_rows(accuracy[0][1]),
        angle_after=_rows(accuracy[1][1]),
        angle_repeatability=_rows(3.0 * _deviation(turned, group, cycles)),
    )


def _accuracy(attained: Pose, commanded: tuple[Floats, Floats, np.ndarray]) -> tuple[Floats, Floats]:
    """(K,) mm and (K, 3) rad."""
    position, quaternion, converged = commanded
    turn = rotation_vector(quaternion_product(attained.quaternion, quaternion_conjugate(quaternion)))
    apart = np.linalg.norm(attained.position - position, axis=1)
    return np.where(converged, apart, np.nan), np.where(converged[:, None], np.abs(turn), np.nan)


def _deviation(centred: Floats, group: np.ndarray, cycles: np.ndarray) -> Floats:
    """(K, C): standard deviations about each group's mean, which is taken off already."""
    squares = np.zeros((len(cycles), centred.shape[1]))
    np.add.at(squares, group, centred**2)
    return np.asarray(np.sqrt(squares / (cycles - 1)[:, None]))


def _rows(values: Floats) -> Rows:
    return tuple(tuple(row) for row in values.tolist())
