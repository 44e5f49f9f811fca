"""Guaranteed pose sets: all poses that show the dots of a target within stated boxes of pixels, enclosed by proof.

What is assumed of the image: for each dot i listed the projection of its centre, or, with `PixelBoxes.of_images`, the
centre of its image as it is measured, lies in the box `lo_i <= pixel <= hi_i`; dots are in the field of view and at
least 40 of their radii in front of the camera. What is assumed of camera and target: their numbers are in stated sets
(`CameraSet`, `TargetSet`), or are the floats given. No distribution is assumed; that the true numbers are in these sets
is stated, not proved. The pose set is

    { (P, R) : for some camera and some target of these sets, for every i, the pixel of dot i is in box i }

and with `outliers` = q the larger set of poses for which this holds for all dots but at most q of them. `enclose_pose`
gives a box that is proved to hold the set, wherever it is: rotation and position are not restricted beforehand, but for
a distance of one kilometre.

The rows of a dot are the checker's (`cpcal.checker.sight`). Some dots bound the pose from all that there are, all dots
then from there: about the rotation found, and with the bias of images' centres bounded over the poses that are left.
"""

import hashlib
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction as F
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from cpcal.checker import FORMAT, Refused
from cpcal.checker.readers import Json, up
from cpcal.checker.rule import Box
from cpcal.checker.sight import POSE_SET_FORMAT, Part, Rows, Sight, digest_of, joined, rows_of, sight_of
from cpcal.common.errors import refuse, unusable
from cpcal.common.files import StrPath, write_file
from cpcal.common.values import (
    ArrayLike,
    Floats,
    Indices,
    Names,
    Places,
    Value,
    all_finite,
    fill,
    floats,
    freeze,
    frozen_array,
    norms,
)
from cpcal.robot import Pose, normalised, quaternion_from_matrix, quaternion_product
from cpcal.robot.kinematics import nearest_rotation
from cpcal.solver.certificate.exact_network import number
from cpcal.solver.certificate.prover import Contracted, Descent, System, line, write_steps
from cpcal.solver.contract import Verdict
from cpcal.solver.interval import IntervalArray
from cpcal.vision.batch.detect import ImageFolder
from cpcal.vision.camera import BROWN, CAMERA_NUMBERS, Camera
from cpcal.vision.measure import REFUSED, measure_pose, reason_of
from cpcal.vision.target import Target

LARGEST_SCALE = 0.1  # of a plate's error, as a share
SUFFIX = ".pose.json"
_COUNT = len(CAMERA_NUMBERS)

# ------------------------------------------------------------------------------------------------------------------
# What is assumed: where the dots are in the image, what is known of camera and target, the frames.


@dataclass(frozen=True, eq=False)
class PixelBoxes:
    """Where dots of a target are in an image.

    numbers  (m,) of the dots in the target, each once
    lo, hi   (m, 2) pixels: the projection of dot `numbers[i]` is stated to lie in lo[i] <= pixel <= hi[i]
    of_images  then it is the centre (the centroid of the area) of the dot's image that lies there, as it is measured:
             by how much it differs from the projection is bounded by proof

    Raises InputError when the arrays make no boxes.
    """

    numbers: Indices
    lo: Floats
    hi: Floats
    of_images: bool = False

    def __post_init__(self) -> None:
        numbers = np.array(self.numbers, np.intp)
        numbers.setflags(write=False)
        fill(self, numbers=numbers, lo=frozen_array(self.lo), hi=frozen_array(self.hi))
        if numbers.ndim != 1 or {self.lo.shape, self.hi.shape} != {(len(numbers), 2)}:
            what = f"have shapes {numbers.shape}, {self.lo.shape} and {self.hi.shape}"
            raise unusable("pixel boxes", what, "give numbers (m,), lo (m, 2) and hi (m, 2)")
        good = ((self.lo <= self.hi) & np.isfinite(self.lo) & np.isfinite(self.hi)).all(axis=1)
        twice, none = len(np.unique(numbers)) < len(numbers), "has no points, or infinitely many"
        refuse(
            *((True, f"pixel box {k}", none, "give finite lo <= hi") for k in np.flatnonzero(~good)),
            (twice, "pixel boxes", "name a dot twice", "give one box for each dot"),
        )

    @classmethod
    def around(
        cls, numbers: ArrayLike, centers: ArrayLike, half_width: ArrayLike, *, of_images: bool = False
    ) -> "PixelBoxes":
        """`center +- half_width`, pixels: centers (m, 2), half_width a number, (2,), (m, 1) or (m, 2), >= 0."""
        middle = floats(centers)
        try:
            radius = np.broadcast_to(floats(half_width), middle.shape)
        except ValueError:
            what = f"is {np.shape(half_width)} for centres {middle.shape}"
            raise unusable("half_width", what, "give one number, or one for each coordinate") from None
        if not bool((radius >= 0.0).all()):
            raise unusable("half_width", "is negative or NaN", "give pixels >= 0")
        boxes = IntervalArray.around(middle, radius)
        return cls(np.asarray(numbers, np.intp), boxes.lo, boxes.hi, of_images)


@dataclass(frozen=True, eq=False)
class CameraSet(Value):
    """Cameras whose numbers fx, fy, cx, cy, k1, k2, p1, p2, k3 are those of `camera` plus `spread @ t`, |t| <= 1.

    spread  (9, k), in each number's unit; k = 0: this camera alone

    Raises InputError for another lens model, or a spread that is none.
    """

    camera: Camera
    spread: Floats = field(default_factory=lambda: np.zeros((_COUNT, 0)))

    def __post_init__(self) -> None:
        freeze(self, "spread")
        model, spread = self.camera.model, self.spread
        other = f"pose sets are proved for the model {BROWN}: calibrate with it"
        wrong = spread.ndim != 2 or len(spread) != _COUNT or not all_finite(spread)
        what = f"has the shape {spread.shape}, or a number that is not finite"
        refuse(
            (model != BROWN, "camera", f"has a lens of the model {model}", other),
            (wrong, "camera spread", what, f"give (9, k), of {', '.join(CAMERA_NUMBERS)}"),
        )
        if not (self.camera.focal > norms(self.spread[:2])).all():
            raise unusable("camera spread", "allows a focal length of zero", "give a narrower set")

    @classmethod
    def ellipsoid(cls, camera: Camera, covariance: Floats, factor: float) -> "CameraSet":
        """All numbers whose Mahalanobis distance from the camera's is at most `factor`: (9, 9) covariance.

        A factor of 5 holds the truth of a calibration with honest covariance in 99.7 % of all cases (chi-square, nine
        degrees of freedom: 5.0 is the root of 25.3). Raises InputError.
        """
        matrix = floats(covariance)
        if matrix.shape != (_COUNT, _COUNT) or not all_finite(matrix) or not 0.0 < factor < np.inf:
            remedy = "give (9, 9), as `cpcal image camera IMAGES` writes it, and a factor > 0"
            raise unusable("camera covariance", f"has the shape {matrix.shape}, factor {factor}", remedy)
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
        safe = np.where(scale > 0.0, scale, 1.0)
        values, vectors = np.linalg.eigh(matrix / np.outer(safe, safe))
        held = values > 1e-12 * values[-1]
        return cls(camera, factor * safe[:, None] * vectors[:, held] * np.sqrt(values[held]))


@dataclass(frozen=True, eq=False)
class TargetSet(Value):
    """Targets whose dots are within `half_widths` of their places: one number, or (3,) mm along x, y and z of the
    target.

    scale  the plate as a whole, dots' radius included, is 1 + tau times such a one, |tau| <= scale: as a print shrinks

    Raises InputError for half-widths or a scale that are none.
    """

    target: Target
    half_widths: ArrayLike = 0.0
    scale: float = 0.0

    def __post_init__(self) -> None:
        widths = floats(self.half_widths)
        if widths.shape not in ((), (3,)) or not (np.isfinite(widths) & (widths >= 0.0)).all():
            raise unusable("target half-widths", f"are {self.half_widths}", "give one number or (3,), mm >= 0")
        if not 0.0 <= self.scale <= LARGEST_SCALE:
            what = f"is {self.scale}"
            raise unusable("target scale", what, f"give a share from 0 to {LARGEST_SCALE}")
        fill(self, half_widths=frozen_array(widths * np.ones(3)))


# ------------------------------------------------------------------------------------------------------------------
# The directions that count: a disc on which the lens does not turn back, whatever camera of the set it is.

_MARGIN = 0.03  # of the field beyond the image's corners, as a share of their distance from the axis
_RAYS, _STEPS = 97, 400
_WIDEST = 4.0  # tangent of the largest angle to the axis
_TURNS = 0.01  # determinant of the distortion's derivative, 1 on the axis, at which a lens is said to turn back
_LEAST = 0.02  # of the lens's slopes on the disc
_NARROWER = 0.95  # disc, until they are that large and the bias of images' centres is bounded
_SMALLEST = 20


def _sight(
    boxes: PixelBoxes, targets: TargetSet, cameras: CameraSet, name: str, sources: Mapping[str, bytes]
) -> tuple[Json, Sight]:
    """All that is assumed, as a claim states it and as the checker reads it. `sources`: the bytes of the files that the
    numbers came from, by name. Raises InputError."""
    target, radius = targets.target, _field_radius(cameras)
    rays = cameras.camera.normalised(0.5 * (boxes.lo + boxes.hi))
    inputs = {
        "name": name,
        "files": [
            {"name": key, "sha256": hashlib.sha256(content).hexdigest()} for key, content in sorted(sources.items())
        ],
        "pixels": {
            "of": "images" if boxes.of_images else "centers",
            "numbers": boxes.numbers.tolist(),
            "lo": _hex(boxes.lo),
            "hi": _hex(boxes.hi),
            "rays": _hex(np.nan_to_num(rays)),
        },
        "camera": {"numbers": _hex(cameras.camera.numbers), "spread": _hex(cameras.spread), "field": _hex(radius)},
        "target": {
            "radius": _hex(target.radius),
            "dots": _hex(target.dots[boxes.numbers]),
            "half_widths": [_hex(targets.half_widths)] * len(boxes.numbers),
            "scale": _hex(targets.scale),
        },
    }
    for _ in range(_SMALLEST):
        sight = sight_of(inputs)
        try:
            if sight.cameras.least.lo >= _LEAST * 2.0**160 and (not boxes.of_images or sight.cameras.field_bias):
                break
        except Refused:
            pass
        radius *= _NARROWER
        inputs["camera"]["field"] = _hex(radius)  # type: ignore[index]
    else:
        what = "has a lens that bends too much within the image"
        raise unusable("camera", what, "pose sets need a lens whose image does not turn back")
    what, remedy = "shows nothing of the camera's field of view", "give pixels inside the image of this camera"
    beside = np.flatnonzero(~(np.hypot(rays[:, 0], rays[:, 1]) < radius))
    refuse(*((True, f"pixel box {k}", what, remedy) for k in beside))
    return inputs, sight


@lru_cache(maxsize=16)
def _field_radius(cameras: CameraSet) -> float:
    """What the image shows and a little more, but no more than where the lens turns back."""
    camera = cameras.camera
    radius = np.linspace(0.0, _WIDEST, _STEPS)
    angle = np.linspace(-np.pi, np.pi, _RAYS)
    rays = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    onward = np.all(np.linalg.det(camera.jets(rays)[..., [[2, 3], [3, 4]]]) > _TURNS, axis=1)
    pixels = camera.pixels(rays)
    held = (pixels >= -0.5) & (pixels <= [camera.width - 0.5, camera.height - 0.5])
    shown = np.any(np.all(held, axis=2), axis=1)
    good = np.logical_and.accumulate(onward)
    reach = radius[np.flatnonzero(good & shown)[-1]] if (good & shown).any() else 0.0
    return min((1.0 + _MARGIN) * float(reach), float(radius[good.sum() - 1]))


def _hex(values: ArrayLike) -> Any:
    """Floats as texts, in lists as in the array."""
    array = floats(values)
    return [_hex(part) for part in array] if array.ndim else float(array).hex()


# ------------------------------------------------------------------------------------------------------------------
# The search: certificates one after the other.

_FIRST = 24  # dots of a first certificate
_IN_GROUP, _LEAST_GROUP = 16, 5  # dots of one of several
_ROUNDS = 4
_FAMILIES = 2  # wrong dots for which families of weights are looked for
_FIRST_GAIN, _GAIN = 0.5, 0.02  # share of some width that a pass must take away
_FIRST_LOSS, _LOSS = 0.02, 0.001  # share of what is left of a width, given away for shorter numbers


class _Ended(NamedTuple):
    """What a search found: the box that is left (None: no pose) about a quaternion, dots that are wrong for sure, the
    names of the certificates that say so."""

    turn: tuple[F, ...]
    left: Box | None
    wrong: Places
    after: Names


class _Search:
    """Encloses the poses that show all dots but at most so many; names of its certificates begin with `stem`."""

    def __init__(self, sight: Sight, digest: str, outliers: int, stem: str) -> None:
        self.sight, self.digest, self.outliers, self.stem = sight, digest, outliers, stem
        self.written: list[tuple[str, Json, Contracted]] = []
        self._places = np.array([[float(v.lo) for v in dot.at[:2]] for dot in sight.dots])

    def ended(self) -> _Ended:
        """Raises Refused where nothing bounded is proved."""
        now = self._started()
        # the bias of images' centres is bounded over the box where a certificate begins: a few dots make that small
        rounds = 2 if self.sight.of_images else 0
        for k in range(_ROUNDS):
            if now.left is None:
                return now
            wrong, few = Places(), k < rounds - 1
            if self.outliers:  # dots that no pose of the box shows
                every = range(len(self.sight.dots))
                rows = rows_of(self.sight, every, now.turn, (now.turn, now.left))
                wrong = tuple(n for n in every if rows.fails(n))
            if len(wrong) > self.outliers:
                return _Ended(now.turn, None, wrong, now.after)
            after = self._narrowed(now, wrong, few)
            if after is None and not few:
                return _Ended(now.turn, now.left, wrong, now.after)
            settled, now = wrong == now.wrong and k >= rounds, after or now
            if settled:
                break
        return now

    def _started(self) -> _Ended:
        """From all poses: by some dots, or by several groups of which no more than `outliers` have a wrong one."""
        dots, turn = self._places, (F(1), F(0), F(0), F(0))
        if self.outliers:
            count = 2 * self.outliers + 1
            if len(dots) < _LEAST_GROUP * count:
                what = f"{len(dots)} dots are too few for {self.outliers} outliers"
                raise Refused(f"{what}: {count} groups of {_LEAST_GROUP} are needed")
            groups = [group[:_IN_GROUP] for group in _dealt(dots, count)]
        else:
            groups = _dealt(dots, max(1, len(dots) // _FIRST))[:1]
        parts = []
        for group in groups:
            chosen = sorted(group.tolist())
            rows = rows_of(self.sight, chosen, turn, None)
            found = self._stage(rows, {"dots": chosen, "outliers": 0, "wrong": [], "turn": turn, "after": []})
            parts.append(Part(tuple(chosen), turn, (), found.left))
        about, box = joined(parts, self.outliers)
        return _Ended(about, box, (), tuple(file for file, *_ in self.written))

    def _narrowed(self, now: _Ended, wrong: Places, few: bool) -> _Ended | None:
        """By all other dots, or a few; None where too many may be wrong, or nothing is gained."""
        assert now.left is not None
        outliers = self.outliers - len(wrong)
        if outliers > _FAMILIES:
            return None
        dots = [k for k in range(len(self.sight.dots)) if k not in wrong]
        if few:
            places = self._places[dots]
            dots = sorted(dots[k] for k in _dealt(places, max(1, len(dots) // _FIRST))[0])
        turn = _middle(now.turn, now.left)
        rows = rows_of(self.sight, dots, turn, (now.turn, now.left))
        header = {"dots": dots, "outliers": outliers, "wrong": list(wrong), "turn": turn, "after": list(now.after)}
        found = self._stage(rows, header)
        return _Ended(turn, found.left, wrong, (self.written[-1][0],)) if found.steps else None

    def _stage(self, rows: Rows, header: Json) -> Contracted:
        def lifted(i: int, j: int) -> bool:
            return (i < 9 and j < 9) or i == j

        system = System(rows, lifted, (range(12),), range(9), wrong=header["outliers"], owner=rows.dot_of)
        first = not header["after"]
        gain, loss = (_FIRST_GAIN, _FIRST_LOSS) if first else (_GAIN, _LOSS)
        found = Descent(system, gain, loss=loss).over(rows.root)
        if found.steps or first:
            said = {"format": FORMAT, "pose_set": self.digest, **header, "turn": [number(v) for v in header["turn"]]}
            self.written.append((f"{self.stem}.{len(self.written) + 1}.cert.jsonl", said, found))
        return found


def _dealt(dots: Floats, count: int) -> list[Indices]:
    """So many groups, each all over the plate: dots in an order in which neighbours follow one another, one of every
    `count` to each group. Who gets which is drawn, the same in every run."""
    away = dots - dots.min(axis=0)
    cells = np.floor(away / max(float(away.max()), 1e-300) * 15.999).astype(np.int64)
    code = sum(((cells[:, k] >> bit) & 1) << (2 * bit + k) for bit in range(4) for k in range(2))
    order = np.argsort(code, kind="stable")
    rng = np.random.default_rng(0)
    place = np.concatenate([rng.permutation(count) for _ in range(0, len(dots), count)])[: len(dots)]
    return [rng.permutation(order[place == k]) for k in range(count)]


def _middle(turn: tuple[F, ...], box: Box) -> tuple[F, ...]:
    """A quaternion of the rotation in the middle of a box: short, and of no particular length."""
    entries = np.array([float(a + b) / 2.0 for a, b in zip(box.lo[:9], box.hi[:9], strict=True)]).reshape(3, 3)
    found = quaternion_product(quaternion_from_matrix(nearest_rotation(entries)), np.array([float(v) for v in turn]))
    return tuple(F(round(v * 2**30), 2**30) for v in normalised(found).tolist())


# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PoseSet:
    """What is proved of the poses that show the dots in their pixel boxes.

    PROVED   all of them have |P - pose.position| <= position_radius and R = R(1, s) R(pose.quaternion) with
             |2 s| <= rotation_radius, componentwise, in exact arithmetic on these floats: the reading set of a
             campaign. Whether there is one at all is not said.
    REFUTED  there is none: pose and radii are None
    UNKNOWN  nothing bounded was proved, for the `reason` told

    pose      of the target in the camera frame
    outliers  how many dots may lie outside their boxes
    refuted   numbers of dots that are outside for every pose of the set: outliers for sure
    seconds   that it took
    """

    verdict: Verdict
    pose: Pose | None
    position_radius: Floats | None
    rotation_radius: Floats | None
    outliers: int
    refuted: Places
    reason: str
    seconds: float

    @property
    def status(self) -> str:
        """A sentence."""
        but = f" but at most {self.outliers}" if self.outliers else ""
        if self.verdict is Verdict.PROVED:
            return f"All poses that show all dots{but} in their pixel boxes are enclosed: proved."
        if self.verdict is Verdict.REFUTED:
            return f"No pose shows all dots{but} in their pixel boxes: proved."
        return f"Nothing is proved: {self.reason}."

    def __contains__(self, pose: Pose) -> bool:
        """Whether a pose (of exact floats) lies in the enclosure, in exact numbers."""
        if self.pose is None or self.position_radius is None or self.rotation_radius is None:
            return False
        p, a, q, b = (
            np.array([F(v) for v in part.tolist()])
            for one in (pose, self.pose)
            for part in (one.position, one.quaternion)
        )
        scalar = a @ b  # (1, s) times the other quaternion is proportional to this one
        if not scalar:
            return False
        s = (b[0] * a[1:] - a[0] * b[1:] - np.cross(a[1:], b[1:])) / scalar
        away, radii = np.concatenate([p - q, 2 * s]), np.concatenate([self.position_radius, self.rotation_radius])
        return bool((np.abs(away) <= radii).all())


def enclose_pose(
    boxes: PixelBoxes,
    target: Target | TargetSet,
    camera: Camera | CameraSet,
    *,
    outliers: int = 0,
    certificate: StrPath | None = None,
    sources: Mapping[str, bytes] | None = None,
) -> PoseSet:
    """A box that is proved to hold every pose that shows all dots but at most `outliers` in their pixel boxes.

    `target` and `camera` are exact, or the sets that they are known to be in. `certificate` is a path
    without its ends: PATH.pose.json states all of this with the box, and PATH.1.cert.jsonl and so on prove it.
    `sources` are the bytes of the files that pixels, camera and target came from, by name, whose SHA-256 the claim
    states.

    Raises InputError for boxes that are not of this target, or that show nothing of the camera's field of view.
    """
    begin = time.perf_counter()
    targets = target if isinstance(target, TargetSet) else TargetSet(target)
    cameras = camera if isinstance(camera, CameraSet) else CameraSet(camera)
    name, count = targets.target.name, len(targets.target.dots)
    refuse(
        *(
            (not 0 <= k < count, f"pixel box of dot {k}", f"{name!r} has dots 0 to {count - 1}", "number dots from 0")
            for k in boxes.numbers
        ),
        (outliers < 0, "outliers", f"is {outliers}", "give a number of dots >= 0"),
    )
    stem = None if certificate is None else Path(certificate)
    named = "" if stem is None else stem.name
    inputs, sight = _sight(boxes, targets, cameras, named, sources or {})
    search = _Search(sight, digest_of(inputs), outliers, named)

    at, pose, position, rotation = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], None, None, None
    try:
        found = search.ended()
        if found.left is not None:
            place = [float(a + b) / 2.0 for a, b in zip(found.left.lo[9:12], found.left.hi[9:12], strict=True)]
            at = [*place, *normalised([float(v) for v in _middle(found.turn, found.left)]).tolist()]
            pose = Pose(np.array(place), np.array(at[3:]))
            radii = [up(v.ends[1]) for v in sight.radii(found.left, found.turn, list(map(F, at)))]
            position, rotation = frozen_array(radii[:3]), frozen_array(radii[3:])
    except Refused as reason:
        seconds = time.perf_counter() - begin
        return PoseSet(Verdict.UNKNOWN, None, None, None, outliers, (), str(reason), seconds)
    if stem is not None:
        claim = {
            "format": POSE_SET_FORMAT,
            "inputs": inputs,
            "outliers": outliers,
            "refuted": pose is None,
            "pose": _hex(at),
            "position_radius": None if position is None else _hex(position),
            "rotation_radius": None if rotation is None else _hex(rotation),
            "wrong": list(found.wrong),
            "after": list(found.after),
        }
        for file, header, part in search.written:
            write_steps(stem.with_name(file), header, part.left, part.steps)
        write_file(stem.with_name(named + SUFFIX), line(claim).encode("ascii"))
    verdict = Verdict.REFUTED if pose is None else Verdict.PROVED
    numbers = tuple(sorted(int(boxes.numbers[k]) for k in found.wrong))
    return PoseSet(verdict, pose, position, rotation, outliers, numbers, "", time.perf_counter() - begin)


# ------------------------------------------------------------------------------------------------------------------
# Guaranteed pose sets of many images: measured dots, boxes about the centres of their images, certificates.


class Enclosed(NamedTuple):
    """Of one image: its pose set, or the reason why there is none."""

    file: str
    found: PoseSet | None = None
    reason: str = ""


@dataclass(frozen=True)
class Enclosing:
    """What a worker does: pose sets of some images, with certificates in `folder`.

    half_width  pixels: the centre of each dot's image is stated to be so near to where it was found
    outliers    dots of an image that may be farther off, at most
    sources     the bytes of the files of camera and target, by name
    first_row   how a target is turned that looks the same when it is (`measure_pose`)
    """

    source: ImageFolder
    target: TargetSet
    camera: CameraSet
    half_width: float
    outliers: int
    folder: Path
    sources: Mapping[str, bytes]
    first_row: str | Pose

    def __call__(self, names: Sequence[str]) -> list[Enclosed]:
        return [self.one(name) for name in names]

    def one(self, name: str) -> Enclosed:
        try:
            image = self.source.read(name)
            seen = measure_pose(image, self.target.target, self.camera.camera, first_row=self.first_row)
            boxes = PixelBoxes.around(seen.numbers, seen.centers, self.half_width, of_images=True)
            sources, stem = {**self.sources, name: np.ascontiguousarray(image).tobytes()}, self.folder / stem_of(name)
            given = boxes, self.target, self.camera
            return Enclosed(name, enclose_pose(*given, outliers=self.outliers, certificate=stem, sources=sources))
        except REFUSED as error:
            return Enclosed(name, reason=reason_of(error))


def stem_of(name: str) -> str:
    """What the files of an image are called: "e00/1/3.png" is e00-1-3; in letters, digits and "_.-"."""
    stem = re.sub(r"[^\w.-]", "_", PurePosixPath(name).with_suffix("").as_posix().replace("/", "-"))
    return f"_{stem}" if stem.startswith(".") else stem
