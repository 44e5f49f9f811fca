"""Pose accuracy AP and pose repeatability RP, by the formulas of ISO 9283 (7.2 and 7.3).

A pose is commanded n times. With attained positions p_j, their mean p and the commanded position c, and the same for
the angles a about each axis,

    AP = ||p - c||        l_j = ||p_j - p||        RP = mean(l) + 3 s(l)        AP_a = |a - a_c|        RP_a = 3 s(a)

where s divides by n - 1. What is commanded are leg readings: the commanded pose is where the controller's parameters
put the platform for them. The standard asks for five poses in a cube, 30 cycles, and stated load and speed; a study's
validation has its own poses and cycles, which are named with the figures. Attained poses are the camera's: its noise is
in RP, and in AP by the root of n less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.calibration.statistics import group_means, grouped, mean_rotations
from cpcal.calibration.validation import Forward
from cpcal.common.arrays import Floats
from cpcal.robot import Campaign, Pose, quaternion_conjugate, quaternion_product, rotation_vector

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
