"""Where the camera stands and how the target is fixed, from pairs of poses (the paper, section 3.1).

The robot tells A_i, the mobile frame in the base frame (from its drawing and the leg readings); the camera tells
B_i, the target frame in the camera frame. Unknown are X, the camera frame in the base frame, and Z, the target
frame in the mobile frame. Both ways from the target to the base are the same:

    X B_i = A_i Z                                                   (robot-world and hand-eye calibration)

All of this is ordinary estimation: nothing here is proved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cpcal.calibration.hand_eye_methods import andreff, andreff_hand_eye, shah
from cpcal.calibration.pose_pairs import Pairs, Spreads, motion_spreads, pose_pairs, pose_spreads
from cpcal.calibration.refine import Refined, refined, residuals
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.robot import Pose, Robot, inverse, transformed

METHODS: dict[str, Callable[[Pairs], tuple[Pose, Pose]]] = {"shah": shah, "andreff": andreff}

_LOST = 1.0  # spread of the rotations over the rms rotation residual: below it, the rotation is noise
_WEAK = 5.0  # and below it, a remark
_LARGE = 0.1  # rad: rms rotation residuals that calibrated sensors hardly have


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fitted:
    """What is told of every fit.

    position_residual  (N, 3) mm, the target's origin as B_i has it less that of X^-1 A_i Z, in the camera frame
    rotation_residual  (N, 3) rad, the rotation vector from X^-1 A_i Z to B_i, in the camera frame
    sigma_position     (3,) mm, sigma_rotation (3,) rad: standard deviations that weighted the two, by axis
    unit_weight        size of the weighted residuals; near 1 when the two standard deviations are right
    covariance         by linearised least squares for independent errors, mm and rad
    spread             rad, how far the direction moves that the rotations move least (see pose_pairs.py)
    remarks            sentences on what makes the result doubtful; empty when nothing does
    """

    position_residual: Floats
    rotation_residual: Floats
    sigma_position: Floats
    sigma_rotation: Floats
    unit_weight: float
    covariance: Floats
    spread: float
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameCalibration(_Fitted):
    """The camera in the base frame, the target in the mobile frame, and how well they are known.

    camera_in_base     X; target_in_mobile Z; positions in mm
    covariance         (12, 12), of X's position (mm) and rotation vector (rad, base frame), then of Z's position and
                       rotation vector (mobile frame)

    The rest is in `_Fitted`.
    """

    camera_in_base: Pose
    target_in_mobile: Pose
    method: str

    @property
    def standard_deviations(self) -> Floats:
        """(12,) mm and rad, in the order of `covariance`."""
        return np.sqrt(np.diagonal(self.covariance))


@dataclass(frozen=True, eq=False, kw_only=True)
class HandEye(_Fitted):
    """`transform`: X of `A_i X = X B_i`; everything else as in `_Fitted`, with X for Z and a covariance (6, 6)."""

    transform: Pose


def calibrate_frames(
    robot_poses: Pose,
    camera_poses: Pose,
    *,
    method: str = "shah",
    refine: bool = True,
    sigma_position: npt.ArrayLike | None = None,
    sigma_rotation: npt.ArrayLike | None = None,
) -> FrameCalibration:
    """X and Z of `X B_i = A_i Z` from N >= 3 poses A_i of the robot and B_i of the camera.

    robot_poses     A_i, mobile frame in base frame: (N, 3) mm and (N, 4); e.g. forward_kinematics of the drawing
    camera_poses    B_i, target frame in camera frame, of the same configurations in the same order
    method          "shah" (closed form, 2013) or "andreff" (linear, Andreff, Horaud and Espiau 1999): the start
    refine          whether non-linear least squares on positions and rotations follows
    sigma_position  mm, sigma_rotation rad: standard deviations of B_i against X^-1 A_i Z, one or three (for the
                    camera's axes). None: estimated from the residuals, for each axis from 10 pairs on.

    Lengths are scaled before anything is solved: the result does not depend on their unit. InputError for unusable
    arrays, for fewer than three pairs, and where the orientations do not determine the frames: all (nearly) the
    same, or turned about one axis only (planar motion), or by no more than their own errors.
    """
    if method not in METHODS:
        raise InputError([Problem("method", f"there is none called {method!r}", f"choose one of {sorted(METHODS)}")])
    pairs = pose_pairs(robot_poses, camera_poses, 3, ("robot_poses", "camera_poses"))
    name, spread = _smaller_spread(pairs, pose_spreads, ("robot_poses", "camera_poses"))
    x, z = METHODS[method](pairs)
    _remarks(name, spread, residuals(pairs, x, z)[1])  # refuses what no refinement can mend
    best = _estimated(pairs, x, z, refine, sigma_position, sigma_rotation, tied=False)
    return FrameCalibration(
        camera_in_base=_in_mm(best.x, pairs.unit),
        target_in_mobile=_in_mm(best.z, pairs.unit),
        method=method,
        **_told(pairs, best, name, spread),
    )


def hand_eye(
    a: Pose,
    b: Pose,
    *,
    refine: bool = True,
    sigma_position: npt.ArrayLike | None = None,
    sigma_rotation: npt.ArrayLike | None = None,
) -> HandEye:
    """X of `A_i X = X B_i` from N >= 2 relative motions, by Andreff's linear method and least squares.

    a, b  motions (N, 3) mm and (N, 4) of the same rigid body, seen in the two frames that X relates: X maps
          coordinates of B's frame to A's. The rest is as for `calibrate_frames`, InputErrors included.
    """
    pairs = pose_pairs(a, b, 2, ("a", "b"))
    name, spread = _smaller_spread(pairs, motion_spreads, ("a", "b"))
    start = andreff_hand_eye(pairs.a, pairs.b)
    _remarks(name, spread, residuals(pairs, start, start)[1])
    best = _estimated(pairs, start, start, refine, sigma_position, sigma_rotation, tied=True)
    return HandEye(transform=_in_mm(best.x, pairs.unit), **_told(pairs, best, name, spread))


def _told(pairs: Pairs, best: Refined, name: str, spread: Spreads) -> dict[str, Any]:
    """The fields of `_Fitted`, lengths in mm."""
    position, turn = residuals(pairs, best.x, best.z)
    return {
        "position_residual": position * pairs.unit,
        "rotation_residual": turn,
        "sigma_position": best.sigma_position * pairs.unit,
        "sigma_rotation": best.sigma_rotation,
        "unit_weight": best.unit_weight,
        "covariance": _covariance_in_mm(best.covariance, pairs.unit),
        "spread": float(spread.values[0]),
        "remarks": _remarks(name, spread, turn),
    }


def redefined(robot: Robot, camera_in_base: Pose, target_in_mobile: Pose) -> Robot:
    """The robot with its base joint centres in the camera frame and its mobile ones in the target frame.

    Then `P + R b` with the camera's own P and R maps them into one frame, and the measured poses calibrate the legs
    without further frames (the paper, end of section 3.1). Offsets stay.
    """
    base = transformed(inverse(camera_in_base), robot.base)
    return Robot(robot.name, base, transformed(inverse(target_in_mobile), robot.mobile), robot.offset)


def _smaller_spread(pairs: Pairs, spreads: Callable[[Floats], Spreads], names: tuple[str, str]) -> tuple[str, Spreads]:
    """That of A or of B (without noise they are the same) and its name; InputError where one is degenerate."""
    found = [(name, spreads(pose.rotation)) for name, pose in zip(names, (pairs.a, pairs.b), strict=True)]
    for name, spread in found:
        spread.demand(name)
    return min(found, key=lambda item: float(item[1].values[0]))


def _estimated(
    pairs: Pairs,
    x: Pose,
    z: Pose,
    refine: bool,
    sigma_position: npt.ArrayLike | None,
    sigma_rotation: npt.ArrayLike | None,
    *,
    tied: bool,
) -> Refined:
    given = {"sigma_position": sigma_position, "sigma_rotation": sigma_rotation}
    wrong = [name for name, value in given.items() if value is not None and not _standard_deviations(value)]
    if wrong:
        remedy = "give a positive number, or three, or None"
        raise InputError([Problem(name, f"is {given[name]!r}", remedy) for name in wrong])
    scaled = None if sigma_position is None else np.asarray(sigma_position, dtype=np.float64) / pairs.unit
    return refined(pairs, x, z, sigma_position=scaled, sigma_rotation=sigma_rotation, tied=tied, move=refine)


def _standard_deviations(value: npt.ArrayLike) -> bool:
    array = np.asarray(value, dtype=np.float64)
    return array.shape in ((), (3,)) and bool(((array > 0.0) & np.isfinite(array)).all())


def _remarks(name: str, spread: Spreads, turn: Floats) -> tuple[str, ...]:
    """What the rotation residuals (N, 3) say; InputError when they are as large as the rotations themselves."""
    rms = float(np.sqrt(np.mean(np.sum(turn**2, axis=1))))
    least = float(spread.values[0])
    axis = ", ".join(f"{value:.3f}" for value in spread.axis)
    found = f"move the direction ({axis}) by {least:.2g} rad (rms) only"
    if least <= _LOST * rms:
        what = f"{found}, and the two sides differ by {rms:.2g} rad: translations along it are not determined"
        remedy = "add poses tilted about at least two axes; check that the pairs belong together and map as documented"
        raise InputError([Problem(name, what, remedy)])
    remarks = []
    if least <= _WEAK * rms:
        ratio = f"{least / rms:.1f} times the {rms:.2g} rad by which the two sides differ"
        remarks.append(f"{name} {found}, {ratio}: translations along it are weakly determined")
    if rms > _LARGE:
        remarks.append(f"the two sides differ by {rms:.2g} rad (rms): check that the pairs belong together")
    return tuple(remarks)


def _in_mm(pose: Pose, unit: float) -> Pose:
    return Pose(pose.position * unit, pose.quaternion)


def _covariance_in_mm(covariance: Floats, unit: float) -> Floats:
    scale = np.tile(np.repeat([unit, 1.0], 3), len(covariance) // 6)
    return np.asarray(covariance * np.outer(scale, scale))
