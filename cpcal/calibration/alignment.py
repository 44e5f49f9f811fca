"""Calibrated joint centres laid on those of the drawing: where the drawing's frame is, and how well that is known.

A robot has no other base frame than its joints, and the drawing says where these are in it. So the frame is that of
the rigid motion that brings the calibrated centres nearest to the drawing's (least squares), and two uncertainties
belong to it. The centres are known to within the calibration's errors: that is how well the frame is known that the
robot's own joints define. And the joints are not where the drawing has them: how far off is told by what the motion
leaves over, with few degrees of freedom; that is how well the drawing's frame can be known, whatever is measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.hand_eye_methods import nearest_rotation
from cpcal.calibration.refine import cross_matrix
from cpcal.common.arrays import Floats
from cpcal.common.errors import InputError, Problem
from cpcal.robot import Pose, quaternion_from_matrix


@dataclass(frozen=True, eq=False)
class Alignment:
    """The frame in which the centres were measured, seen in the drawing's: x_drawing = P + R(q) x_measured.

    motion      position (3,) mm and quaternion
    residual    (n, 3) mm: the drawing's centres less the moved ones
    covariance  (6, 6) of position (mm) and rotation vector (rad, drawing's frame): of the frame that the joints define
    drawing     (6, 6) of the drawing's frame: with the drawing's own errors, estimated from the residuals
    freedom     of the residuals, 3 n - 6
    """

    motion: Pose
    residual: Floats
    covariance: Floats
    drawing: Floats
    freedom: int

    @property
    def sigma(self) -> Floats:
        """(6,) standard deviations, mm and rad, of the frame that the joints define."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def drawing_sigma(self) -> Floats:
        """(6,) standard deviations, mm and rad, of the drawing's frame."""
        return np.sqrt(np.diagonal(self.drawing))

    @property
    def drawing_error(self) -> float:
        """mm: how far a coordinate of a joint centre is off its drawing (standard deviation)."""
        return float(np.sqrt(np.sum(self.residual**2) / self.freedom))

    @property
    def coverage_factor(self) -> float:
        """k for 95 % with so few degrees of freedom (Student)."""
        from scipy import special  # here: it takes a third of a second to load

        return float(special.stdtrit(self.freedom, 0.975))


def aligned(measured: Floats, drawing: Floats, covariance: Floats) -> Alignment:
    """Of centres (n, 3) mm with their covariance (3 n, 3 n) mm^2, centre by centre, and the drawing's (n, 3).

    Raises InputError for fewer than three centres, and for centres on a line.
    """
    count = len(measured)
    middle, drawn = measured.mean(axis=0), drawing.mean(axis=0)
    sizes = np.linalg.svd(drawing - drawn, compute_uv=False) if count > 2 else np.zeros(3)
    if count < 3 or sizes[1] < 1e-9 * sizes[0] or sizes[0] == 0.0:
        what = f"are {count} on a line, or fewer than three: no frame follows from them"
        raise InputError([Problem("joint centres", what, "give three that are not on a line")])
    rotation = nearest_rotation((drawing - drawn).T @ (measured - middle))
    turned = measured @ rotation.T
    position = drawn - rotation @ middle
    residual = drawing - turned - position
    columns = np.concatenate([np.tile(np.eye(3), (count, 1)), -cross_matrix(turned).reshape(-1, 3)], axis=1)
    back = np.linalg.pinv(columns)
    each = np.kron(np.eye(count), rotation)
    own = back @ each @ covariance @ each.T @ back.T
    freedom = 3 * count - 6
    drawn_error = np.sum(residual**2) / freedom if freedom else np.inf
    of_drawing = drawn_error * np.linalg.inv(columns.T @ columns) + own
    return Alignment(Pose(position, quaternion_from_matrix(rotation)), residual, own, of_drawing, freedom)
