"""The classical answer: a closed form from the poses of single images, then least squares on all pixels.

Where the study says how far the robot's poses may be off, they are weighed too (`weighted_fit`): least squares on
pixels alone gives way to every robot error, for the pixels are finer. All of this is ordinary estimation: nothing is
proved.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cpcal.checker.frames import GIVEN, unit
from cpcal.common.errors import InputError, unusable
from cpcal.common.least_squares import Blocks, Fit, least_squares
from cpcal.common.numbers import nearest
from cpcal.common.values import Floats, norms
from cpcal.models.hand_eye import HandEyeFrames, HandEyeStudy, Setup, read_poses
from cpcal.robot import Pose, inverse, quaternion_from_matrix, quaternion_from_rotation_vector, rotation_matrix
from cpcal.robot.kinematics import LEAST_SPREAD, axis_text, cross_matrix, nearest_rotation, world_hand_eye
from cpcal.solver.linear import Dense, LinearStatus
from cpcal.vision.opencv import MissingExtraError, opencv

# ------------------------------------------------------------------------------------------------------------------
# Residuals in pixels of frames and of readings of the robot's poses, and their derivatives.
#
# A reading of pose i is (position + d, R(1, w / 2) R), with d in mm and w in rad within its half-widths, in the base
# frame. All points of an image have the same reading, so six unknowns an image say all that a robot error does; exact
# poses have none.

PARAMETERS = 12  # rotation vector of E (rad, camera frame), its translation, then those of F (frame of its values)
READING = 6  # unknowns of a reading: d and w
_NOWHERE = np.zeros(3)


class ReadFrames(NamedTuple):
    """Frames, and a reading (d, w) of each image's pose: (n, 6) mm and rad."""

    frames: HandEyeFrames
    readings: Floats


def places(frames: HandEyeFrames) -> tuple[Floats, Floats]:
    """Position and tilt of camera and target (8,), mm and degrees, and their derivatives (8, 12) by the motions of the
    frames."""
    back, slope = frames.e_rotation.T, np.zeros((8, PARAMETERS))
    (camera, slope[3, :3]), (target, slope[7, 6:9]) = map(_tilt, (frames.e_rotation, frames.f_rotation))
    slope[:3, :6] = -back @ np.hstack([cross_matrix(frames.e_translation), np.eye(3)])
    slope[4:7, 9:] = np.eye(3)
    return np.concatenate([-back @ frames.e_translation, [camera], frames.f_translation, [target]]), slope


def _tilt(turn: Floats) -> tuple[float, Floats]:
    """Degrees between the z axes of a frame and of the one that it is turned in, and the derivative (3,) by a turn; of
    axes that are the same by one about x."""
    sine = float(np.hypot(turn[0, 2], turn[1, 2]))
    axis = np.array([-turn[1, 2], turn[0, 2], 0.0]) / sine if sine else np.eye(3)[0]
    return float(np.degrees(np.arctan2(sine, turn[2, 2]))), np.degrees(axis)


def _tilted(turn: Floats, tilt: float) -> Floats:
    """The rotation nearest to one with that tilt."""
    now, slope = _tilt(turn)
    return _turned(np.radians(np.radians(tilt - now) * slope), turn)


def _turned(by: Floats, turn: Floats) -> Floats:
    """A rotation turned further, by a rotation vector."""
    return rotation_matrix(quaternion_from_rotation_vector(by)) @ turn


class PixelModel:
    """The residuals (2 N,) of frames with readings, first all along u and then all along v, in `size` unknowns."""

    def __init__(self, study: HandEyeStudy) -> None:
        self.study, self._rays, self.given = study, study.rays, study.given
        self._images = len(study.images) if study.uncertain else 0  # whose readings are unknown
        self.size = PARAMETERS + READING * self._images

    def stated(self, frames: HandEyeFrames) -> ReadFrames:
        """Frames at the stated poses."""
        return ReadFrames(frames, np.zeros((len(self.study.images), READING)))

    def __call__(self, at: ReadFrames) -> Floats:
        """(2 N,) px; infinite where a point is not in front of the camera."""
        camera, x = self.study.camera, self.in_camera(at)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = camera.center + camera.focal * x[:, :2] / x[:, 2:]
        return (np.where(x[:, 2:] > 0.0, seen, np.inf) - self._rays).T.ravel()

    def in_camera(self, at: ReadFrames) -> Floats:
        """x_ij (N, 3), mm."""
        return np.asarray(self._placed(at)[2] + at.frames.e_translation)

    def _placed(self, at: ReadFrames) -> tuple[Floats, Floats, Floats]:
        """Of each point the rotation of H_i; R_F p; and R_E H_i F p."""
        turn, shift = (part[self.study.image] for part in self.study.motions(at.readings))
        turned = self.study.points @ at.frames.f_rotation.T
        moved = np.einsum("nij,nj->ni", turn, turned + at.frames.f_translation) + shift
        return turn, turned, moved @ at.frames.e_rotation.T

    def blocks(self, at: ReadFrames) -> tuple[Floats, Floats]:
        """Derivatives (2 N, 12) by the motions of the frames, and (2 N, 6) by those of each point's own reading."""
        turn, turned, on = self._placed(at)
        frames, x = at.frames, on + at.frames.e_translation
        own = frames.e_rotation @ turn  # (N, 3, 3) of what is on the target's side of the pose
        by = [-cross_matrix(on), np.broadcast_to(np.eye(3), own.shape), -own @ cross_matrix(turned), own]
        if self._images:
            on_hand = turned + frames.f_translation
            if self.study.setup == "eye-to-hand":
                lever = np.einsum("nij,nj->ni", turn, on_hand)
                by += [np.broadcast_to(frames.e_rotation, own.shape), -frames.e_rotation @ cross_matrix(lever)]
            else:
                place = read_poses(self.study.poses, at.readings).position[self.study.image]
                by += [-own, own @ cross_matrix(on_hand - place)]
            # R(1, w / 2) turns by (I + [w / 2]x) dw / (1 + |w / 2|^2) when w changes by dw
            half = 0.5 * at.readings[:, 3:]
            turning = (np.eye(3) + cross_matrix(half)) / (1.0 + np.sum(half**2, axis=1))[:, None, None]
            by[-1] = by[-1] @ turning[self.study.image]
        camera, every, depth = self.study.camera, np.concatenate(by, axis=2), x[:, 2:]
        rows = [camera.focal[a] * (every[:, a] - x[:, a, None] / depth * every[:, 2]) / depth for a in (0, 1)]
        slope = np.concatenate(rows)
        return slope[:, :PARAMETERS], slope[:, PARAMETERS:]

    def jacobian(self, at: ReadFrames) -> Floats:
        """(2 N, size): frames first, then the readings image by image."""
        frames, own = self.blocks(at)
        whole = np.zeros((len(own), self.size))
        whole[:, :PARAMETERS] = frames
        place = PARAMETERS + READING * np.tile(self.study.image, 2)
        for k in range(own.shape[1]):
            whole[np.arange(len(own)), place + k] = own[:, k]
        return whole

    def moved(self, at: ReadFrames, step: Floats) -> ReadFrames:
        """By a step (size,): rotations turn by a vector; readings are kept within their half-widths, positions and
        tilts where they are known."""
        old, readings, width = at.frames, at.readings, self.study.pose_half_width
        frames = HandEyeFrames(
            _turned(step[:3], old.e_rotation),
            old.e_translation + step[3:6],
            _turned(step[6:9], old.f_rotation),
            old.f_translation + step[9:12],
        )
        if self._images:
            readings = np.clip(readings + step[PARAMETERS:].reshape(-1, READING), -width, width)
        if self.study.known:
            (*camera, leaning), (*target, tilt) = np.split(np.clip(places(frames)[0], *self.given), 2)
            turn = _tilted(frames.e_rotation, leaning)
            frames = HandEyeFrames(turn, -turn @ camera, _tilted(frames.f_rotation, tilt), np.array(target))
        return ReadFrames(frames, readings)

    def free(self, at: ReadFrames, arm: Floats = _NOWHERE) -> Floats:
        """(12, m): steps of the frames that do not move positions and tilts whose ends are equal, orthonormal where E
        turns about the place from which its own is off by the `arm`, mm."""
        turning = np.eye(PARAMETERS)
        turning[3:6, :3] = -cross_matrix(arm)
        fixed = places(at.frames)[1][self.given[0] == self.given[1]] @ turning
        return np.asarray(turning @ np.linalg.svd(fixed)[2][len(fixed) :].T)

    def reach(self, at: ReadFrames) -> Floats:
        """What counts as a step of one in each unknown: a turn of 1 rad, and the way that it moves a point."""
        way = float(norms(self.in_camera(at)).mean())
        frames, readings = (np.repeat(pair, 3) for pair in ([1.0, way], [way, 1.0]))
        return np.concatenate([np.tile(frames, 2), np.tile(readings, self._images)])

    def room(self, at: ReadFrames) -> tuple[Floats, Floats]:
        """Least and greatest step (size,) that the half-widths leave."""
        width, readings = self.study.pose_half_width[: self._images], at.readings[: self._images]
        free = np.full(PARAMETERS, np.inf)
        return np.append(-free, -width - readings), np.append(free, width - readings)


# ------------------------------------------------------------------------------------------------------------------
# Least squares where the robot's poses have errors too: pixels and poses weighted by their deviations.
#
#     sum |pixel residual|^2 / sigma^2 + sum (reading / its deviation)^2
#
# over the frames and a reading of each pose. A pose's half-width h on an axis counts as the deviation h / sqrt(3) of a
# uniform error; the pixels' deviation is what the poses of single images, which no robot error touches, leave. The
# readings are eliminated image by image, so the cost grows with the number of images only.

_LEAST_GAIN = 1e-9  # of the deviation of a reading that is taken as exact, against dividing by zero


def _weighted_fit(
    model: PixelModel, start: ReadFrames, pixel: float, deviation: Floats
) -> tuple[ReadFrames, Floats, Floats]:
    """Frames and readings from a start, the covariance (12, 12) of the frames, and the variances (n, 6) of readings.
    Positions and tilts whose ends are equal are held.

    `pixel`: deviation in px, `deviation`: of readings (n, 6), mm and rad.
    """
    study = model.study
    image = np.tile(study.image, 2)

    def residual(at: ReadFrames) -> Floats:
        return np.concatenate([model(at) / pixel, (at.readings / deviation).ravel()])

    def of_images(rows: Floats) -> Floats:
        """Sums (v, ...) of rows (2 N, ...) over those of each image."""
        out = np.zeros((len(study.images), *rows.shape[1:]))
        np.add.at(out, image, rows)
        return out

    def blocks(at: ReadFrames) -> Blocks:
        by_frames, own = (block / pixel for block in model.blocks(at))
        by_frames = by_frames @ model.free(at)
        off = model(at) / pixel
        alone = of_images(own[:, :, None] * own[:, None, :]) + np.eye(READING) / deviation[:, None] ** 2
        side = -of_images(own * off[:, None]) - at.readings / deviation**2
        mixed = of_images(own[:, :, None] * by_frames[:, None, :])
        return Blocks(by_frames.T @ by_frames, -by_frames.T @ off, mixed, alone, side)

    def moved(at: ReadFrames, step: Floats) -> ReadFrames:
        free = model.free(at)
        frames, readings = np.split(step, [free.shape[1]])
        return model.moved(at, np.append(free @ frames, readings))

    at = least_squares(residual, blocks, start, tolerance=1e-12, moved=moved, steps=_STEPS).at
    found, free = blocks(at), model.free(at)
    covariance = _inverse(found.reduced()[0])
    inverse_ = np.linalg.inv(found.own)
    carried = inverse_ @ found.mixed
    variance = inverse_ + carried @ covariance @ np.swapaxes(carried, 1, 2)
    return at, free @ covariance @ free.T, np.diagonal(variance, axis1=1, axis2=2)


_STEPS = 100
_LEAST_POINTS = 6
_LEAST_IMAGES = 3
_ANGLES = 12  # about an axis that all poses turn about, where the closed form leaves the angle open
_LOST = 1e-14  # of the scaled normal matrix: an eigenvalue that rounding leaves of nothing
_WEAK, _OPEN = 10.0, 1e4  # times worse than across, to say so; mm
_LEAST_PIXEL = 1e-6  # px, where single images fit without error
_CONTRADICTS = 3.0  # standard deviations, in the sum of squares, that given values add
_BEYOND = 1e-9  # mm, degrees: what rounding leaves beyond the ends of what is known
_APART = 2.0  # how many times more all images together leave than single ones, where the robot's poses matter


class ClassicalAnswer(NamedTuple):
    """Least squares on pixels.

    frames      E and F
    readings    (n, 6) of the poses, mm and rad, see `cpcal.models.hand_eye`; 0 for poses taken as exact
    residuals   (N, 2) px, undistorted, at these readings
    covariance  (12, 12) by linearisation, errors of pixels independent and as large as the residuals: rotation vector
                of E (rad, camera frame), its translation (mm), then those of F
    rms         px per axis
    remarks     what makes it doubtful, in sentences
    alone       the poses of single images that it began with
    """

    frames: HandEyeFrames
    readings: Floats
    residuals: Floats
    covariance: Floats
    rms: float
    remarks: tuple[str, ...]
    alone: "ImagePoses"


def classical_answer(study: HandEyeStudy) -> ClassicalAnswer:
    """E and F of the study by a closed form and least squares.

    Raises InputError for fewer than three images with six points each, for images without a pose, and for a hand that
    does not turn. A direction that the motions hardly determine, as where all turn about one axis, is a remark.
    """
    kept, seen, alone = single = image_poses(study)
    if len(kept) < _LEAST_IMAGES:
        what = f"has points that determine a pose in {len(kept)} of its images"
        raise unusable("study", what, f"give at least {_LEAST_IMAGES} with {_LEAST_POINTS} points each")
    turn, shift = study.motions()
    if np.ptp(turn[kept], axis=0).max() < LEAST_SPREAD:
        raise unusable("poses", "do not turn: nothing tells the camera's place", "add images with the hand turned")
    hand, model = Pose(shift[kept], quaternion_from_matrix(turn[kept])), PixelModel(study)
    starts = []
    for angle in np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False).tolist():
        camera, f = world_hand_eye(hand, seen, angle)
        e = inverse(camera)
        starts.append(model.stated(HandEyeFrames(e.rotation, e.position, f.rotation, f.position)))
    at = min(starts, key=lambda at: float(np.sum(model(at) ** 2)))
    if not np.isfinite(model(at)).all():
        what = "puts points behind the camera"
        raise unusable("the closed form", what, "check the setup, and which pose belongs to which image")
    at, covariance = _fitted(replace(study, known=()), at, alone)
    rms = float(np.sqrt(np.mean(model(at) ** 2)))
    remarks = _weak_directions(study.setup, at.frames, covariance)
    if not study.uncertain and _LEAST_PIXEL < alone < rms / _APART:
        remarks.append(
            f"Single images fit to {nearest(alone, 2)} px rms, all together to {nearest(rms, 2)} px: the robot's poses "
            "are off by more than the pixels. cpcal handeye certify --off estimated takes that into account."
        )
    free = dict(zip(GIVEN, places(at.frames)[0].tolist(), strict=True))
    at, covariance = _within_given(study, at, covariance, alone)
    residuals = model(at)
    with_given = float(np.sqrt(np.mean(residuals**2)))
    if with_given**2 > max(rms, _LEAST_PIXEL) ** 2 * (1.0 + _CONTRADICTS**2 / len(residuals)):
        others = ", ".join(f"{name} at {nearest(free[name], 4)} {unit(name)}" for name, *_ in study.known)
        remarks.append(
            "The data contradict the given values: least squares fits to "
            f"{nearest(with_given, 3)} px rms with them, to {nearest(rms, 3)} px without, with {others}."
        )
    return ClassicalAnswer(*at, residuals.reshape(2, -1).T, covariance, with_given, tuple(remarks), single)


def _within_given(study: HandEyeStudy, at: ReadFrames, covariance: Floats, alone: float) -> tuple[ReadFrames, Floats]:
    """Least squares again, from its answer, with positions and tilts that lie beyond what is known held at its nearer
    ends while the data press them there; each is let go once at most."""
    (low, high), names, model = study.given, list(GIVEN), PixelModel(study)
    ends, released = dict[int, float](), set[int]()
    while True:
        place, slope = places(at.frames)
        nearer, residuals = np.clip(place, low, high), model(at)
        beyond = {k: float(nearer[k]) for k in range(len(names)) if k not in ends and abs(place - nearer)[k] > _BEYOND}
        # by how much the squares would fall, to first order, on the way to the other end
        rising = np.linalg.lstsq(slope[[*ends]].T, model.blocks(at)[0].T @ residuals)[0]
        falls = {k: up * (2.0 * end - low[k] - high[k]) for (k, end), up in zip(ends.items(), rising, strict=True)}
        most = max(falls.keys() - released, key=falls.__getitem__, default=None)
        if beyond:
            ends |= beyond
        elif most is not None and falls[most] > _STILL * float(residuals @ residuals):
            released.add(most)
            del ends[most]
        else:
            return at, covariance
        part = replace(study, known=tuple((names[k], end, end) for k, end in ends.items()))
        at, covariance = _fitted(part, PixelModel(part).moved(at, np.zeros(model.size)), alone)


def _fitted(study: HandEyeStudy, start: ReadFrames, alone: float) -> tuple[ReadFrames, Floats]:
    """Least squares near a start, and the covariance (12, 12) of its frames; positions and tilts whose ends are equal
    are held. `alone`: px per axis, what the poses of single images leave."""
    exact, model = PixelModel(study.exactly()), PixelModel(study)
    if not np.isfinite(model(start)).all():
        raise unusable("the given values", "put points behind the camera", "check them, and the setup")

    # E turns about the points' mean place. About the camera's centre a turn moves far points by much, which the
    # translation has to take back: the steps follow a bent valley, and end in it where the hand hardly turns.
    def arm(at: ReadFrames) -> Floats:
        return np.asarray(at.frames.e_translation - exact.in_camera(at).mean(axis=0))

    def jacobian(at: ReadFrames) -> Floats:
        return exact.jacobian(at) @ exact.free(at, arm(at))

    def moved(at: ReadFrames, step: Floats) -> ReadFrames:
        step, before = exact.free(at, arm(at)) @ step, arm(at)
        after = _turned(step[:3], before)
        step[3:6] += after - before - np.cross(step[:3], before)  # what a turn does beyond first order
        return exact.moved(at, step)

    at = least_squares(exact, jacobian, start, tolerance=1e-13, moved=moved, steps=_STEPS).at
    if study.uncertain:
        deviation = np.maximum(study.pose_half_width, _LEAST_GAIN) / np.sqrt(3.0)
        return _weighted_fit(model, at, max(alone, _LEAST_PIXEL), deviation)[:2]
    residuals, free = exact(at), exact.free(at)
    slope = exact.jacobian(at) @ free
    variance = float(residuals @ residuals) / max(len(residuals) - PARAMETERS, 1)
    return at, variance * free @ _inverse(slope.T @ slope) @ free.T


_ROUNDS, _STILL = 50, 1e-3  # of deviations that are estimated, and what they may change by in the last one
_MORE = 1.25  # times the largest reading, or the uniform error


def estimated_half_widths(study: HandEyeStudy) -> tuple[float, float]:
    """mm and rad: how far the poses have to be off on an axis, at most, so that the pixels of all images fit as those
    of single images do. Half-widths that the study states are passed over.

    Deviations, one of positions and one of turns, are those of readings that are fitted with them (expectation and
    maximization: what the fit leaves open of a reading counts too). Then a quarter more than the largest reading, and
    than a uniform error with that deviation has. It is an estimate: what is proved with it holds if no pose is off by
    more.

    Raises InputError as `classical_answer` does.
    """
    count, spread, start = len(study.images), np.array([1.0, 1e-3]), classical_answer(study.exactly())
    model = PixelModel(replace(study, pose_half_width=np.full((count, READING), np.inf)))  # readings go anywhere
    at, pixel = model.stated(start.frames), max(start.alone.rms, _LEAST_PIXEL)
    for _ in range(_ROUNDS):
        deviation, before = np.tile(np.repeat(spread, 3), (count, 1)), spread
        at, _, variance = _weighted_fit(model, at, pixel, deviation)
        squares = (at.readings**2 + variance).reshape(count, 2, 3)
        spread = np.maximum(np.sqrt(squares.mean(axis=(0, 2))), _LEAST_GAIN)
        if np.allclose(spread, before, rtol=_STILL):
            break
    largest = np.abs(at.readings.reshape(count, 2, 3)).max(axis=(0, 2))
    position, turn = (_MORE * np.maximum(largest, np.sqrt(3.0) * spread)).tolist()
    return position, turn


class ImagePoses(NamedTuple):
    """Images whose points determine a pose, the target's pose in the camera frame in each, and the deviation of the
    pixels that these leave, px per axis: no robot error enters."""

    images: list[int]
    seen: Pose
    rms: float


def image_poses(study: HandEyeStudy) -> ImagePoses:
    """Of the images one by one."""
    kept, fits, free, exact = [], [], 0, replace(study.exactly(), known=())
    for k, count in enumerate(np.bincount(study.image, minlength=len(study.images)).tolist()):
        if count < _LEAST_POINTS:
            continue
        try:
            fits.append(_pose(exact.part(np.array([k]))))
        except np.linalg.LinAlgError:
            continue
        kept.append(k)
        free += 2 * count - 6
    frames = [fit.at.frames for fit in fits]
    turns = np.array([one.e_rotation for one in frames]).reshape(-1, 3, 3)
    seen = Pose(np.array([one.e_translation for one in frames]).reshape(-1, 3), quaternion_from_matrix(turns))
    return ImagePoses(kept, seen, float(np.sqrt(sum(fit.cost for fit in fits) / max(free, 1))))


_OF_HAND, _OF_BOTH = ("Tsai", "Park", "Horaud", "Andreff", "Daniilidis"), ("Shah", "Li")


def opencv_answers(study: HandEyeStudy, alone: ImagePoses) -> dict[str, Pose]:
    """The camera in the hand (eye in hand) or base frame by each of OpenCV's methods, from the poses of single images.

    None without OpenCV, with its version 5.0, which has no such methods, and where one finds no rotation.
    """
    try:
        cv2 = opencv()
    except MissingExtraError:
        return {}
    if not hasattr(cv2, "calibrateHandEye"):
        return {}
    seen, base, found = alone.seen, study.poses.rows(np.array(alone.images)), dict[str, Pose]()
    if study.setup == "eye-in-hand":  # to OpenCV the camera is always on the hand
        base = inverse(base)
    hand, board = inverse(base), (seen.rotation, seen.position)
    for name in (*_OF_HAND, *_OF_BOTH):
        of_hand = name in _OF_HAND
        method = getattr(cv2, f"CALIB_{'' if of_hand else 'ROBOT_WORLD_'}HAND_EYE_{name.upper()}")
        try:
            if of_hand:
                turn, place = cv2.calibrateHandEye(hand.rotation, hand.position, *board, method=method)
            else:
                turn, place = cv2.calibrateRobotWorldHandEye(*board, base.rotation, base.position, method=method)[2:]
        except cv2.error:
            continue
        if np.isfinite(turn).all() and np.isfinite(place).all():
            pose = Pose(place.ravel(), quaternion_from_matrix(turn))
            found[name] = pose if of_hand else inverse(pose)
    return found


def _pose(study: HandEyeStudy) -> Fit[ReadFrames]:
    """Of the only image of a study, as its E where H and F do nothing: by the direct linear transform (of a plane z = 0
    without its third column), then least squares."""
    points = study.points
    middle, directions = points.mean(axis=0), (study.rays - study.camera.center) / study.camera.focal
    size, plane = float(np.abs(points - middle).max()), not points[:, 2].any()
    p = np.column_stack([(points - middle)[:, : 2 if plane else 3] / size, np.ones(len(points))])
    width = p.shape[1]
    rows = np.zeros((len(p), 2, 3 * width))
    for a in (0, 1):
        rows[:, a, width * a : width * (a + 1)] = p
        rows[:, a, 2 * width :] = -directions[:, a : a + 1] * p
    h = np.linalg.svd(np.linalg.qr(rows.reshape(-1, 3 * width), mode="r"))[2][-1].reshape(3, width)
    h = h * np.sign(np.mean(p @ h[2]))
    axes = h[:, :-1]
    if plane:
        across = np.cross(h[:, 0], h[:, 1])
        axes = np.column_stack([axes, across / max(np.sqrt(np.linalg.norm(across)), _LEAST_GAIN)])
    scale = np.cbrt(abs(np.linalg.det(axes)))
    if not scale > _LEAST_GAIN:
        raise np.linalg.LinAlgError("points of a line, or a plane in the line of sight")
    turn = nearest_rotation(axes)
    origin = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
    model = PixelModel(replace(study, setup="eye-to-hand", poses=origin))
    shift = h[:, -1] * size / scale - turn @ middle
    start = model.stated(HandEyeFrames(turn, shift, np.eye(3), np.zeros(3)))
    return least_squares(
        model, lambda at: model.blocks(at)[0][:, :6], start, tolerance=1e-12,
        moved=lambda at, step: model.moved(at, np.append(step, np.zeros(6))),
    )  # fmt: skip


def _inverse(normal: Floats) -> Floats:
    """Of a normal matrix: what it leaves open is very large in it, and not 0."""
    scale = np.sqrt(np.diagonal(normal))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, _LOST)) @ vectors.T / np.outer(scale, scale))


def _weak_directions(setup: Setup, frames: HandEyeFrames, covariance: Floats) -> list[str]:
    """Where camera and target are known far worse along a direction than across it, with figures."""
    slope = places(frames)[1]
    hand, base = ("hand", "base") if setup == "eye-in-hand" else ("base", "hand")
    said = []
    for name, frame, by in (("camera", hand, slope[:3]), ("target", base, slope[4:7])):
        squares, axes = np.linalg.eigh(by @ covariance @ by.T)
        across, along = np.sqrt(np.maximum(squares[1:], 0.0)).tolist()
        if along > _WEAK * across:
            far = f"to {nearest(along, 2)} mm" if along < _OPEN else "not at all"
            said.append(
                f"The motions of the hand determine the place of the {name} along ({axis_text(axes[:, 2], 2)}) of the "
                f"{frame} frame {far}, across it to {nearest(across, 2)} mm (one standard deviation, by least squares)."
            )
    return said


# ------------------------------------------------------------------------------------------------------------------
# The frames whose largest residual is least, near given ones: linear programs in a trust region, in float64.
#
# With readings of the robot's poses these are unknowns of the programs too. It gives the upper end of the bracket;
# that a point satisfies every pixel is proved elsewhere.

_PROGRAMS = 60
_TRUSTED = 0.05  # rad: the trust region of rotations; that of translations is as far as it moves a point
_SHORTEST = 1e-13
_RESTARTS = 3
_MANY = 150  # unknowns, from which on a program is nearly all zeros: each image has readings of its own


def minimax_fit(model: PixelModel, at: ReadFrames, *, restarts: int = _RESTARTS) -> tuple[ReadFrames, float]:
    """Frames near those given, and their largest excess `|residual| - half-width` in px.

    The search begins again with a wide trust region until that finds nothing better: one that stops early leaves the
    bracket open.
    """
    best, value = _descent(model, at, _TRUSTED)
    for attempt in range(restarts):
        again, lower = _descent(model, best, _TRUSTED * 0.2**attempt)
        if value - lower <= 1e-12 * value:
            break
        best, value = again, lower
    return best, value


def excess(model: PixelModel, at: ReadFrames) -> float:
    """px: by how much the worst pixel is off beyond its half-width; from 0."""
    off = np.abs(model(at)) - np.tile(model.study.half_width, 2)
    return max(float(off.max()), 0.0)


def _descent(model: PixelModel, at: ReadFrames, radius: float) -> tuple[ReadFrames, float]:
    value, size = excess(model, at), model.reach(at)
    for _ in range(_PROGRAMS):
        step, promised = _step(model, at, size * radius, value)
        if promised >= value * (1.0 - 1e-11):
            break
        trial = model.moved(at, step)
        found = excess(model, trial)
        if found < value:
            good = (value - found) > 0.5 * (value - promised)
            at, value, radius = trial, found, radius * (2.0 if good else 0.5)
        else:
            radius *= 0.25
        if radius < _SHORTEST:
            break
    return at, value


def _step(model: PixelModel, at: ReadFrames, reach: Floats, worst: float) -> tuple[Floats, float]:
    """The step of the linear program within the trust region, and the excess that it promises."""
    slope, residuals = model.jacobian(at) * reach, model(at)
    width = np.tile(model.study.half_width, 2)
    scale = max(worst, 1e-9)
    matrix = np.pad(np.concatenate([slope, -slope]) / scale, ((0, 0), (0, 1)), constant_values=-1.0)
    rhs = np.concatenate([width - residuals, width + residuals]) / scale
    if model.study.known:
        (place, by), (least, most) = places(at.frames), model.given
        room = np.concatenate([most - place, place - least])
        known = np.isfinite(room)
        limits = np.concatenate([by, -by])[known] * reach[:PARAMETERS]
        matrix = np.concatenate([matrix, np.pad(limits, ((0, 0), (0, matrix.shape[1] - PARAMETERS)))])
        rhs = np.append(rhs, room[known])
    size = np.abs(matrix).max(axis=1)
    low, high = (np.clip(end / reach, -1.0, 1.0) for end in model.room(at))
    low, high, cost = np.append(low, 0.0), np.append(high, 2.0), np.append(np.zeros(model.size), 1.0)
    matrix, rhs = matrix / size[:, None], rhs / size
    if model.size <= _MANY:
        found: Any = Dense(matrix, rhs, low, high).minimize(cost)
        point, good = found.point, found.status is LinearStatus.OPTIMAL
    else:  # by HiGHS, which passes over zeros; a little outside of the bounds or rows does no harm here
        from scipy.optimize import linprog  # when it is needed
        from scipy.sparse import csr_array

        rows: Any = csr_array(matrix)
        bounds = list(zip(low.tolist(), high.tolist(), strict=True))
        found = linprog(cost, rows, rhs, bounds=bounds, method="highs")
        point, good = found.x, found.status == 0
    return (reach * point[: model.size], scale * float(point[-1])) if good else (np.zeros(model.size), worst)


# ------------------------------------------------------------------------------------------------------------------
# What a certified answer begins with: the best frames of all images or of some, and about what errors these leave.

FEWEST = 4  # images of a group
_TRIALS = 30  # of random images that the fit starts from


_STARTS, _SCATTER = 16, (0.3, 0.1, 1.0, 0.2)  # other places that the fit begins at; how far off, in turn, of `reach`


def best_frames(
    study: HandEyeStudy, classical: ClassicalAnswer, random: np.random.Generator | None = None
) -> ReadFrames:
    """The frames of the least largest error that local fits find, and the readings of uncertain poses.

    The first begins at the classical answer. Of exact poses others begin at `random` places around the best so far:
    real data have several minima, often side by side, and at one that is not the least no bracket closes.
    """
    model = PixelModel(study)
    best, value = minimax_fit(model, ReadFrames(classical.frames, classical.readings))
    scattered = () if random is None or study.uncertain else random.normal(size=(_STARTS, model.size))
    for k, away in enumerate(scattered):
        at = model.moved(best, away * model.reach(best) * _SCATTER[k % len(_SCATTER)])
        if np.isfinite(excess(model, at)):
            found, lower = minimax_fit(model, at, restarts=0)
            if lower < value:
                best, value = minimax_fit(model, found)
    return best


def stated_readings(study: HandEyeStudy, kept: Sequence[int], values: Floats) -> tuple[tuple[float, ...], ...]:
    """Image by image, the stated poses of those that are left out; none of exact poses."""
    readings = np.zeros((len(study.images), 6))
    readings[kept] = values
    return tuple(map(tuple, readings.tolist())) if study.uncertain else ()


def least_errors(study: HandEyeStudy, images: Sequence[int], best: ReadFrames) -> list[tuple[float, int]]:
    """About the least error in px that the pixels of each image allow with any pose of the target, found near `best`,
    and its number."""
    there, found = study.exactly(best.readings), []
    for k in images:
        model = PixelModel(there.part(np.array([k])))
        found.append((minimax_fit(model, model.stated(best.frames), restarts=1)[1], k))
    return found


def least_error(study: HandEyeStudy, images: Sequence[int]) -> float:
    """About the least error of some images: where a fit ends, px."""
    part = study.part(np.array(images))
    return excess(PixelModel(part), best_frames(part, classical_answer(part)))


def trimmed_fit(study: HandEyeStudy, outliers: int, random: np.random.Generator) -> list[int]:
    """The `outliers` images that least squares over all others fits worst, in the best of fits from random images.

    Each fit is repeated with the images that fit best, until they stay the same.
    """
    count = len(study.images)
    best = None
    for trial in range(_TRIALS):
        chosen = np.arange(count) if not trial else np.sort(random.choice(count, FEWEST, replace=False))
        for _ in range(10):
            try:
                frames = classical_answer(study.part(chosen)).frames
            except InputError:
                break
            model = PixelModel(study)
            each = (model(model.stated(frames)) ** 2).reshape(2, -1).sum(axis=0)
            number = np.bincount(study.image, minlength=count)
            squares = np.bincount(study.image, weights=each, minlength=count) / np.maximum(number, 1)  # the mean
            order = np.argsort(squares, kind="stable")
            kept = np.sort(order[: count - outliers])
            value = float(squares[kept].sum())
            if np.isfinite(value) and (best is None or value < best[0] * (1.0 - 1e-9)):
                best = value, sorted(order[count - outliers :].tolist())
            if np.array_equal(kept, chosen):
                break
            chosen = kept
    if best is None:
        raise unusable("study", "has no images that determine the frames", "check poses and points")
    return best[1]
