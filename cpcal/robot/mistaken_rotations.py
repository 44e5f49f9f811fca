"""Rotations that were entered in another form than was meant: see `mistakes`."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.robot.given import Given
from cpcal.robot.rotation import quaternion_conjugate, quaternion_from_rotation_vector, rotation_vector
from cpcal.robot.rotation_form import TAIT_BRYAN, quaternion_from_euler

_DEGREES = 180.0 / np.pi
_TURNS = 7  # whole turns of 2 pi "radians" on either side: angles up to 47 degrees
_TRIED = 5  # rows are enough to tell degrees from radians
_ALL = tuple(s for name in TAIT_BRYAN for s in (name, name.upper()))

Variants = Iterator[tuple[str, Given]]


def scalar_last(given: Given) -> Variants:
    turned = np.roll(given.pose.quaternion, 1, axis=1)
    yield "quaternions are in the order qx,qy,qz,qw, not qw,qx,qy,qz", given.posed(given.pose.position, turned)


def transposed(given: Given) -> Variants:
    turned = quaternion_conjugate(given.pose.quaternion)
    name = "rotations are from base to mobile frame (transposed matrices, conjugate quaternions)"
    yield name, given.posed(given.pose.position, turned)


def euler_order(given: Given) -> Variants:
    """Three angles read in one order of turns that were written in another.

    Turned axes ZYX are fixed axes xyz with the angles backwards, so each pair has a twin that looks the same.
    """
    place = given.pose.position
    for taken in (name.upper() for name in TAIT_BRYAN):
        angles = _angles(taken, given.pose.quaternion)
        for meant in _ALL:
            if meant != taken:
                twins = f"(or {meant[::-1].swapcase()}, not {taken[::-1].swapcase()}; capitals: turned axes)"
                turned = quaternion_from_euler(meant, angles)
                yield f"Euler angles are {meant}, not {taken} {twins}", given.posed(place, turned)


def radians_as_degrees(given: Given) -> Variants:
    """Rotations that are 57 times too small."""
    place, name = given.pose.position, "rotation angles are in radians, and were taken for degrees"
    vector = rotation_vector(given.pose.quaternion)
    yield name, given.posed(place, quaternion_from_rotation_vector(_DEGREES * vector))
    for sequence in _ALL:
        angles = _angles(sequence, given.pose.quaternion)
        yield name, given.posed(place, quaternion_from_euler(sequence, _DEGREES * angles))


def degrees_as_radians(given: Given) -> Variants:
    """Angles were wrapped at 2 pi then: row by row, the turns are chosen with which the readings agree best."""
    few = given.sampled(_TRIED)
    name = "rotation angles are in degrees, and were taken for radians"
    vector = rotation_vector(few.pose.quaternion)
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    axis = vector / np.maximum(angle, np.finfo(np.float64).tiny)
    turns = 2.0 * np.pi * np.arange(-2 * _TURNS, 2 * _TURNS + 1)
    yield name, _chosen(few, quaternion_from_rotation_vector((angle + turns)[..., None] * axis[:, None] / _DEGREES))
    steps = 2.0 * np.pi * np.array(list(itertools.product(range(-_TURNS, _TURNS + 1), repeat=3)))
    for sequence in _ALL:
        angles = _angles(sequence, few.pose.quaternion)
        both = [angles, np.array([np.pi, np.pi, np.pi]) + angles * [1.0, -1.0, 1.0]]  # the same rotation
        rows = np.concatenate([each[:, None] + steps for each in both], axis=1) / _DEGREES
        quaternion = quaternion_from_euler(sequence, rows.reshape(-1, 3))
        yield name, _chosen(few, quaternion.reshape(*rows.shape[:2], 4))


def _chosen(given: Given, quaternion: Floats) -> Given:
    """Row by row, that of the rotations (N, m, 4) with which the legs agree best."""
    count, many = quaternion.shape[:2]
    row = np.repeat(np.arange(count), many)
    trial = given.rows(row)
    share = trial.posed(trial.pose.position, quaternion.reshape(-1, 4)).share.max(axis=1).reshape(count, many)
    return given.posed(given.pose.position, quaternion[np.arange(count), np.argmin(share, axis=1)])


def _angles(sequence: str, quaternion: Floats) -> Floats:
    """(N, 3) rad; in gimbal lock one of the many."""
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(Rotation.from_quat(np.roll(quaternion, -1, axis=1)).as_euler(sequence))  # type: ignore[call-overload]
