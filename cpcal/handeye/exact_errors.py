"""Given frames in exact rational arithmetic: what their largest error is, in every image, and where points stand.

This is the upper end of the bracket. Frames are given by quaternions and positions in float64, taken as exact; R(q) is
divided by |q|^2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F

import numpy as np

from cpcal.handeye.exact_rows import exact_poses
from cpcal.handeye.hand_eye_study import HandEyeFrames, HandEyeStudy
from cpcal.robot import normalised, quaternion_from_matrix, rotation_matrix
from cpcal.robot.rotation import rotation_numerators

Vector = list[F]
Matrix = list[Vector]
Reading = tuple[float, ...]  # of a pose: d in mm and w in rad, see `cpcal.handeye.pose_readings`


@dataclass(frozen=True)
class PlacedFrames:
    """The camera in the hand (eye in hand) or base frame, and the target in the base (eye in hand) or hand frame.

    Positions in mm, quaternions scalar first; float64 numbers that are taken as exact. Raises ValueError for frames
    that are none.
    """

    camera_position: tuple[float, float, float]
    camera_quaternion: tuple[float, float, float, float]
    target_position: tuple[float, float, float]
    target_quaternion: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        for quaternion in (self.camera_quaternion, self.target_quaternion):
            if not 0.1 < math.hypot(*quaternion) < 10.0:  # nor NaN
                raise ValueError("a quaternion is of no rotation")

    @property
    def frames(self) -> HandEyeFrames:
        """E and F, in float64."""
        turn = rotation_matrix(normalised(self.camera_quaternion)).T
        target = rotation_matrix(normalised(self.target_quaternion))
        return HandEyeFrames(turn, -turn @ np.array(self.camera_position), target, np.array(self.target_position))

    @property
    def unknowns(self) -> Vector:
        """The 24 of `cpcal.handeye.frame_equations`, in rational numbers."""
        found: Vector = []
        for quaternion, position in (
            (self.camera_quaternion, self.camera_position),
            (self.target_quaternion, self.target_position),
        ):
            found += [value for row in exact_rotation(quaternion) for value in row]
            found += [F(value) for value in position]
        return found

    @staticmethod
    def of(frames: HandEyeFrames) -> PlacedFrames:
        turn = frames.e_rotation.T
        return PlacedFrames(
            tuple((-turn @ frames.e_translation).tolist()),
            tuple(quaternion_from_matrix(turn).tolist()),
            tuple(frames.f_translation.tolist()),
            tuple(quaternion_from_matrix(frames.f_rotation).tolist()),
        )


def exact_rotation(quaternion: tuple[float, ...]) -> Matrix:
    """R(q) in rational numbers."""
    rows, norm = rotation_numerators([F(v) for v in quaternion])
    return [[value / norm for value in row] for row in rows]


def read_motions(study: HandEyeStudy, readings: Sequence[Reading]) -> list[tuple[Matrix, Vector]]:
    """H_i at the readings (at the stated poses where there are none)."""
    found = []
    for k, (turn, shift) in enumerate(exact_poses(study)):
        if readings:
            d, w = ([F(v) for v in readings[k][part]] for part in (slice(0, 3), slice(3, 6)))
            rows, norm = rotation_numerators([F(1), *(v / 2 for v in w)])
            more = [[value / norm for value in row] for row in rows]
            turn = [
                [sum((a * row[j] for a, row in zip(line, turn, strict=True)), F(0)) for j in range(3)] for line in more
            ]
            shift = [a + b for a, b in zip(shift, d, strict=True)]
        if study.setup == "eye-in-hand":
            turn = [list(column) for column in zip(*turn, strict=True)]
            shift = [-value for value in _times(turn, shift)]
        found.append((turn, shift))
    return found


def exact_errors(study: HandEyeStudy, placed: PlacedFrames, readings: Sequence[Reading] = ()) -> list[F | None]:
    """For each point the larger excess `|residual| - half-width` of its two axes, px; None where x_3 > 0 fails."""
    turn_x, turn_f = exact_rotation(placed.camera_quaternion), exact_rotation(placed.target_quaternion)
    t_x, t_f = ([F(v) for v in t] for t in (placed.camera_position, placed.target_position))
    camera = study.camera
    focal, center = ([F(float(v)) for v in values] for values in (camera.focal, camera.center))
    maps = [_map(turn_x, t_x, turn, shift, turn_f, t_f) for turn, shift in read_motions(study, readings)]
    found: list[F | None] = []
    rows = zip(study.image.tolist(), study.rays.tolist(), study.points.tolist(), study.half_width.tolist(), strict=True)
    for image, ray, point, width in rows:
        turn, shift = maps[image]
        p = [F(v) for v in point]
        x = [sum((row[d] * p[d] for d in range(3) if p[d]), t) for row, t in zip(turn, shift, strict=True)]
        if x[2] <= 0:
            found.append(None)
            continue
        off = (abs(focal[a] * x[a] / x[2] - (F(ray[a]) - center[a])) for a in (0, 1))
        found.append(max(off) - F(width))
    return found


def _map(r_x: Matrix, t_x: Vector, turn: Matrix, shift: Vector, r_f: Matrix, t_f: Vector) -> tuple[Matrix, Vector]:
    """x = R_X^T (H F p - t_X) as one rotation and translation."""
    back = [list(column) for column in zip(*r_x, strict=True)]
    moved = [value + s - t for value, s, t in zip(_times(turn, t_f), shift, t_x, strict=True)]
    columns = [_times(back, _times(turn, list(column))) for column in zip(*r_f, strict=True)]
    return [list(row) for row in zip(*columns, strict=True)], _times(back, moved)


def _times(matrix: Matrix, vector: Vector) -> Vector:
    return [sum((a * v for a, v in zip(row, vector, strict=True)), F(0)) for row in matrix]


def largest(errors: list[F | None]) -> F | None:
    """The largest of them, from 0; None where some point is not in front of the camera."""
    known = [error for error in errors if error is not None]
    return max([F(0), *known]) if len(known) == len(errors) else None


def above(value: F) -> float:
    """The least float64 that is not below a number that is not negative; 0 for what is below 0."""
    value = max(value, F(0))
    near = float(value)
    return near if F(near) >= value else math.nextafter(near, math.inf)
