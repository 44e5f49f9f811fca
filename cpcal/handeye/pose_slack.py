"""What uncertain robot poses add to a row, over a box of frames.

With D = ||d|| and T = ||r|| of a pose's half-widths, a reading H' of the pose moves a point y = H F p by at most

    T ||F p|| + D                      eye to hand: y = R F p + position
    T (||F p - position|| + D) + D     eye in hand: y = R^T (F p - position)

for ||R(1, s) - I|| <= 2 |s| <= T. The row of a pixel is f x_a - w x_3 with |w| <= |u_a - c_a| + eps + half-width, and x
turns with y: its value moves by at most ||(f, w)|| times that. F p is bounded over the box of t_F.
"""

from __future__ import annotations

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.handeye.frame_equations import T_F
from cpcal.handeye.hand_eye_study import HandEyeStudy
from cpcal.solver.interval import Box

_UP = 1.0 + 1e-9  # more than some dozen float64 operations on numbers that are not negative round away


def pose_slack(study: HandEyeStudy, eps: float, box: Box) -> Floats:
    """(2, N): what the rows along u and v of each point may exceed zero by, rounded up; 0 for exact poses."""
    moved = point_motion(study, box)[study.image]
    off = np.abs(study.rays - study.camera.center)
    steep = np.hypot(study.camera.focal, off + (eps + study.half_width)[:, None])
    return np.asarray((steep * moved[:, None] * _UP).T)


def point_motion(study: HandEyeStudy, box: Box) -> Floats:
    """(n,) mm: how far a reading of each pose moves any point of the target, at most, for frames in the box."""
    shift = np.linalg.norm(study.pose_half_width[:, :3], axis=1)
    turn = np.linalg.norm(study.pose_half_width[:, 3:], axis=1)
    lo, hi = box.lo[list(T_F)], box.hi[list(T_F)]
    origin = np.zeros_like(study.poses.position) if study.setup == "eye-to-hand" else study.poses.position
    arm = np.linalg.norm(np.maximum(np.abs(lo - origin), np.abs(hi - origin)), axis=1)
    arm = (arm + np.linalg.norm(study.points, axis=1).max()) * _UP
    if study.setup == "eye-in-hand":
        arm = arm + shift
    return np.asarray((turn * arm + shift) * _UP)
