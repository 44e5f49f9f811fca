"""Pairs of poses for hand-eye problems: checked, in a unit of their own, and with enough rotation.

Lengths are divided by a length of the data before anything is solved, so that no result depends on the unit.

How much rotation there is has one figure, the `spread` in rad of the direction that moves least: for poses the
smallest over unit vectors v of sqrt(2 (1 - |mean_i R_i v|)), about the rms angle between the R_i v and their mean
direction; for motions that of the rms of |R_i v - v|. It is zero exactly when all motions turn about one common
axis v: then translations along it cannot be found, whatever the method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.robot import Pose, normalised

LEAST_SPREAD = 1e-6  # rad: below it the data are degenerate to rounding
_LISTED = 20  # unusable poses that a message lists


@dataclass(frozen=True, eq=False)
class Pairs:
    """N poses A_i and B_i, positions divided by `unit` mm."""

    a: Pose
    b: Pose
    unit: float

    def __len__(self) -> int:
        return len(self.a.position)


def pose_pairs(a: Pose, b: Pose, least: int, names: tuple[str, str]) -> Pairs:
    """N >= `least` pairs of poses, (N, 3) mm and (N, 4), scaled by the rms length of all positions.

    Raises InputError for wrong shapes, NaN or infinite numbers, zero quaternions, too few pairs.
    """
    problems = [p for pose, name in zip((a, b), names, strict=True) for p in _pose_problems(pose, name)]
    if not problems and len(a.position) != len(b.position):
        what = f"hold {len(a.position)} and {len(b.position)} poses"
        problems.append(Problem(" and ".join(names), what, "give the same measurements in the same order"))
    if not problems and len(a.position) < least:
        what = f"hold {len(a.position)} pairs, which do not determine the unknown frames"
        problems.append(Problem(" and ".join(names), what, f"give at least {least}, with rotations about two axes"))
    if problems:
        raise InputError(problems)
    lengths = np.concatenate([a.position, b.position])
    largest = float(np.max(np.abs(lengths))) or 1.0  # squares of lengths may overflow, those of shares do not
    unit = largest * (float(np.sqrt(np.mean(np.sum((lengths / largest) ** 2, axis=1)))) or 1.0)
    scaled = [Pose(pose.position / unit, normalised(pose.quaternion)) for pose in (a, b)]
    return Pairs(scaled[0], scaled[1], unit)


@dataclass(frozen=True, eq=False)
class Spreads:
    """How far rotations move three orthogonal directions, rad, ascending; `axis` (3,) is the one moved least."""

    values: Floats
    axis: Floats

    def demand(self, name: str, least: float = LEAST_SPREAD) -> float:
        """The smallest spread; InputError that says what is missing when it is at most `least` rad."""
        low, high = float(self.values[0]), float(self.values[2])
        if low > least:
            return low
        if high <= least:
            what = f"hardly turn: by {high:.2g} rad (rms), which is not above {least:.2g} rad"
        else:
            text = ", ".join(f"{value:.3f}" for value in self.axis)
            what = (
                f"turn about one axis only, ({text}): it moves by {low:.2g} rad (rms), which is not above {least:.2g} "
                "rad, so that translations along it are not determined"
            )
        remedy = "add poses tilted about at least two different axes, as far as the robot and the view allow"
        raise InputError([Problem(name, what, remedy)])


def pose_spreads(rotations: Floats) -> Spreads:
    """Of the directions R_i v about their mean, for poses (N, 3, 3); the axis is in the poses' reference frame."""
    left, size, _ = np.linalg.svd(rotations.mean(axis=0))
    return Spreads(np.sqrt(2.0 * np.maximum(0.0, 1.0 - size)), _signed(left[:, 0]))


def motion_spreads(rotations: Floats) -> Spreads:
    """Of the directions R_i v from v itself, for motions (N, 3, 3)."""
    moved = np.eye(3) - rotations
    square, axes = np.linalg.eigh(np.einsum("kij,kil->jl", moved, moved) / len(rotations))
    return Spreads(np.sqrt(np.maximum(0.0, square)), _signed(axes[:, 0]))


def _signed(axis: Floats) -> Floats:
    """The one of an axis' two unit vectors whose largest component is positive."""
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis))])) + 0.0


def _pose_problems(pose: Pose, name: str) -> list[Problem]:
    shape = (np.shape(pose.position), np.shape(pose.quaternion))
    count = shape[0][0] if shape[0] else 0
    if shape != ((count, 3), (count, 4)):
        what = f"have positions of shape {shape[0]} and quaternions of shape {shape[1]}"
        return [Problem(name, what, "give (N, 3) in mm and (N, 4), scalar first")]
    found = []
    good = np.isfinite(np.concatenate([pose.position, pose.quaternion], axis=1)).all(axis=1)
    for k in np.flatnonzero(~(good & pose.quaternion.any(axis=1)))[:_LISTED]:
        what = "has the zero quaternion" if good[k] else "holds a NaN or an infinity"
        found.append(Problem(f"{name}, pose {k} (from 0)", what, "correct it, or leave the pair out"))
    return found
