"""The table of mistakes that people make when they enter data, each with what undoes it.

The drawing of a robot is off by manufacturing errors only, so legs are as long as the readings say to within a few
percent. Where they are not, every mistake of the table is undone on trial; the one after which drawing and readings
agree is named. A name is a likely cause; nothing of it is proved.

A mistake is a function of what is `Given` that yields, for each of its variants, a sentence and what would be given
without it. One that chooses or fits numbers to make things agree also fits what is no mistake: it must leave less than
one that does not choose.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from cpcal.common.numbers import about
from cpcal.common.values import Floats
from cpcal.robot.campaign import Campaign, Given
from cpcal.robot.kinematics import (
    KinematicsError,
    central_pose,
    compose,
    forward_poses,
    inverse,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotation_vector,
    world_hand_eye,
)
from cpcal.robot.robot import Robot
from cpcal.robot.units import LENGTHS, NAMES, TAIT_BRYAN, quaternion_from_euler

# ------------------------------------------------------------------------------------------------------------------
# Poses of other frames than the mobile one in that of the base.

TRACKER = (
    "poses are not of the mobile frame in the base frame, but of a target in a tracker's frame: "
    "`cpcal import --frames tracker` finds both"
)
_TRIED_FRAMES = 40  # rows are enough to tell frames
_LEAST = 5  # rows, of which twelve numbers can be told

Variants = Iterator[tuple[str, Given]]


def other_poses(given: Given) -> Variants:
    """Quaternions in another order, or the way back: of the rotation, or of the whole pose."""
    place, quaternion = given.pose.position, given.pose.quaternion
    turned = np.roll(quaternion, 1, axis=1)
    yield "quaternions are in the order qx,qy,qz,qw, not qw,qx,qy,qz", given.posed(place, turned)
    name = "rotations are from base to mobile frame (transposed matrices, conjugate quaternions)"
    yield name, given.posed(place, quaternion_conjugate(quaternion))
    back = inverse(given.pose)  # the same as exchanging the platforms: ||P + R b - a|| = ||-R'P + R'a - b||
    name = "poses are those of the base in the mobile frame (inverse), or the drawing's base and mobile are swapped"
    yield name, given.posed(back.position, back.quaternion)


def other_axes(given: Given) -> Variants:
    """Axes that are exchanged or point the other way: for positions alone, and for both frames."""
    place, rotation = given.pose.position, given.pose.rotation
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.array_equal(turn, np.eye(3)):
                continue
            moved = place @ turn.T
            axes = ", ".join(f"{'-' * (sign < 0)}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
            yield f"the columns x, y, z of positions are to be ({axes})", given.posed(moved, given.pose.quaternion)
            kind = "left-handed" if np.linalg.det(turn) < 0 else "of other axes"
            name = f"the poses' frames are {kind}: the drawing's (x, y, z) are their ({axes})"
            yield name, given.posed(moved, quaternion_from_matrix(turn @ rotation @ turn.T))


def other_frames(given: Given) -> Variants:
    """The poses of a target in a tracker's frame: both frames are fitted to the poses that the readings give."""
    few = given.sampled(_TRIED_FRAMES)
    if given.robot.legs < 6 or len(few.length) < _LEAST:
        return
    try:
        middle = central_pose(few.robot, np.median(few.length, axis=0))
        found, converged = forward_poses(few.robot, few.length, middle)
    except (KinematicsError, np.linalg.LinAlgError):
        return
    rows = np.flatnonzero(converged)
    if len(rows) < max(_LEAST, len(few.length) // 2):
        return
    part = few.rows(rows)
    tracker, target = world_hand_eye(found.rows(rows), part.pose)
    moved = compose(compose(tracker, part.pose), inverse(target))
    yield TRACKER, part.posed(moved.position, moved.quaternion)


# ------------------------------------------------------------------------------------------------------------------
# Readings and joints that stand in the wrong place, or count otherwise than was meant.

_SHIFTS = 3  # rows
_FITTED_LEGS = 6  # rows at least, where numbers are fitted to them
_SAME = 0.1  # relative: scales of legs that one kind of sensor makes


def other_readings(given: Given) -> Variants:
    """Whole lengths, another sign, another unit of one leg."""
    if given.robot.offset.any():
        name = "readings are whole leg lengths, to which the offset is added again"
        yield name, given.read(given.length - given.robot.offset)
    yield "readings have the wrong sign", given.read(-given.length)
    for leg, unit in itertools.product(range(given.robot.legs), LENGTHS):
        if unit != "mm":
            length = given.length.copy()
            length[:, leg] *= float(LENGTHS[unit])
            yield f"the readings of leg {leg + 1} are in {NAMES[unit]}, not mm", given.read(length)


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
    if len(given.length) < _FITTED_LEGS:
        return
    lack = np.median(given.nominal - given.robot.offset - given.length, axis=0)
    listed = ", ".join(about(float(value)) for value in lack)
    name = f"an offset is missing or wrong: the legs lack {listed} mm"
    yield name, given.read(given.length + lack)


def counts(given: Given) -> Variants:
    """Readings that are proportional to lengths, from any zero: of encoders, or in any unit."""
    if len(given.length) < _FITTED_LEGS:
        return
    wanted = given.nominal - given.robot.offset
    middle = given.length.mean(axis=0)
    centred = given.length - middle
    slope = np.sum(centred * (wanted - wanted.mean(axis=0)), axis=0) / np.sum(centred**2, axis=0)
    start = wanted.mean(axis=0) - slope * middle  # of the lines that take readings to lengths, by least squares
    scale = float(np.median(slope))
    other = abs(abs(scale) - 1.0) > _SAME  # or it is mm, with another zero or sign
    if other and np.isfinite(slope).all() and scale and (np.abs(slope / scale - 1.0) < _SAME).all():
        name = f"readings are not in mm (counts of an encoder?): 1 mm is about {about(1.0 / scale)} of them"
        yield name, given.read(slope * given.length + start)


# ------------------------------------------------------------------------------------------------------------------
# Rotations that were entered in another form than was meant.

_DEGREES = 180.0 / np.pi
_TURNS = 7  # whole turns of 2 pi "radians" on either side: angles up to 47 degrees
_TRIED = 5  # rows are enough to tell degrees from radians
_ALL = tuple(s for name in TAIT_BRYAN for s in (name, name.upper()))


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


SHARE = 0.05  # of the leg length: larger nominal residuals are suspicious
_BETTER = 0.34  # a mistake is named when it leaves at most this share of the residuals
_ROWS = 400  # of a campaign suffice to tell
_CLEAR = 0.1  # of the residuals: with so little left no other mistake needs to be tried
_FITTED = 0.02  # what a mistake that fits numbers may leave at most
_EQUAL = 1.0 - 1e-6  # two that differ by rounding are the same: the first one counts


@dataclass(frozen=True)
class Mistake:
    """See the module. What is left is multiplied by `handicap`."""

    undone: Callable[[Given], Variants]
    handicap: float = 1.0
    limit: float = SHARE


def units(given: Given) -> Variants:
    """Lengths in another unit than mm."""
    place, quaternion = given.pose.position, given.pose.quaternion
    for unit, size in LENGTHS.items():
        factor = float(size)
        if factor == 1.0:
            continue
        name, scaled = NAMES[unit], given.posed(factor * place, quaternion)
        yield f"positions are in {name}, not mm", scaled
        yield f"leg readings are in {name}, not mm", given.read(factor * given.length)
        yield f"positions and leg readings are in {name}, not mm", scaled.read(factor * given.length)
        yield f"the drawing is in {name}, not mm", given.drawn(factor * given.robot.parameters)


MISTAKES = (
    Mistake(units),  # it may come together with another
    Mistake(other_poses),
    Mistake(other_axes),
    Mistake(other_readings),
    Mistake(shifted_joints),
    Mistake(shifted_rows),
    Mistake(other_order, 1.5),
    Mistake(euler_order, 1.5),
    Mistake(radians_as_degrees, 1.5),
    Mistake(degrees_as_radians, 4.0, _FITTED),
    Mistake(lost_offset, 8.0, _FITTED),
    Mistake(counts, 8.0, _FITTED),
)
_LAST = (Mistake(other_frames, 8.0, _FITTED),)  # twelve numbers, and slow: tried when nothing else helps


def likely_cause(given: Given) -> str | None:
    """The mistake that, undone, leaves the smallest residuals, if they are small then."""
    few = given.sampled(_ROWS)
    typical = few.most
    with np.errstate(all="ignore"):
        return _best(given, few, MISTAKES, typical) or _pair(few, typical) or _best(given, few, _LAST, typical)


def _best(given: Given, few: Given, mistakes: tuple[Mistake, ...], typical: float) -> str | None:
    best, cause = math.inf, None
    for mistake in mistakes:
        if mistake.limit < SHARE >= typical:
            continue  # what is small can be fitted away, and is what calibration is for
        start = given if mistake.undone is shifted_rows else few  # neighbours must stay together
        for name, without in mistake.undone(start):
            left = without.most
            if left < min(mistake.limit, _BETTER * typical) and left * mistake.handicap < best * _EQUAL:
                best, cause = left * mistake.handicap, name
        if best < min(_FITTED, _CLEAR * typical):
            break  # the table has what is simple first
    return cause


def _pair(given: Given, typical: float) -> str | None:
    """A wrong unit and one more mistake."""
    best, cause = min(SHARE, _BETTER * typical), None
    plain = [mistake.undone for mistake in MISTAKES[1:] if mistake.handicap == 1.0]
    for first, scaled in units(given):
        for second, without in (variant for undone in plain for variant in undone(scaled)):
            left = without.most
            if left < best:
                best, cause = left, f"{first}, and {second}"
    return cause


# ------------------------------------------------------------------------------------------------------------------
# Campaigns that look as if units, orders or frames were mixed up, and the likely cause. Nothing here is a proof.
#
# The nominal robot is off by manufacturing errors only, so its legs should be as long as the readings say to within a
# few percent. Where they are not, `mistakes` looks for the cause.

TURN = 0.1  # rad: no camera is so bad
_NAMED = 3  # measurements in a sentence


def suspicions(campaign: Campaign) -> list[str]:
    """One sentence for each thing that looks wrong, with the likely cause; none for a campaign as it should be."""
    found = []
    given = Given.of(campaign)
    share, typical = given.share, given.typical
    if typical > SHARE:
        found.append(mixed_up(typical, likely_cause(given)))
    elif (rows := np.flatnonzero((share > SHARE).any(axis=1))).size:
        ids = campaign.measurement_ids
        named = ", ".join(ids[row] for row in rows[:_NAMED]) + (" and others" if len(rows) > _NAMED else "")
        worst = _percent(float(share[rows].max()))
        what = f"{len(rows)} of {len(ids)} measurements ({named}) disagree with the drawing by up to {worst} of a leg's"
        found.append(f"{what} length, the others do not: check their rows.")
    return found + sizes_in_question(campaign)


def sizes_in_question(campaign: Campaign) -> list[str]:
    """A sentence for each kind of half-widths that no instrument has."""
    found = []
    widest = float(campaign.rotation_radius.max())
    if widest > TURN:
        what = f"Some rotation is known to within {widest:.3g} rad only, which is {np.degrees(widest):.0f} degrees"
        found.append(f"{what}: likely cause: degrees are given where radians are meant.")
    size = float(np.median(np.abs(campaign.length + campaign.robot.offset)))
    for name, radius in (("position", campaign.position_radius), ("leg reading", campaign.length_radius)):
        if (wide := float(radius.max())) > SHARE * size > 0.0:
            what = f"Some {name} is known to within {wide:.3g} mm only, where legs are {size:.3g} mm long"
            found.append(f"{what}: likely cause: a unit other than mm.")
    return found


def mixed_up(typical: float, cause: str | None) -> str:
    """That drawing and readings disagree, and why, if it is known."""
    what = f"The drawing and the readings disagree by {_percent(typical)} of a leg's length"
    if cause is None:
        return f"{what}: check the units (mm), the order of the legs, the order qw,qx,qy,qz, and the frames."
    return f"{what}: likely cause: {cause}."


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share < 10.0 else f"{share:.3g} times"
