"""Poses that are proved: a box of (P, s) that holds exactly one solution of the six leg equations.

The robot's parameters and the readings are taken as the exact numbers that their floats are. With q the quaternion of
an approximate pose, also taken as exact, a pose is written as

    P  and  R = R(1, s) R(q)          R(1, s) v = v + 2 (s x v + s x (s x v)) / (1 + s.s)

in six unknowns: every rotation but the half-turns from R(q) is one s. The equations are ||P + R b - a||^2 = (L + l)^2,
which are those of the legs where L + l > 0; the interval Newton test of cpcal.solver.existence does the proof.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.robot.kinematics import Pose, rotation_numerators
from cpcal.robot.robot import Robot
from cpcal.solver.existence import UniquenessProver
from cpcal.solver.interval import Arithmetic, Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, Expr, sqr
from cpcal.solver.network.expression import as_expr

LEGS = 6  # as many equations as unknowns: what the Newton test needs


@dataclass(frozen=True, eq=False)
class ProvedPose:
    """PROVED: exactly one pose `P`, `R(1, s) R(quaternion)` with (P, s) in `box` gives all legs their lengths.

    box         of `P[0]`, `P[1]`, `P[2]` in mm and `s[0]`, `s[1]`, `s[2]`; 2 s is the rotation vector from
                R(quaternion) up to a relative error of angle^2 / 12
    region      a larger box around it, which holds no other one
    quaternion  (4,), the exact numbers that the floats are; its norm need not be 1 to the last bit
    """

    box: Box
    region: Box
    quaternion: Floats

    @property
    def pose(self) -> Pose:
        """The pose at the middle of the box; floating point."""
        middle = self.box.mid
        w, r, s = self.quaternion[0], self.quaternion[1:], middle[3:]
        turned = np.concatenate([[w - s @ r], r + w * s + np.cross(s, r)])
        return Pose(middle[:3], turned / np.linalg.norm(turned))

    @property
    def position_radius(self) -> Floats:
        """(3,) mm: the box's half-widths."""
        return self.box.rad[:3]

    @property
    def rotation_radius(self) -> Floats:
        """(3,) rad: half-widths of 2 s."""
        return 2.0 * self.box.rad[3:]


def prove_pose(
    robot: Robot, readings: npt.ArrayLike, near: Pose, *, arithmetic: Arithmetic | None = None
) -> ProvedPose | None:
    """The one pose at (or next to) the pose `near` that has the six readings (6,) in mm; None: nothing was proved.

    `near` comes from `forward_kinematics`. None says that Newton's method leads nowhere from there, or that the
    platform is singular or nearly so at the pose: then there may be none, two, or infinitely many.

    Raises InputError for another number of legs than six, and for readings that are not six finite numbers with
    L + l > 0 for every leg.
    """
    length = _checked(robot, readings, near)
    quaternion = np.array(near.quaternion, dtype=np.float64)
    net = pose_network(robot, length, quaternion)
    start = np.concatenate([near.position, np.zeros(3)])
    found = UniquenessProver(net, arithmetic or get_arithmetic("float64")).prove(Box(net.names, start, start))
    return None if found is None else ProvedPose(found.box, found.region, quaternion)


def pose_network(robot: Robot, readings: Floats, quaternion: Floats) -> ConstraintNetwork:
    """The equations ||P + R(1, s) R(q) b - a||^2 = (L + l)^2 in the unknowns P (mm) and s, one for each leg."""
    net = ConstraintNetwork()
    position, s = net.variable("P", 3), net.variable("s", 3)
    arm = _turned(net.constant(quaternion), robot.mobile)
    once = _cross(s[None, :], arm)
    turned = arm + 2.0 * (once + _cross(s[None, :], once)) / (1.0 + sqr(s).sum())
    vector = position[None, :] + turned - net.constant(robot.base)
    net.add(sqr(vector).sum(-1) - sqr(net.constant(readings) + robot.offset) == 0.0)
    return net


def _turned(q: Expr, points: Floats) -> Expr:
    """R(q) b, rational and so enclosed, for points (n, 3)."""
    rows, norm_squared = rotation_numerators(q[k] for k in range(4))
    axes = np.eye(3)
    turned = sum(rows[i][j] * np.outer(points[:, j], axes[i]) for i in range(3) for j in range(3))
    return as_expr(turned / norm_squared)


def _cross(x: Expr, y: Expr | Floats) -> Expr:
    """Cross product of rows, (1, 3) or (n, 3)."""
    forth, back = [1, 2, 0], [2, 0, 1]
    return x[:, forth] * y[:, back] - x[:, back] * y[:, forth]


def _checked(robot: Robot, readings: npt.ArrayLike, near: Pose) -> Floats:
    length = np.asarray(readings, dtype=np.float64)
    if robot.legs != LEGS or length.shape != (LEGS,):
        what = f"are {length.shape} for {robot.legs} legs"
        raise InputError([Problem("readings", what, "prove one pose at a time, of a robot with exactly six legs")])
    numbers = np.concatenate([np.ravel(near.position), np.ravel(near.quaternion)])
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or not np.any(near.quaternion):
        raise InputError([Problem("near", "is not one pose", "give a position (3,) and a quaternion (4,), not zero")])
    # a sum of floats is rounded to the nearest, and so has the sign of the exact one
    wrong = np.flatnonzero(~(np.isfinite(length) & (length + robot.offset > 0.0)))
    if len(wrong):
        what = "does not have a finite length above 0"
        raise InputError([Problem(f"leg {k + 1}", what, "check its reading and its offset, in mm") for k in wrong])
    return length
