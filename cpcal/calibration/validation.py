"""Errors of validation poses before and after calibration (the paper, section 3.3: table 6 and figure 5).

For measured leg readings the forward kinematics of a parameter vector says where the platform should be; the camera
says where it was. Nothing of it is proved: it is a mean over the poses that were tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.calibration.fit import LegEquations, Noise, root
from cpcal.common.errors import unusable
from cpcal.common.values import Bools, Floats
from cpcal.robot import (
    Campaign,
    Pose,
    Robot,
    forward_poses,
    quaternion_conjugate,
    quaternion_product,
    rotation_vector,
)

_DRAWS = 20_000

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class PoseErrors:
    """Errors of N poses: position (N,) mm; orientation (N,) rad, the angle that remains; nan where the forward
    kinematics did not converge."""

    position: Numbers
    orientation: Numbers


@dataclass(frozen=True)
class ErrorSummary:
    """Over poses, mm or rad: mean, standard deviation (divisor N - 1), the error that 95 % of them do not exceed, and
    the largest."""

    mean: float
    deviation: float
    at_95: float
    largest: float


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


@dataclass(frozen=True)
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

    def __post_init__(self) -> None:
        """Raises ValueError for columns that differ in length."""
        columns = (part for errors in (self.before, self.after) for part in (errors.position, errors.orientation))
        if any(len(column) != len(self.names) for column in columns):
            raise ValueError("a validation has not one error for each name")

    @property
    def compared(self) -> Bools:
        """(N,) which poses converged with both."""
        return np.asarray(np.isfinite(self.before.position) & np.isfinite(self.after.position))

    @property
    def failed(self) -> tuple[str, ...]:
        """Poses for which the forward kinematics did not converge, before or after."""
        return tuple(name for name, good in zip(self.names, self.compared, strict=True) if not good)

    def errors(self, kind: str) -> tuple[Floats, Floats]:
        """Of the compared poses, before and after calibration; `kind` is "position" (mm) or "orientation" (rad)."""
        before, after = (np.array(getattr(errors, kind))[self.compared] for errors in (self.before, self.after))
        return before, after

    def summaries(self, kind: str) -> tuple[ErrorSummary, ErrorSummary]:
        """Columns "before calibration" and "after calibration" of table 6."""
        before, after = map(_summary, self.errors(kind))
        return before, after

    def improvement(self, kind: str) -> Floats:
        """Percent of the compared poses, 100 (before - after) / before; negative where the error grew, 0 where both are
        0, -inf where only the error before is."""
        before, after = self.errors(kind)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(before == after, 0.0, 100.0 * (before - after) / before)

    @property
    def beyond_noise(self) -> tuple[float, float] | None:
        """Root mean squares (mm, rad) of the errors after calibration, less what the noise of the validation's own
        readings adds; 0 where that is all. None where the floor is not known."""
        if self.floor is None or not self.compared.any():
            return None
        squares = [float(np.mean(self.errors(kind)[1] ** 2)) for kind in ("position", "orientation")]
        noise = (self.floor.position_square, self.floor.orientation_square)
        left = [float(np.sqrt(max(0.0, a - b))) for a, b in zip(squares, noise, strict=True)]
        return left[0], left[1]

    @property
    def sentence(self) -> str:
        """Mean errors before and after, how many poses got worse, and which did not converge."""
        compared = int(self.compared.sum())
        lost = f" The forward kinematics did NOT CONVERGE for {', '.join(self.failed)}." if self.failed else ""
        if not compared:
            return f"None of {len(self.names)} poses could be compared.{lost}"
        (old, new), (turned_old, turned_new) = (self.summaries(kind) for kind in ("position", "orientation"))
        worse, turned = (int(np.sum(after > before)) for before, after in map(self.errors, ("position", "orientation")))
        said = (
            f"Mean error of {compared} of {len(self.names)} poses: position {old.mean:.3g} mm before and "
            f"{new.mean:.3g} mm after, orientation {np.degrees(turned_old.mean):.3g} and "
            f"{np.degrees(turned_new.mean):.3g} degrees; "
            f"worse after: {worse} in position, {turned} in orientation."
        )
        left = self.beyond_noise
        if self.floor is not None and left is not None:
            said += (
                f" Noise of these readings alone would show {self.floor.position_mean:.3g} mm and "
                f"{np.degrees(self.floor.orientation_mean):.2g} degrees; beyond it the errors after calibration are "
                f"{left[0]:.2g} mm and {np.degrees(left[1]):.2g} degrees (root mean squares)."
            )
        return said + lost


def _summary(values: Floats) -> ErrorSummary:
    if not len(values):
        return ErrorSummary(np.nan, np.nan, np.nan, np.nan)
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else np.nan
    return ErrorSummary(float(np.mean(values)), deviation, float(np.quantile(values, 0.95)), float(np.max(values)))


def pose_errors(campaign: Campaign, parameters: npt.ArrayLike) -> PoseErrors:
    """How far the poses that parameters (n, 7) mm give for the campaign's leg readings are from its measured poses, on
    the assembly branch of these. Raises InputError for other shapes."""
    x = np.asarray(parameters, dtype=np.float64)
    if x.shape != (campaign.legs, 7) or not np.isfinite(x).all():
        what = f"have the shape {x.shape}, or a number that is not finite"
        raise unusable("parameters", what, f"give ({campaign.legs}, 7) finite numbers, mm")
    measured = Pose(campaign.position, campaign.quaternion)
    found, _ = forward_poses(Robot.from_parameters("", x), campaign.length, measured)
    remaining = quaternion_product(found.quaternion, quaternion_conjugate(campaign.quaternion))
    off = (found.position - campaign.position, rotation_vector(remaining))
    apart, turn = (np.linalg.norm(part, axis=1) for part in off)
    return PoseErrors(tuple(apart.tolist()), tuple(turn.tolist()))


def validate(campaign: Campaign, parameters: npt.ArrayLike, *, noise: Noise | None = None) -> Validation:
    """Pose errors on the campaign with `parameters` (n, 7), mm, against those of the nominal ones.

    Take a campaign whose poses were not used for calibration; with repeated runs, average it first (`averaged`).
    `noise` of its readings gives the floor below which no parameters can come.
    """
    old, new = pose_errors(campaign, campaign.robot.parameters), pose_errors(campaign, parameters)
    floor = None if noise is None else noise_floor(campaign, np.asarray(parameters, dtype=np.float64), noise)
    return Validation(tuple(campaign.measurement_ids), old, new, floor)


def noise_floor(campaign: Campaign, parameters: Floats, noise: Noise) -> NoiseFloor:
    """The pose errors that the readings' noise alone shows, to first order.

    The forward kinematics of lengths that are off by s is off by J^-1 s, and the camera by c: they differ by
    J^-1 s - c. Means of sizes are from draws with a fixed seed, to about a percent.
    """
    back = np.linalg.pinv(LegEquations.of(campaign).by_pose(parameters))
    read = back @ noise.length_root
    covariance = read @ read.transpose(0, 2, 1) + noise.pose
    draws = max(10, _DRAWS // len(campaign))
    stream = np.random.default_rng(0).standard_normal((draws, len(campaign), 6))
    drawn = np.einsum("kij,dkj->dki", root(covariance), stream)
    sizes = [float(np.mean(np.linalg.norm(drawn[..., part], axis=-1))) for part in (slice(0, 3), slice(3, 6))]
    squares = np.mean(np.diagonal(covariance, axis1=1, axis2=2), axis=0)
    return NoiseFloor(sizes[0], sizes[1], float(squares[:3].sum()), float(squares[3:].sum()))
