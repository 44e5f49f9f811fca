"""Errors of validation poses before and after calibration (the paper, section 3.3: table 6 and figure 5).

For measured leg readings the forward kinematics of a parameter vector says where the platform should be; the camera
says where it was. Nothing of it is proved: it is a mean over the poses that were tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.calibration.fit import Noise
from cpcal.common.errors import unusable
from cpcal.common.values import Bools, Floats
from cpcal.robot import (
    Campaign,
    LegEquations,
    Robot,
    distances,
    forward_poses,
)

Numbers = tuple[float, ...]
KINDS = ("position", "orientation")


@dataclass(frozen=True)
class Validation:
    """Errors of the same N poses with the parameters before and after calibration.

    names        of the poses
    position     (2, N) mm, before and after; orientation (2, N) rad, the angle that remains; nan where the forward
                 kinematics did not converge. Figures are over the poses where both did; `failed` names the others
    floor        root mean squares (mm, rad) that the noise of these readings makes of perfect parameters; where known
    """

    names: tuple[str, ...]
    position: tuple[Numbers, Numbers]
    orientation: tuple[Numbers, Numbers]
    floor: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for columns that differ in length."""
        if any(len(column) != len(self.names) for column in (*self.position, *self.orientation)):
            raise ValueError("a validation has not one error for each name")

    @property
    def compared(self) -> Bools:
        """(N,) which poses converged with both."""
        return np.asarray(np.isfinite(self.position).all(axis=0))

    @property
    def failed(self) -> tuple[str, ...]:
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


def pose_errors(campaign: Campaign, parameters: npt.ArrayLike) -> tuple[Numbers, Numbers]:
    """How far the poses that parameters (n, 7) mm give for the campaign's leg readings are from its measured poses, on
    the assembly branch of these: (N,) mm and (N,) rad, nan where they do not converge. InputError for other shapes."""
    x = np.asarray(parameters, dtype=np.float64)
    if x.shape != (campaign.legs, 7) or not np.isfinite(x).all():
        what = f"have the shape {x.shape}, or a number that is not finite"
        raise unusable("parameters", what, f"give ({campaign.legs}, 7) finite numbers, mm")
    found, _ = forward_poses(Robot.from_parameters("", x), campaign.length, campaign.poses)
    apart, turn = (tuple(part.tolist()) for part in distances(found, campaign.poses))
    return apart, turn


def validate(campaign: Campaign, parameters: npt.ArrayLike, *, noise: Noise | None = None) -> Validation:
    """Pose errors on the campaign with `parameters` (n, 7), mm, against those of the nominal ones.

    Take a campaign whose poses were not used for calibration; with repeated runs, average it first (`averaged`).
    `noise` of its readings gives the floor below which no parameters can come, to first order: the forward kinematics
    of lengths that are off by s is off by J^-1 s, and the camera by c; they differ by J^-1 s - c.
    """
    each = [pose_errors(campaign, x) for x in (campaign.robot.parameters, parameters)]
    floor = None
    if noise is not None:
        back = np.linalg.pinv(LegEquations.of(campaign).by_pose(np.asarray(parameters, dtype=np.float64)))
        square = np.einsum("kij,kj->ki", back**2, noise.length**2) + np.diagonal(noise.pose, axis1=1, axis2=2)
        of_place, of_turn = np.sqrt(square.mean(axis=0).reshape(2, 3).sum(axis=1)).tolist()
        floor = of_place, of_turn
    position, orientation = ((each[0][k], each[1][k]) for k in (0, 1))
    return Validation(tuple(campaign.measurement_ids), position, orientation, floor)
