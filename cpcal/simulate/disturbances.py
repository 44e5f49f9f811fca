"""What spoils a simulated study between truth and table: scatter of the robot, shared errors, drift, outliers.

Each takes a study that was simulated and returns one with the disturbance; none of it is known to the calibration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cpcal.common.errors import InputError, Problem
from cpcal.common.values import Floats
from cpcal.robot import (
    Pose,
    PoseTable,
    Study,
    Truth,
    compose,
    normalised,
    pose_jacobian,
    quaternion_product,
    small_rotation,
)
from cpcal.simulate.campaigns import streams


def with_robot_scatter(study: Study, sigma: float, *, seed: int = 0) -> Study:
    """The legs come back to within `sigma` mm only (standard deviation), and camera and sensors both see where to."""
    truth = _truth(study)

    def moved(table: PoseTable, stream: np.random.Generator) -> PoseTable:
        longer = sigma * _by_run(table, stream, table.legs)
        poses = truth.mobile_in_base(table)
        step = np.linalg.solve(pose_jacobian(truth.robot, poses), longer[..., None])[..., 0]
        turned = normalised(quaternion_product(small_rotation(step[:, 3:]), poses.quaternion))
        seen = compose(compose(truth.camera, Pose(poses.position + step[:, :3], turned)), truth.target)
        return replace(table, position=seen.position, quaternion=seen.quaternion, length=table.length + longer)

    return _each(study, moved, seed)


def with_pose_noise(study: Study, root: Floats, *, seed: int = 0) -> Study:
    """The camera's noise in every row grows by `root` z, (6, m) of position (mm) and rotation vector (rad)."""

    def noisier(table: PoseTable, stream: np.random.Generator) -> PoseTable:
        return _shifted(table, stream.standard_normal((len(table), root.shape[1])) @ root.T)

    return _each(study, noisier, seed)


def with_drift(study: Study, size: float, *, leg: int = 1) -> Study:
    """The sensor of a leg (from 1) drifts by `size` mm from the first run to the last, evenly."""

    def drifted(table: PoseTable, _: np.random.Generator) -> PoseTable:
        runs = {name: k for k, name in enumerate(dict.fromkeys(table.run))}
        share = np.array([runs[name] for name in table.run]) / max(len(runs) - 1, 1)
        length = table.length.copy()
        length[:, leg - 1] += size * share
        return replace(table, length=length)

    return _each(study, drifted, 0)


def with_outliers(study: Study, share: float, size: float, *, seed: int = 0) -> Study:
    """A share of the rows has one reading, of a leg or of a position, that is off by `size` mm, up or down."""

    def spoiled(table: PoseTable, stream: np.random.Generator) -> PoseTable:
        position, length = table.position.copy(), table.length.copy()
        for row in np.flatnonzero(stream.random(len(table)) < share):
            column, sign = int(stream.integers(3 + table.legs)), float(stream.choice([-1.0, 1.0]))
            values, k = (position, column) if column < 3 else (length, column - 3)
            values[row, k] += sign * size
        return replace(table, position=position, length=length)

    return _each(study, spoiled, seed)


def _each(study: Study, change: Callable[[PoseTable, np.random.Generator], PoseTable], seed: int) -> Study:
    """Both tables, each with a stream of its own."""
    first, second = streams(seed, 2)
    return replace(study, calibration=change(study.calibration, first), validation=change(study.validation, second))


def _shifted(table: PoseTable, step: Floats) -> PoseTable:
    """Poses moved by step[:, :3] mm and turned by step[:, 3:] rad, in the camera frame."""
    turned = normalised(quaternion_product(small_rotation(step[:, 3:]), table.quaternion))
    return replace(table, position=table.position + step[:, :3], quaternion=turned)


def _by_run(table: PoseTable, stream: np.random.Generator, width: int) -> Floats:
    """Standard normal numbers (N, width), the same for all images of a run."""
    keys = {key: k for k, key in enumerate(dict.fromkeys(zip(table.pose, table.run, strict=True)))}
    draw = stream.standard_normal((len(keys), width))
    return np.asarray(draw[[keys[key] for key in zip(table.pose, table.run, strict=True)]])


def _truth(study: Study) -> Truth:
    if study.truth is None:
        raise InputError([Problem("study", "was measured: its true poses are not known", "give a simulated one")])
    return study.truth
