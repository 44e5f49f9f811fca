"""What people get wrong when they enter data: one list of hypotheses, one scorer, one sentence.

A hypothesis is a sentence, and what would be `Given` without that mistake. Each is scored by a fit of all legs, near
the drawing: what it leaves, and how far it goes. The best one is named where it explains what nothing else does; a
second one that is as good is named too, and of more none. A name is a likely cause; nothing of it is proved.
"""

import itertools
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cpcal.common.numbers import about
from cpcal.common.values import TINY, Floats, Names, Pair, all_finite, norms
from cpcal.robot.campaign import Campaign, Given, LegEquations
from cpcal.robot.kinematics import (
    KinematicsError,
    Pose,
    central_pose,
    compose,
    cross_matrix,
    forward_poses,
    inverse,
    inverse_kinematics,
    nearest_rotation,
    pose_jacobian,
    quaternion_conjugate,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    rotation_matrix,
    rotation_vector,
    world_hand_eye,
)
from cpcal.robot.units import LENGTHS, NAMES, PROPER, SEQUENCES, TAIT_BRYAN, quaternion_from_euler

# ------------------------------------------------------------------------------------------------------------------
# Poses of other frames than the mobile one in that of the base.

TRACKER = (
    "poses are not of the mobile frame in the base frame, but of a target in a tracker's frame: "
    "`cpcal import --frames tracker` finds both"
)
_LEAST = 5  # rows, of which twelve numbers can be told

Variants = Iterator[tuple[str, Given]]


def other_poses(given: Given) -> Variants:
    """Quaternions in another order, or the way back: of the rotation, or of the whole pose."""
    place, quaternion = given.pose.position, given.pose.quaternion
    for order, steps in (("qx,qy,qz,qw, not qw,qx,qy,qz", 1), ("qw,qx,qy,qz, not qx,qy,qz,qw", -1)):
        yield f"quaternions are in the order {order}", given.posed(place, np.roll(quaternion, steps, axis=1))
    name = "rotations are from base to mobile frame (transposed matrices, conjugate quaternions)"
    yield name, given.posed(place, quaternion_conjugate(quaternion))
    back = inverse(given.pose)  # the same as exchanging the platforms: ||P + R b - a|| = ||-R'P + R'a - b||
    name = "poses are those of the base in the mobile frame (inverse), or the drawing's base and mobile are swapped"
    yield name, given.posed(back.position, back.quaternion)


def other_axes(given: Given) -> Variants:
    """Axes that are exchanged or point the other way: for positions alone, and for both frames."""
    place, quaternion = given.pose.position, given.pose.quaternion
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.array_equal(turn, np.eye(3)):
                continue
            moved = place @ turn.T
            axes = ", ".join(f"{'-' * (sign < 0)}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
            yield f"the columns x, y, z of positions are to be ({axes})", given.posed(moved, quaternion)
            side = np.linalg.det(turn)
            kind = "left-handed" if side < 0 else "of other axes"
            name = f"the poses' frames are {kind}: the drawing's (x, y, z) are their ({axes})"
            turned = np.hstack([quaternion[:, :1], side * quaternion[:, 1:] @ turn.T])
            yield name, given.posed(moved, turned)


def other_frames(given: Given) -> Variants:
    """The poses of a target in a tracker's frame: both frames are fitted to the poses that the readings give."""
    if given.robot.legs < 6:
        return
    try:
        middle = central_pose(given.robot, np.median(given.length, axis=0))
        found, converged = forward_poses(given.robot, given.length, middle)
    except (KinematicsError, np.linalg.LinAlgError):
        return
    rows = np.flatnonzero(converged)
    if len(rows) < max(_LEAST, len(given.length) // 2):
        return
    part = given.rows(rows)
    tracker, target = world_hand_eye(found.rows(rows), part.pose)
    moved = compose(compose(tracker, part.pose), inverse(target))
    yield TRACKER, part.posed(moved.position, moved.quaternion)


# ------------------------------------------------------------------------------------------------------------------
# Readings and joints that stand in the wrong place, or count otherwise than was meant.

_SHIFTS = 3  # rows
_SAME = 0.1  # relative: scales of legs that one kind of sensor makes


def other_readings(given: Given) -> Variants:
    """Whole lengths, another sign, another unit of one leg."""
    if given.robot.offset.any():
        name = "readings are whole leg lengths, to which the offset is added again"
        yield name, given.read(given.length - given.robot.offset)
    yield "readings have the wrong sign", given.read(-given.length)
    every = np.arange(given.robot.legs)
    backwards = np.median(given.nominal - given.robot.offset + given.length, axis=0) - given.length
    for leg in every:
        length = np.where(every == leg, backwards, given.length)
        yield f"the readings of leg {leg + 1} count the other way", given.read(length)
    for leg, (unit, size) in itertools.product(every, LENGTHS.items()):
        if unit != "mm":
            length = np.where(every == leg, float(size) * given.length, given.length)
            yield f"the readings of leg {leg + 1} are in {NAMES[unit]}, not mm", given.read(length)


def shifted_joints(given: Given) -> Variants:
    """The joints of one platform are listed from another leg on, the other way round, or two of them are exchanged."""
    robot = given.robot
    pairs = itertools.combinations(range(robot.legs), 2)
    orders = [np.array([{i: j, j: i}.get(k, k) for k in range(robot.legs)]) for i, j in pairs]
    orders += [np.roll(np.arange(robot.legs), shift) for shift in range(1, robot.legs)]
    orders += [np.roll(np.arange(robot.legs)[::-1], shift) for shift in range(robot.legs)]
    for order in orders:
        if (order != np.arange(robot.legs)).any():
            listed = ", ".join(str(leg + 1) for leg in order)
            name = f"the rows of mobile are in another order than those of base (take rows {listed})"
            yield name, replace(given, robot=replace(robot, mobile=robot.mobile[order]))


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
    nominal = given.nominal
    wanted = nominal - given.robot.offset
    cost = np.median(np.abs(wanted[:, :, None] - given.length[:, None, :]) / nominal[:, :, None], axis=0)
    if not all_finite(cost):
        return
    column = cost.argmin(axis=1)
    if len(set(column.tolist())) < len(column):  # two legs want the same one
        from scipy.optimize import linear_sum_assignment  # here: it takes half a second to load

        _, column = linear_sum_assignment(cost)
    moved = [f"leg {leg + 1} stands in L{int(c) + 1}" for leg, c in enumerate(column) if leg != c]
    if moved:
        name = f"the readings' columns are in another order than the legs: {', '.join(moved)}"
        yield name, given.read(given.length[:, column])


def counts(given: Given) -> Variants:
    """Readings that are proportional to lengths, from any zero: of encoders, or in any unit."""
    wanted = given.nominal - given.robot.offset
    middle = given.length.mean(axis=0)
    centred = given.length - middle
    slope = np.sum(centred * (wanted - wanted.mean(axis=0)), axis=0) / np.sum(centred**2, axis=0)
    scale = float(np.median(slope))
    if not (all_finite(slope) and scale and (np.abs(slope / scale - 1.0) < _SAME).all()):
        return
    start = wanted.mean(axis=0) - slope * middle  # of the lines that take readings to lengths, by least squares
    if abs(abs(scale) - 1.0) > _SAME:  # or it is mm, with another zero or sign
        name = f"readings are not in mm (counts of an encoder?): 1 mm is about {about(1.0 / scale)} of them"
        yield name, given.read(slope * given.length + start)


# ------------------------------------------------------------------------------------------------------------------
# Rotations that were entered in another form than was meant.

_DEGREES = 180.0 / np.pi
_VECTOR = "vector"  # beside the orders of Euler angles
_TAKEN = (*(name.upper() for name in TAIT_BRYAN + PROPER), _VECTOR)  # fixed axes are turned ones backwards
_MEANT = {name: f"Euler angles {name} (or {name[::-1].swapcase()})" for name in SEQUENCES}
_MEANT[_VECTOR] = "rotation vectors"


def other_angles(given: Given) -> Variants:
    """Three angles read in one order of turns, or as a rotation vector, that were written in another.

    Turned axes ZYX are fixed axes xyz with the angles backwards, so each pair has a twin that looks the same.
    """
    for taken in _TAKEN:
        angles = _angles(taken, given.pose.quaternion)
        for meant, said in _MEANT.items():
            for values in (angles, angles[:, ::-1]) if meant == _VECTOR != taken else (angles,):
                if meant != taken:
                    name = f"rotations are {said}, not {_MEANT[taken]}; capitals: turned axes"
                    yield name, _turned(given, meant, values)


def radians_as_degrees(given: Given) -> Variants:
    """Rotations, or one angle of three, that are 57 times too small."""
    name = "rotation angles are in radians, and were taken for degrees"
    for form in _TAKEN:
        angles = _angles(form, given.pose.quaternion)
        for axis in (None, *range(3)) if form != _VECTOR else (None,):
            wrong = np.ones(3, bool) if axis is None else np.arange(3) == axis
            said = name if axis is None else f"{name}: the one about {form[axis].lower()} alone"
            yield said, _turned(given, form, np.where(wrong, _DEGREES * angles, angles))


def degrees_as_radians(given: Given) -> Variants:
    """Angles were wrapped at 2 pi then: row by row, the turns are those nearest to what the readings ask for."""
    # rotations with which the legs at the given positions are as long as the readings say, from none
    pose = Pose(given.pose.position, np.tile([1.0, 0.0, 0.0, 0.0], (len(given.length), 1)))
    for _ in range(_NEWTON):
        gap = given.length - inverse_kinematics(given.robot, pose)
        step = np.einsum("kij,kj->ki", np.linalg.pinv(pose_jacobian(given.robot, pose)[..., 3:], rcond=1e-3), gap)
        pose = pose.moved(np.hstack([np.zeros_like(step), _short(step)]))
    wanted = pose.quaternion
    for form in _TAKEN:
        angles, near = _angles(form, given.pose.quaternion), _angles(form, wanted)
        axis = np.ones(3)
        if form == _VECTOR:
            size = norms(angles)[:, None]
            axis = angles / np.maximum(size, TINY)
            tried, near = size[None], np.sum(axis * near, axis=1, keepdims=True)
        else:
            proper = form[0] == form[2]  # with either of these the same rotation
            other = np.pi * np.array([1.0, not proper, 1.0]) + angles * [1.0, -1.0, 1.0]
            tried = np.stack([angles, other])
        # + 2 pi k, read as degrees, with the whole k that bring them nearest
        tried = (tried + 2.0 * np.pi * np.round((near * _DEGREES - tried) / (2.0 * np.pi))) / _DEGREES
        nearer = np.argmin(np.abs(tried - near).max(axis=2), axis=0)
        name = "rotation angles are in degrees, and were taken for radians"
        yield name, _turned(given, form, tried[nearer, np.arange(len(near))] * axis)


_NEWTON = 12  # steps
_MAX_TURN = 0.5  # rad, of a step


def _short(turn: Floats) -> Floats:
    """Rotation vectors (..., 3) of a length that a step may have."""
    return turn * np.minimum(1.0, _MAX_TURN / np.maximum(norms(turn)[..., None], _MAX_TURN))


def _angles(form: str, quaternion: Floats) -> Floats:
    """(N, 3) rad; in gimbal lock one of the many."""
    from scipy.spatial.transform import Rotation

    if form == _VECTOR:
        return rotation_vector(quaternion)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(Rotation.from_quat(np.roll(quaternion, -1, axis=1)).as_euler(form))  # type: ignore[call-overload]


def _turned(given: Given, form: str, angles: Floats) -> Given:
    """With other rotations, of three angles (N, 3) rad."""
    turn = quaternion_from_rotation_vector(angles) if form == _VECTOR else quaternion_from_euler(form, angles)
    return given.posed(given.pose.position, turn)


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


_TURNS = (other_angles, radians_as_degrees, degrees_as_radians)  # they change rotations alone
# Each with how many numbers it fits, of the whole campaign, and of each row's angles that vary.
MISTAKES: tuple[tuple[Callable[[Given], Variants], int, int], ...] = (
    (units, 0, 0),  # it may come together with another
    (other_poses, 0, 0),
    (other_axes, 0, 0),
    (other_readings, 0, 0),
    (shifted_joints, 0, 0),
    (shifted_rows, 0, 0),
    (other_order, 1, 0),
    (other_angles, 1, 0),
    (radians_as_degrees, 1, 0),
    (degrees_as_radians, 1, 1),
    (counts, 12, 0),
    (other_frames, 12, 0),
)

# ------------------------------------------------------------------------------------------------------------------
# The scorer. All legs are fitted to the readings as they would be without a mistake, near the drawing without it:
#
#     r(x) = ||P + R b - a|| - (L + l) = noise of deviation s            x = drawing + errors of deviation t
#
# s and t are common to all legs, and estimated (MacKay's fixed point), so that the marginal likelihood weighs both
# what a fit leaves and how far it goes. Readings count in units of their own spread: else small units would win.


class Scores(NamedTuple):
    """Of H hypotheses: -2 log likelihood; what fits leave, mm, and by how much drawing and readings disagree, mm
    (robust, of the worst leg); the latter as a share of the robot's size, which is a leg's length, or six times the
    platform's radius where that is less; drawings and fits (H, n, 7), mm."""

    value: Floats
    left: Floats
    off: Floats
    share: Floats
    drawing: Floats
    fitted: Floats


_FLOOR, _FLOOR_DRAWING, _BROAD = 1e-6, 1e-4, 0.02  # of a leg's length: the least s and t, and the first t
_RADII = 6.0  # of the platform: a robot's size where legs are longer
_TAIL = 4.0  # robust deviations from which a residual counts as its logarithm
_NORMAL = 1.482602218505602  # times the median of |r|: the deviation of normal r


def scored(tried: Sequence[Given], steps: int, moves: Floats | None = None) -> Scores:
    """Of hypotheses with the same number of rows and legs; `moves` (12 + n, q) of their drawings are fitted first."""
    arrays = ((one.pose.position, one.pose.quaternion, one.length, one.robot.parameters) for one in tried)
    position, quaternion, length, drawing = (np.stack(each) for each in zip(*arrays, strict=True))
    turn, x, count = rotation_matrix(quaternion), drawing, length[0].size

    def residuals(x: Floats) -> tuple[Floats, Floats, Floats]:
        """(H, N, n), with the legs' directions and lengths."""
        leg = position[:, :, None] + np.einsum("hkij,hnj->hkni", turn, x[..., 3:6]) - x[:, None, :, :3]
        size = np.maximum(norms(leg), TINY)
        return size - length - x[:, None, :, 6], leg / size[..., None], size

    reach = np.median(residuals(x)[2], axis=(1, 2))
    radius = np.sqrt(np.sum(x[..., 3:6].var(axis=1), axis=1))
    error = (_BROAD * reach) ** 2
    noise = 0.01 * error
    for step in range(steps + 1):
        residual, along, size = residuals(x)
        typical = np.maximum(_NORMAL * np.median(np.abs(residual), axis=1), _FLOOR * reach[:, None])[:, None]
        wide = (residual / (_TAIL * typical)) ** 2
        cost = np.sum((_TAIL * typical) ** 2 * np.log1p(wide), axis=(1, 2))
        turned = np.einsum("hkni,hkij->hknj", along, turn)
        rows = np.concatenate([-along, turned, np.full((*size.shape, 1), -1.0)], axis=-1).transpose(0, 2, 1, 3)
        across = (rows / (1.0 + wide).transpose(0, 2, 1)[..., None]).swapaxes(2, 3)
        values, axes = np.linalg.eigh(across @ rows)
        values, into = np.maximum(values, 0.0), axes.swapaxes(2, 3)
        gone = (into @ (drawing - x)[..., None])[..., 0]
        if step:  # what x was found with says how large noise and errors are
            used = np.sum(1.0 - 1.0 / (1.0 + (error / noise)[:, None, None] * values), axis=(1, 2))
            noise = np.maximum(cost / np.maximum(count - used, 1.0), (_FLOOR * reach) ** 2)
            error = np.maximum(np.sum(gone**2, axis=(1, 2)) / np.maximum(used, 1.0), (_FLOOR_DRAWING * reach) ** 2)
        ratio = (error / noise)[:, None, None]
        damped = 1.0 + ratio * values
        if step == steps:
            break
        # J'(r + J (drawing - x)) along the axes
        gap = (into @ (across @ residual.transpose(0, 2, 1)[..., None]))[..., 0] + values * gone
        if moves is not None:
            columns = into @ (_motions(drawing) @ moves)
            matrix = np.einsum("hnip,hni,hniq->hpq", columns, values / damped, columns)
            side = np.einsum("hnip,hni->hp", columns, gap / damped)
            move = -np.einsum("hpq,hq->hp", np.linalg.pinv(matrix, rcond=1e-10, hermitian=True), side) @ moves.T
            before, drawing = drawing, _moved(drawing, move)
            gap = gap + values * (into @ (drawing - before)[..., None])[..., 0]
        x = drawing - (axes @ (ratio * gap / damped)[..., None])[..., 0]
    value = cost / noise + np.sum(gone**2, axis=(1, 2)) / error + np.sum(np.log(damped), axis=(1, 2))
    units = np.sum(np.log(np.maximum(length.std(axis=1), TINY)), axis=1)
    value = value + count * np.log(noise) - 2.0 * len(length[0]) * units
    freedom = np.sqrt(count / np.maximum(count - used, 1.0))
    off, _, size = residuals(drawing)
    off = np.quantile(np.abs(off), 0.8, axis=1).max(axis=1)
    share = off / np.minimum(reach, _RADII * np.maximum(radius, TINY))
    return Scores(value, freedom * typical[:, 0].max(axis=1), off, share, drawing, x)


def _motions(drawing: Floats) -> Floats:
    """(H, n, 7, 12 + n): how parameters change by a shift (mm) and a turn (rad) of the base joints about their centre,
    of the mobile joints, and by each offset."""
    count, legs, _ = drawing.shape
    found = np.zeros((count, legs, 7, 12 + legs))
    for start, column in ((0, 0), (3, 6)):
        arm = drawing[..., start : start + 3] - drawing[..., start : start + 3].mean(axis=1, keepdims=True)
        found[..., start : start + 3, column : column + 3] = np.eye(3)
        found[..., start : start + 3, column + 3 : column + 6] = -cross_matrix(arm)
    found[:, range(legs), 6, range(12, 12 + legs)] = 1.0
    return found


def _moved(drawing: Floats, move: Floats) -> Floats:
    """Drawings (H, n, 7) after the moves (H, 12 + n)."""
    found = drawing.copy()
    for start, column in ((0, 0), (3, 6)):
        joints = drawing[..., start : start + 3]
        middle = joints.mean(axis=1, keepdims=True)
        angle = _short(move[:, column + 3 : column + 6])
        turn = rotation_matrix(quaternion_from_rotation_vector(angle))
        middle = middle + move[:, None, column : column + 3]
        found[..., start : start + 3] = (joints - joints.mean(axis=1, keepdims=True)) @ turn.swapaxes(1, 2) + middle
    found[..., 6] += move[:, 12:]
    return found


# ------------------------------------------------------------------------------------------------------------------
# Which hypothesis is named.

_ROWS = (20, 40)  # of a campaign: to choose some hypotheses by, and to tell these apart
_STEPS = (2, 8)  # of the scorer, likewise
_KEPT, _CHUNK = 8, 64  # hypotheses that are told apart; that are scored at once
_NUMBER = 8.0  # of -2 log likelihood, that a fitted number must gain
_GAIN = 60.0  # of it, from which a mistake is named
_AS_GOOD = 12.0  # of it: what is within is not told apart
_EQUAL = 1e-3  # of it: two names of one change, of which the first counts
_NAMED = 2  # causes
_BETTER = 0.34  # of the residuals, or of the distance from the drawing, that a mistake leaves at most
SHARE = 0.05  # of the robot's size: no drawing is so bad
DISAGREE = 0.01  # of it, from which drawing and readings disagree: calibration is for less


class Cause(NamedTuple):
    """A likely mistake; what fits leave, and how far drawing and readings are apart, with it and without, mm."""

    name: str
    left: Pair
    off: Pair

    @property
    def gain(self) -> str:
        """What falls by how much."""
        what, (before, after) = "Residuals of a fit then fall", self.left
        if after > _BETTER * before:
            what, (before, after) = "The drawing's distance from the readings then falls", self.off
        return f"{what} from {about(before, 2)} mm to {about(after, 2)} mm"


def likely_causes(given: Given, *, doubted: bool = True) -> list[Cause]:
    """The mistake that explains best, and a second one that does as well; none if nothing does, or three do.

    If fits leave what they should (not `doubted`), and the drawing is not far off, frames and offsets alone are tried.
    """
    if len(given.length) < _LEAST:
        return []
    few = _evenly(given, min(_ROWS[1], len(given.length)))
    with np.errstate(all="ignore"):
        if not doubted and few.share(_MOST) <= SHARE:
            return _best(_options(few, []))
        seen, none = scored([few], _STEPS[1]), tuple[object, ...]()
        if seen.share[0] <= SHARE:  # moves of both frames are as good as a tracker's there
            none = (other_frames,) if _turns_explain(few, seen) else (other_frames, *_TURNS)
        turning = int(np.ptp(few.pose.quaternion[:, 1:], axis=0).astype(bool).sum())  # angles that vary
        tried = [
            (name, without, numbers + each * turning * len(few.length))
            for undone, numbers, each in MISTAKES
            if undone not in none
            for name, without in undone(given if undone is shifted_rows else few)
        ]
        options = _options(few, tried)
        found = _best(options)
        if not found and few.share(_MOST) > 2.0 * SHARE:  # a wrong unit and one more mistake?
            plain = [undone for undone, numbers, _ in MISTAKES[1:] if not numbers and undone is not shifted_rows]
            pairs = [
                (f"{first}, and {second}", without, 2)
                for first, scaled in units(few)
                if scaled.share() < _ODD
                for undone in plain
                for second, without in undone(scaled)
            ]
            found = _best(options + _options(few, pairs))
        return found


def _turns_explain(few: Given, seen: Scores) -> bool:
    """Whether fits leave much less where each row may turn as it likes: else no mistake about rotations explains.

    To first order, from the fit of what is given, with its weights; where the drawing is roughly right.
    """
    x, equations = seen.fitted[0], LegEquations(few.pose.position, few.pose.rotation, few.length)
    residual, rows = equations.values(x), equations.by_pose(x)
    weight = 1.0 / np.hypot(1.0, residual / (_TAIL * seen.left[0]))
    turns = weight[..., None] * rows[..., 3:]
    across = (np.eye(few.robot.legs) - turns @ np.linalg.pinv(turns)) * weight[:, None]
    matrix = equations.weighted_by_parameters(across, x).reshape(*residual.shape, -1)
    left = across @ residual[..., None]
    inner = matrix.swapaxes(1, 2)
    left -= matrix @ np.linalg.lstsq((inner @ matrix).sum(axis=0), (inner @ left).sum(axis=0))[0]
    return bool(np.median(np.abs(left)) < _BETTER * np.median(np.abs(residual)))


Tried = list[tuple[str, Given, int]]  # names, what would be given, how many numbers were fitted
# -2 log likelihood, name, and what fits leave, the drawing's distance, and its share
Option = tuple[float, str, Floats]


def _options(few: Given, tried: Tried) -> list[Option]:
    """What is given, and the likeliest of what is tried; these with moved frames and other offsets too.

    Where the drawing is roughly right, a mistake is none that is roughly less likely than what is given.
    """
    tried = [("", few, 0), *((name, _evenly(without, len(few.length)), numbers) for name, without, numbers in tried)]
    parts = [tried[k : k + _CHUNK] for k in range(0, len(tried), _CHUNK)]
    scores = [scored([_evenly(without, _ROWS[0]) for _, without, _ in part], _STEPS[0]) for part in parts]
    values = [value for found in scores for value in found.value.tolist()]
    rough = [value + _NUMBER * numbers for value, (_, _, numbers) in zip(values, tried, strict=True)]
    most = rough[0] if scores[0].share[0] <= SHARE else np.inf
    likeliest = np.argsort(np.round(rough, 3), kind="stable").tolist()
    first = [tried[0], *[tried[k] for k in likeliest if rough[k] < most][:_KEPT]]
    options: list[Option] = []
    for words, moves in ((_offsets_said, None), *_moves(few.robot.legs)):
        chosen = first if moves is None else first[: 1 + _MOVED]
        found = scored([without for _, without, _ in chosen], _STEPS[1], moves)
        for k, (name, without, numbers) in enumerate(chosen):
            value = float(found.value[k]) + _NUMBER * numbers
            seen = np.array([found.left[k], found.off[k], found.share[k]])
            if moves is not None:
                value += _NUMBER * moves.shape[1]
                if not _explains(options[k], value, seen):
                    continue
                said = words(without.robot.parameters, found.drawing[k])
                name = f"{name}, and {said}" if name else said
            options.append((value, name, seen))
    return options


def _best(options: list[Option]) -> list[Cause]:
    """What to name, the first option being what is given."""
    plain, alike = options[0], list[Option]()
    for option in (options[k] for k in np.argsort(np.round([value for value, _, _ in options], 3), kind="stable")):
        if alike and option[0] > alike[0][0] + _AS_GOOD:
            break
        if all(abs(option[0] - other[0]) > _EQUAL and option[1] != other[1] for other in alike):
            alike.append(option)
    if len(alike) > _NAMED or not all(_explains(plain, v, seen) and seen[2] < SHARE for v, _, seen in alike):
        return []
    causes = []
    for value, name, seen in alike:
        same = [n for v, n, _ in options if abs(v - value) <= _EQUAL and ", and " not in n + name and n != name]
        name += f" (or, to the same effect, {same[0]}{' and others' * (len(same) > 1)})" if same and same[0] else ""
        causes.append(Cause(name, *zip(plain[2][:2].tolist(), seen[:2].tolist(), strict=True)))
    return causes


def _explains(before: Option, value: float, seen: Floats) -> bool:
    """Whether what is seen is much smaller, and much more likely, than before."""
    (left, off, share), (left_after, off_after, _) = before[2], seen
    falls = left_after < _BETTER * left or (share > DISAGREE and off_after < _BETTER * off)
    return bool(before[0] - value > _GAIN and falls)


def _evenly(given: Given, count: int) -> Given:
    """So many of its rows."""
    return given.rows(np.linspace(0, len(given.length) - 1, count).astype(np.intp))


_MOST = 0.8  # of the rows, to tell causes by
_ODD = 0.9  # of a leg's length: a unit alone leaves less, where it is one of two mistakes
_MOVED = 3  # hypotheses whose drawings are moved as a whole


def _moves(legs: int) -> Iterator[tuple[Callable[[Floats, Floats], str], Floats]]:
    """What moves of the drawing as a whole are tried, each with its words."""
    every = np.eye(12 + legs)
    for columns in (range(6, 9), range(6, 12), range(3), range(6), range(12)):
        yield _frames_said, every[:, list(columns)]
    yield _offsets_said, every[:, 12:].sum(axis=1, keepdims=True)
    yield _offsets_said, every[:, 12:]


def _frames_said(before: Floats, after: Floats) -> str:
    """Where joints are that were moved as a whole."""
    said = []
    for start, frame, of in ((0, "base", "given in"), (3, "mobile", "those of")):
        old, new = before[:, start : start + 3], after[:, start : start + 3]
        if np.allclose(old, new, rtol=1e-9):
            continue
        turn = nearest_rotation((new - new.mean(axis=0)).T @ (old - old.mean(axis=0)))
        angle = np.degrees(np.linalg.norm(rotation_vector(quaternion_from_matrix(turn))))
        shift = ", ".join(about(float(value), 3) for value in new.mean(axis=0) - turn @ old.mean(axis=0))
        turned = f", turned by {about(angle, 2)} degrees" if angle > _TURNED else ""
        where = f"its origin is at ({shift}) mm of theirs{turned}"
        said.append(f"poses are not {of} the drawing's {frame} frame: {where}")
    return ", and ".join(said)


_TURNED = 1e-6  # degrees


def _offsets_said(before: Floats, after: Floats) -> str:
    lack = after[:, 6] - before[:, 6]
    if np.ptp(lack) <= _FLOOR * np.abs(lack).max():
        return f"an offset is missing or wrong: all legs lack {about(float(lack[0]))} mm"
    return f"an offset is missing or wrong: the legs lack {', '.join(about(float(value)) for value in lack)} mm"


# ------------------------------------------------------------------------------------------------------------------
# What fits leave, beside what the stated deviations let expect.

_FITTED_ROWS = 2_000
_TOLD = 10  # rows, from which it can be told
_UNIFORM = 3.0**0.5  # half-widths that are stated without a factor are those of a uniform distribution
TOO_LARGE, TOO_SMALL = 20.0, 3.0  # of the deviations of residuals from which they are in question


class Spread(NamedTuple):
    """left (n,) mm: deviation of the residuals of each leg's fit (robust); ratio (n,) to what is stated, None where
    readings are called exact or are few; off, share: by how many mm, and how much of the robot's size, drawing and
    readings are apart; fitted (n, 7) mm: robust, near the drawing."""

    left: Floats
    ratio: Floats | None
    off: float
    share: float
    fitted: Floats


def spread_of(campaign: Campaign) -> Spread:
    """Of all legs, fitted near the drawing."""
    campaign = campaign.sampled(_FITTED_ROWS)
    given, count = Given.of(campaign), len(campaign)
    with np.errstate(all="ignore"):
        found = scored([given], _STEPS[1])
        fit = given.drawn(np.nan_to_num(found.fitted[0])).robot
        residual = np.abs(inverse_kinematics(fit, given.pose) - given.length)
        spare, ratio = _NORMAL * np.sqrt(count / max(count - 7, 1)), None
        if not campaign.exact and count >= _TOLD:
            factor = campaign.uncertainty.factor if campaign.uncertainty is not None else None
            radii = np.hstack([campaign.position_radius, campaign.rotation_radius])[:, None]
            square = np.sum((pose_jacobian(fit, given.pose) * radii) ** 2, axis=2) + campaign.length_radius**2
            stated = np.sqrt(square) / (factor or _UNIFORM)
            ratio = spare * np.median(residual / np.maximum(stated, TINY), axis=0)
    left = spare * np.median(residual, axis=0)
    return Spread(left, ratio, float(found.off[0]), float(found.share[0]), fit.parameters)


# ------------------------------------------------------------------------------------------------------------------
# Sentences on what looks wrong. Nothing here is a proof.

TURN = 0.1  # rad: no camera is so bad
_WIDE = 0.05  # of a leg's length: no instrument is so bad
_DOUBTED = 1.0 / _BETTER  # of the stated deviations: from here a mistake can be what the scorer asks for
_ROUGH = 3e-4  # of a leg's length: the same, whatever is stated
_ABSURD = 0.2  # of the robot's size: no drawing is so bad, also where a fit explains all readings


@lru_cache(maxsize=4)  # `certify` warns, and its page says it again
def suspicions(campaign: Campaign) -> Names:
    """A sentence for each thing that looks wrong with the campaign as a whole; none if all is as it should be."""
    mistake, others = doubts(campaign, spread_of(campaign))
    return (*filter(None, [mistake]), *others)


def doubts(campaign: Campaign, seen: Spread) -> tuple[str | None, list[str]]:
    """The sentence on what does not fit, and those on what is stated."""
    mistake, said = mixed_up(campaign, seen), []
    widest = float(campaign.rotation_radius.max())
    if widest > TURN:
        what = f"Some rotation is known to within {widest:.3g} rad only, which is {np.degrees(widest):.0f} degrees"
        said.append(f"{what}: likely cause: degrees are given where radians are meant.")
    size = float(np.median(np.abs(campaign.length + campaign.robot.offset)))
    for name, radius in (("position", campaign.position_radius), ("leg reading", campaign.length_radius)):
        if (wide := float(radius.max())) > _WIDE * size > 0.0:
            what = f"Some {name} is known to within {wide:.3g} mm only, where legs are {size:.3g} mm long"
            said.append(f"{what}: likely cause: a unit other than mm.")
    if said or mistake or seen.ratio is None:
        return mistake, said
    if float(seen.ratio.max()) > TOO_LARGE:
        said.append(f"{_residuals(seen, seen.ratio)}: a convention, a frame or the model is wrong.")
    elif float(seen.ratio.max()) < 1.0 / TOO_SMALL:
        times = about(1.0 / max(float(np.median(seen.ratio)), TINY), 2)
        said.append(f"Your uncertainties are {times} times what the residuals show: state smaller ones.")
    return mistake, said


def mixed_up(campaign: Campaign, seen: Spread) -> str | None:
    """The sentence on drawing, poses and readings that do not fit; small differences need a known cause."""
    given = Given.of(campaign)
    rough = float(seen.left.max()) > _ROUGH * float(np.median(given.nominal))
    doubted = rough if seen.ratio is None else float(seen.ratio.max()) > _DOUBTED
    if not (doubted or rough) and seen.share <= DISAGREE:
        return None
    what = f"The drawing and the readings disagree by {about(seen.off, 2)} mm"
    if seen.ratio is not None and seen.share <= DISAGREE:
        what = _residuals(seen, seen.ratio)
    if causes := likely_causes(given, doubted=doubted or rough):
        listed = "; or just as well: ".join(f"{cause.name}. {cause.gain}" for cause in causes)
        return f"{what}: likely cause: {listed}."
    if seen.share <= SHARE or (seen.share < _ABSURD and not doubted):
        return None
    return f"{what}: check the units (mm), the order of the legs, qw,qx,qy,qz, and the frames."


def _residuals(seen: Spread, ratio: Floats) -> str:
    leg = int(np.argmax(ratio))
    left, times = about(float(seen.left[leg]), 2), about(float(ratio[leg]), 2)
    return f"Residuals of leg {leg + 1} ({left} mm) are {times} times what you state"
