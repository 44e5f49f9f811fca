"""Readings and joints that stand in the wrong place, or count otherwise than was meant: see `mistakes`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cpcal.common.arrays import Floats
from cpcal.common.numbers import about
from cpcal.robot.given import Given
from cpcal.robot.robot import Robot
from cpcal.robot.units import LENGTHS, NAMES

_SHIFTS = 3  # rows
_FITTED = 6  # rows at least, where numbers are fitted to them
_SAME = 0.1  # relative: scales of legs that one kind of sensor makes

Variants = Iterator[tuple[str, Given]]


def whole_lengths(given: Given) -> Variants:
    if given.robot.offset.any():
        name = "readings are whole leg lengths, to which the offset is added again"
        yield name, given.read(given.length - given.robot.offset)


def wrong_sign(given: Given) -> Variants:
    yield "readings have the wrong sign", given.read(-given.length)


def shifted_joints(given: Given) -> Variants:
    """The joints of one platform are listed from another leg on, or the other way round."""
    robot = given.robot
    orders = [np.roll(np.arange(robot.legs), shift) for shift in range(1, robot.legs)]
    orders += [np.roll(np.arange(robot.legs)[::-1], shift) for shift in range(robot.legs)]
    for order in orders:
        if (order != np.arange(robot.legs)).any():
            listed = ", ".join(str(leg + 1) for leg in order)
            moved = Robot(robot.name, robot.base, robot.mobile[order], robot.offset)
            name = f"the rows of mobile are in another order than those of base (take rows {listed})"
            yield name, replace(given, robot=moved)


def inches_in_one_leg(given: Given) -> Variants:
    """One leg's readings in another unit."""
    for leg in range(given.robot.legs):
        for unit, size in LENGTHS.items():
            if unit != "mm":
                length = given.length.copy()
                length[:, leg] *= float(size)
                yield f"the readings of leg {leg + 1} are in {NAMES[unit]}, not mm", given.read(length)


def shifted_rows(given: Given) -> Variants:
    """Readings that stand beside the pose of another row."""
    for shift in range(1, min(_SHIFTS, len(given.length) - 1) + 1):
        rows = f"{shift} row{'s' * (shift > 1)}"
        upper = given.rows(np.arange(len(given.length) - shift))
        lower = given.rows(np.arange(shift, len(given.length)))
        yield f"leg readings stand {rows} below their poses", upper.read(lower.length)
        yield f"leg readings stand {rows} above their poses", lower.read(upper.length)


def other_order(given: Given) -> Variants:
    """The assignment of columns to legs with which most agrees."""
    from scipy.optimize import linear_sum_assignment

    nominal = given.nominal
    wanted = nominal - given.robot.offset
    cost = np.median(np.abs(wanted[:, :, None] - given.length[:, None, :]) / nominal[:, :, None], axis=0)
    if not np.isfinite(cost).all():
        return
    _, column = linear_sum_assignment(cost)
    moved = [f"leg {leg + 1} stands in L{int(c) + 1}" for leg, c in enumerate(column) if leg != c]
    if moved:
        name = f"the readings' columns are in another order than the legs: {', '.join(moved)}"
        yield name, given.read(given.length[:, column])


def lost_offset(given: Given) -> Variants:
    """Every leg lacks a constant of its own."""
    if len(given.length) < _FITTED:
        return
    lack = np.median(given.nominal - given.robot.offset - given.length, axis=0)
    listed = ", ".join(about(float(value)) for value in lack)
    name = f"an offset is missing or wrong: the legs lack {listed} mm"
    yield name, given.read(given.length + lack)


def counts(given: Given) -> Variants:
    """Readings that are proportional to lengths, from any zero: of encoders, or in any unit."""
    if len(given.length) < _FITTED:
        return
    wanted = given.nominal - given.robot.offset
    slope, start = _lines(given.length, wanted)
    scale = float(np.median(slope))
    other = abs(abs(scale) - 1.0) > _SAME  # or it is mm, with another zero or sign
    if other and np.isfinite(slope).all() and scale and (np.abs(slope / scale - 1.0) < _SAME).all():
        name = f"readings are not in mm (counts of an encoder?): 1 mm is about {about(1.0 / scale)} of them"
        yield name, given.read(slope * given.length + start)


def _lines(length: Floats, wanted: Floats) -> tuple[Floats, Floats]:
    """Slope and start (n,) of the lines that take the readings to the lengths wanted, by least squares."""
    middle, target = length.mean(axis=0), wanted.mean(axis=0)
    centred = length - middle
    slope = np.sum(centred * (wanted - target), axis=0) / np.sum(centred**2, axis=0)
    return slope, target - slope * middle
