"""Interval vectors, matrices and quaternions: exact numbers go in, enclosures of exact results come out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import ByValue, frozen_array
from cpcal.robot import Pose, normalised, quaternion_conjugate, quaternion_product
from cpcal.robot.kinematics import rotation_numerators
from cpcal.solver.interval import Box, IntervalArray, get_arithmetic

ENGINE = get_arithmetic("float64")

_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def exact(values: npt.ArrayLike) -> IntervalArray:
    """Floats as the numbers that they are."""
    return IntervalArray.point(values)


def stacked(parts: Sequence[IntervalArray], axis: int = -1) -> IntervalArray:
    return IntervalArray(np.stack([p.lo for p in parts], axis), np.stack([p.hi for p in parts], axis))


def joined(parts: Sequence[IntervalArray], axis: int = -1) -> IntervalArray:
    return IntervalArray(np.concatenate([p.lo for p in parts], axis), np.concatenate([p.hi for p in parts], axis))


def inner(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """The sum of products along the last axis; other axes broadcast."""
    return ENGINE.sum(ENGINE.mul(x, y), -1)


def cross(x: IntervalArray, y: IntervalArray) -> IntervalArray:
    """Cross products (..., 3)."""
    e = ENGINE
    return e.sub(e.mul(x[..., _NEXT], y[..., _LAST]), e.mul(x[..., _LAST], y[..., _NEXT]))


def times(matrix: IntervalArray, vectors: IntervalArray) -> IntervalArray:
    """A v for one matrix (3, 3) and vectors (..., 3)."""
    return inner(matrix, vectors[..., None, :])


def transposed(matrix: IntervalArray) -> IntervalArray:
    return IntervalArray(matrix.lo.T, matrix.hi.T)


def rotation(quaternion: npt.ArrayLike) -> IntervalArray:
    """R(q) (3, 3), the rational matrix divided by |q|^2, of one exact quaternion, scalar first."""
    q = exact(np.asarray(quaternion, dtype=np.float64))
    rows, norm_squared = rotation_numerators((q[k] for k in range(4)), ENGINE)
    return ENGINE.div(stacked([stacked(row) for row in rows], axis=0), norm_squared)


def turned_by(s: IntervalArray) -> IntervalArray:
    """R(1, s) (3, 3) for all s of a box (3,)."""
    rows, norm_squared = rotation_numerators((exact(1.0), s[0], s[1], s[2]), ENGINE)
    unit = IntervalArray(np.full((3, 3), -1.0), np.ones((3, 3)))
    return ENGINE.div(stacked([stacked(row) for row in rows], axis=0), norm_squared).intersect(unit)


def half_vector(matrix: IntervalArray) -> IntervalArray | None:
    """s with R(1, s) in `matrix` (3, 3), for every rotation in it; None where it may be a half-turn."""
    e = ENGINE
    trace = e.sum(matrix[np.arange(3), np.arange(3)], 0)
    divisor = e.add(exact(1.0), trace)
    if not float(divisor.lo) > 0.0:
        return None
    return e.div(e.sub(matrix[_LAST, _NEXT], matrix[_NEXT, _LAST]), divisor)


def enclosed_product(left: IntervalArray, right: IntervalArray) -> IntervalArray:
    """The Hamilton product (4,) x (4,), scalar first."""
    e = ENGINE
    p, q = left[1:], right[1:]
    scalar = e.sub(e.mul(left[0], right[0]), inner(p, q))
    vector = e.add(e.add(e.mul(left[0], q), e.mul(right[0], p)), cross(p, q))
    return joined([scalar.reshape((1,)), vector])


def with_float_coefficients(
    coefficients: IntervalArray, constant: IntervalArray, largest: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Rows `coefficients @ z + constant <= 0`, (m, k) and (m,), as rows of floats that they imply where |z| <= largest.

    c z + d <= 0 with c within r of its midpoint gives mid(c) z + (d - r |z|) <= 0, whatever c and d are exactly.
    """
    e = ENGINE
    lost = e.sum(e.mul(exact(coefficients.rad), exact(largest)), 1)
    return coefficients.mid, e.sub(constant, lost).lo


# ------------------------------------------------------------------------------------------------------------------
# Boxes of poses about a centre.

NAMES = ("W[0]", "W[1]", "W[2]", "s[0]", "s[1]", "s[2]")


@dataclass(frozen=True)
class PoseBox:
    """Poses P, R = R(1, s) R(q0) with P - P0 in `position` (3,) mm and s in `half_turn` (3,), q0 and P0 of `center`."""

    center: Pose
    position: IntervalArray
    half_turn: IntervalArray

    @property
    def unknowns(self) -> Box:
        """A box of (W, s) that holds all of its poses."""
        both = joined([ENGINE.mul(self.position, stretch(self.half_turn)), self.half_turn])
        return Box(NAMES, both.lo, both.hi)

    def with_unknowns(self, box: Box) -> PoseBox:
        """The poses of a box of (W, s), and perhaps more unknowns, about the same centre."""
        s = box.array[3:6]
        return PoseBox(self.center, ENGINE.div(box.array[:3], stretch(s)), s)

    def about(self, center: Pose) -> PoseBox | None:
        """A box that holds all of its poses about another centre; None where a half-turn may lie between."""
        e = ENGINE
        between = enclosed_product(exact(self.center.quaternion), exact(quaternion_conjugate(center.quaternion)))
        turned = enclosed_product(joined([exact([1.0]), self.half_turn]), between)
        if turned.lo[0] <= 0.0 <= turned.hi[0]:
            return None
        shift = e.sub(exact(self.center.position), exact(center.position))
        return PoseBox(center, e.add(self.position, shift), e.div(turned[1:], turned[0]))

    @property
    def middle(self) -> Pose:
        """The pose in its middle, as floats: a unit quaternion to rounding."""
        turn = np.concatenate([[1.0], self.half_turn.mid])
        quaternion = normalised(quaternion_product(turn, self.center.quaternion))
        return Pose(self.center.position + self.position.mid, quaternion)


def stretch(s: IntervalArray) -> IntervalArray:
    """1 + s.s"""
    return ENGINE.add(exact(1.0), ENGINE.sum(ENGINE.sqr(s), -1))


def pose_box(motions: Motions, center: Pose) -> PoseBox | None:
    """The motions as a box about a centre; None where a half-turn may lie between."""
    away = ENGINE.dot(motions.rotation, transposed(rotation(center.quaternion)))
    s = half_vector(away)
    return None if s is None else PoseBox(center, ENGINE.sub(motions.position, exact(center.position)), s)


# ------------------------------------------------------------------------------------------------------------------
# The frames between which a pose stands, and motions as boxes.

_IDENTITY = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True)
class Motions:
    """A box of rigid motions of the target in the camera frame: rotation (3, 3) and position (3,) mm, enclosed."""

    rotation: IntervalArray
    position: IntervalArray


@dataclass(frozen=True, eq=False)
class Frames(ByValue):
    """Exact motions between which the pose stands, of the floats that they are (quaternions divided by |q|^2).

    camera  the base frame seen in the camera frame: `x_camera = P + R x_base`, mm
    target  the target frame seen in the mobile frame: `x_mobile = P + R x_target`, mm

    Raises InputError when one of them is not one motion.
    """

    camera: Pose = _IDENTITY
    target: Pose = _IDENTITY

    def __post_init__(self) -> None:
        problems = []
        for name in ("camera", "target"):
            pose: Pose = getattr(self, name)
            one = Pose(frozen_array(pose.position), frozen_array(pose.quaternion))
            object.__setattr__(self, name, one)
            numbers = np.concatenate([one.position.ravel(), one.quaternion.ravel()])
            if one.position.shape != (3,) or one.quaternion.shape != (4,) or not np.isfinite(numbers).all():
                problems.append(Problem(f"frames {name}", "is not one motion", "give (3,) mm and a quaternion (4,)"))
            elif not one.quaternion.any():
                problems.append(Problem(f"frames {name}", "has the quaternion zero", "give a unit quaternion"))
        if problems:
            raise InputError(problems)

    def in_mobile(self, points: IntervalArray) -> IntervalArray:
        """Points (m, 3) of the target frame in the mobile frame."""
        return ENGINE.add(exact(self.target.position), times(rotation(self.target.quaternion), points))

    def mobile_in_base(self, seen: Motions) -> Motions:
        """What motions of the target in the camera frame mean."""
        e = ENGINE
        back = transposed(rotation(self.camera.quaternion))
        turned = e.dot(e.dot(back, seen.rotation), transposed(rotation(self.target.quaternion)))
        moved = times(back, e.sub(seen.position, exact(self.camera.position)))
        return Motions(turned, e.sub(moved, times(turned, exact(self.target.position))))
