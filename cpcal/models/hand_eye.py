"""A hand-eye study: poses of a robot's hand, and what a camera saw of a target in each.

    x_ij = E H_i F p_j          point j of image i in the camera frame, mm

| setup | E | H_i | F |
| --- | --- | --- | --- |
| eye-in-hand | hand in the camera frame | base in the hand frame, the inverse of the stated pose | target in the base |
| eye-to-hand | base in the camera frame | hand in the base frame, the stated pose | target in the hand |

"A in the B frame" is the motion that maps coordinates of A to those of B.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from cpcal.checker.files import STUDY_NAME
from cpcal.checker.frames import GIVEN, unit
from cpcal.checker.hand_eye import STUDY_FORMAT
from cpcal.common.documents import KeyPath, TomlReader, csv_table, document, json_object, one_of, text
from cpcal.common.errors import Problem, Problems, shown, unusable
from cpcal.common.files import StrPath, write_folder
from cpcal.common.values import Floats, Indices, Names, Numbers, Texts, Value, fill, floats, frozen_array
from cpcal.files.folders import existing_folder
from cpcal.files.log import poses_of_log, read_log
from cpcal.files.tables import Table, read_table
from cpcal.robot import Pose, compose, inverse, quaternion_from_rotation_vector, quaternion_product, rotation_matrix
from cpcal.robot.campaign import SIMULATION
from cpcal.robot.kinematics import normalised, small_rotation
from cpcal.robot.units import AXES, POSE
from cpcal.vision.camera import Camera
from cpcal.vision.files.plate_and_camera import camera_bytes, load_camera

Known = tuple[tuple[str, float, float], ...]
Setup = Literal["eye-in-hand", "eye-to-hand"]
SETUPS: tuple[Setup, ...] = ("eye-in-hand", "eye-to-hand")


@dataclass(frozen=True, eq=False, kw_only=True)
class HandEyeStudy(Value):
    """Poses (n) of the hand in the base frame and points (N) that were seen.

    images      their n names
    poses       (n, 3) mm and (n, 4): hand in base
    image       (N,) whole numbers, the image of each point
    names       (N,) of the points
    pixels      (N, 2) as measured, with the lens's distortion
    points      (N, 3) mm in the target frame
    half_width  (N,) px: the true pixel lies that near to the measured one; 0 where it is taken as exact
    pose_half_width  (n, 6) mm and rad: the true pose is position + d, R(1, s) R(q) with |d| and |2 s| at most that on
                each axis of the base frame; 0 where poses are taken as exact
    provenance  what is known of its making: `generator`, `half_widths`, ...
    known       what a user knows: a name of GIVEN, least and greatest value in mm or degrees; no file holds it

    Raises InputError for arrays that do not belong together.
    """

    setup: Setup
    camera: Camera
    images: Names
    poses: Pose
    image: Indices
    names: Names
    pixels: Floats
    points: Floats
    half_width: Floats = field(default_factory=lambda: np.zeros(0))
    pose_half_width: Floats = field(default_factory=lambda: np.zeros(0))
    provenance: Texts = field(default_factory=dict)
    known: Known = ()

    def __post_init__(self) -> None:
        count, n = len(self.image), len(self.images)
        if self.setup not in SETUPS:
            raise unusable("setup", f"is {self.setup!r}", f"give one of {', '.join(SETUPS)}")
        places = np.array(self.image, np.intp)
        places.setflags(write=False)
        width = self.half_width if np.size(self.half_width) else np.zeros(count)
        wide = self.pose_half_width if np.size(self.pose_half_width) else np.zeros((n, 6))
        arrays = {"pixels": self.pixels, "points": self.points, "half_width": width, "pose_half_width": wide}
        fill(self, image=places, **{name: frozen_array(values) for name, values in arrays.items()})
        shapes = tuple(getattr(self, name).shape for name in arrays)
        if (self.poses.position.shape, *shapes) != ((n, 3), (count, 2), (count, 3), (count,), (n, 6)):
            raise unusable("study", "has arrays that do not belong together", "see HandEyeStudy")
        if count and not 0 <= places.min() <= places.max() < n:
            raise unusable("study", "has a point of an image without pose", "name the images by number")

    @property
    def uncertain(self) -> bool:
        """Whether the robot's poses have half-widths."""
        return bool(self.pose_half_width.any())

    @property
    def given(self) -> Floats:
        """(2, 8) mm and degrees: least and greatest positions and tilt of camera and target, as far as they are known;
        tilts by a billionth narrower, for rounding."""
        ends, names = np.tile([[-np.inf], [np.inf]], len(GIVEN)), list(GIVEN)
        for name, low, high in self.known:
            slack = 1e-9 * (high - low) if unit(name) == "degrees" else 0.0
            ends[:, names.index(name)] = low + slack, high - slack
        return np.asarray(ends)

    @property
    def rays(self) -> Floats:
        """(N, 2) pixels without the lens's distortion: what a pinhole of the same focal lengths and centre shows."""
        return np.asarray(self.camera.center + self.camera.focal * self.camera.normalised(self.pixels))

    def motions(self, readings: Floats | None = None) -> tuple[Floats, Floats]:
        """Rotations (n, 3, 3) and translations (n, 3), mm, of H_i at the stated poses or at readings, in float64."""
        poses = read_poses(self.poses, readings)
        turn, shift = rotation_matrix(poses.quaternion), poses.position
        if self.setup == "eye-to-hand":
            return turn, shift
        back = np.swapaxes(turn, -1, -2)
        return back, -np.einsum("nij,nj->ni", back, shift)

    def exactly(self, readings: Floats | None = None) -> HandEyeStudy:
        """The study with each pose as it is stated, or at its reading, taken as exact."""
        return replace(
            self, poses=read_poses(self.poses, readings), pose_half_width=np.zeros_like(self.pose_half_width)
        )

    def part(self, chosen: Indices) -> HandEyeStudy:
        """The study of some of the images, in their order."""
        new = np.full(len(self.images), -1)
        new[chosen] = np.arange(len(chosen))
        kept = np.flatnonzero(new[self.image] >= 0)
        return replace(
            self,
            images=tuple(self.images[k] for k in chosen),
            poses=self.poses.rows(chosen),
            image=new[self.image[kept]],
            names=tuple(self.names[k] for k in kept),
            pixels=self.pixels[kept],
            points=self.points[kept],
            half_width=self.half_width[kept],
            pose_half_width=self.pose_half_width[chosen],
        )


def read_poses(poses: Pose, readings: Floats | None) -> Pose:
    """Poses at readings (n, 6) of them, (d, w) in mm and rad: position + d, R(1, w / 2) R, in the base frame."""
    if readings is None:
        return poses
    turn = normalised(small_rotation(readings[:, 3:]))
    return Pose(poses.position + readings[:, :3], quaternion_product(turn, poses.quaternion))


class HandEyeFrames(NamedTuple):
    """E and F: rotations (3, 3), translations (3,) mm."""

    e_rotation: Floats
    e_translation: Floats
    f_rotation: Floats
    f_translation: Floats


def study_of_board(
    hand: Pose, seen: Pose, board: Floats, *, setup: Setup, camera: Camera, images: Names
) -> HandEyeStudy:
    """The exact pixels of the points (k, 3) mm of a board, at n poses of it in the camera frame and of the hand in the
    base frame. Raises InputError with a point behind the camera."""
    points = np.einsum("nij,kj->nki", seen.rotation, board) + seen.position[:, None, :]
    behind = np.flatnonzero((points[..., 2] <= 0.0).any(axis=1))
    if len(behind):
        what = f"put the target behind the camera in sample {behind[0] + 1}"
        raise unusable("poses", what, "give the target in the camera frame, z along the line of sight")
    return HandEyeStudy(
        setup=setup,
        camera=camera,
        images=images,
        poses=hand,
        image=np.repeat(np.arange(len(images)), len(board)),
        names=tuple(f"p{k + 1}" for _ in images for k in range(len(board))),
        pixels=camera.project(points).reshape(-1, 2),
        points=np.tile(board, (len(images), 1)),
    )


# ------------------------------------------------------------------------------------------------------------------
# Simulated hand-eye studies, with their truth.

CAMERA = Camera(1280, 960, np.array([1000.0, 1000.0]), np.array([639.5, 479.5]), np.zeros(5))
_TILT = np.radians(40.0)


class SimulatedHandEye(NamedTuple):
    """A study and the frames that made it."""

    study: HandEyeStudy
    truth: HandEyeFrames


def simulate_hand_eye(
    *,
    setup: Setup = "eye-in-hand",
    images: int = 30,
    corners: tuple[int, int] = (8, 6),
    pitch: float = 30.0,
    pixel_error: float = 0.2,
    position_error: float = 0.0,
    rotation_error: float = 0.0,
    seed: int = 0,
) -> SimulatedHandEye:
    """A board of `corners` at `pitch` mm, seen from 500 to 800 mm under tilts up to 40 degrees.

    pixel_error     px, rotation_error rad, position_error mm: errors are uniform in plus and minus that, on each axis

    The hand-eye rotation is any rotation, its translation within 150 mm; the other frame is anywhere within a metre.
    """
    random = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(corners[0]), np.arange(corners[1])), axis=-1).reshape(-1, 2)
    flat = pitch * (grid - (np.array(corners) - 1) / 2.0)
    board = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
    seen = _views(images, random)
    on_hand = Pose(random.uniform(-150.0, 150.0, 3), normalised(random.normal(size=4)))
    far = Pose(random.uniform(-1000.0, 1000.0, 3), normalised(random.normal(size=4)))
    if setup == "eye-in-hand":  # camera on the hand, target in the base
        e, f = inverse(on_hand), far
        poses = inverse(compose(compose(on_hand, seen), inverse(far)))
    else:  # target on the hand, base in the camera
        e, f = far, on_hand
        poses = compose(compose(inverse(far), seen), inverse(on_hand))
    turns, shifts = (random.uniform(-most, most, (images, 3)) for most in (rotation_error, position_error))
    names = tuple(f"image{k + 1:03d}" for k in range(images))
    stated = poses.moved(np.hstack([shifts, turns]))
    study = study_of_board(stated, seen, board, setup=setup, camera=CAMERA, images=names)
    off = random.uniform(-pixel_error, pixel_error, (images, len(board), 2)).reshape(-1, 2)
    made = {"generator": f"{SIMULATION}, hand-eye", "seed": str(seed)}
    study = replace(study, pixels=study.pixels + off, provenance=made)
    return SimulatedHandEye(study, HandEyeFrames(e.rotation, e.position, f.rotation, f.position))


def _views(images: int, random: np.random.Generator) -> Pose:
    """Poses of the target in the camera frame."""
    axis, level = random.uniform(0.0, 2.0 * np.pi, images), np.zeros(images)
    tilt = _TILT * np.sqrt(random.uniform(0.1, 1.0, images))
    leaning = quaternion_from_rotation_vector(np.column_stack([tilt * np.cos(axis), tilt * np.sin(axis), level]))
    roll = random.uniform(-np.pi, np.pi, images)
    rolled = quaternion_from_rotation_vector(np.column_stack([level, level, roll]))
    spans = ((-100.0, 100.0), (-70.0, 70.0), (500.0, 800.0))
    place = np.column_stack([random.uniform(*span, images) for span in spans])
    return Pose(place, normalised(quaternion_product(leaning, rolled)))


# ------------------------------------------------------------------------------------------------------------------
# Hand-eye studies in files (docs/hand-eye.md): a folder of handeye.toml, camera.toml, poses.csv and points.csv.

HANDEYE_FORMAT = "cpcal-handeye/1"
HANDEYE_NAME, POSES_NAME, POINTS_NAME, CAMERA_NAME = "handeye.toml", "poses.csv", "points.csv", "camera.toml"
POSE_COLUMNS = ["image", *POSE]
POSE_WIDTHS = tuple(f"d{axis}" for axis in AXES)
POINT_COLUMNS = ["image", "point", "u", "v", "X", "Y", "Z"]

_ABSENT = f"a hand-eye study is a folder with {HANDEYE_NAME}, a camera file, {POSES_NAME} and {POINTS_NAME}"
_SEE = "docs/hand-eye.md, which lists every key and column."


def load_hand_eye(path: StrPath) -> HandEyeStudy:
    """The study in the folder `path`.

    handeye.toml states the setup and names the camera file; poses.csv has the hand in the base frame, in mm, with a
    unit quaternion, scalar first, and perhaps half-widths; points.csv has pixels as measured, the target's points in mm
    and perhaps half-widths du of the pixels. Points of images without a pose, or too close to the camera's horizon, are
    problems.

    Raises one InputError that lists every problem of the four files.
    """
    folder, problems = existing_folder(path, _ABSENT, _SEE), Problems()
    reader = TomlReader.opened(folder / HANDEYE_NAME, HANDEYE_FORMAT, ("study",), problems, _ABSENT)
    provenance = {} if reader is None else reader.provenance()
    said = None if reader is None else reader.section("study", {"setup": one_of(SETUPS), "camera": _camera_file})
    record = None if said is None else problems.of(partial(load_camera, folder / said["camera"]))
    poses = _table(folder / POSES_NAME, POSE_COLUMNS, list(POSE_WIDTHS), problems)
    points = _table(folder / POINTS_NAME, POINT_COLUMNS, ["du"], problems)
    problems.raise_any(_SEE)
    assert said is not None  # what keeps these from being read is a problem, and was raised
    assert record is not None
    camera = record.camera
    where, number = str(folder / POINTS_NAME), {name: k for k, name in enumerate(poses.names["image"])}
    for name in sorted(set(points.names["image"]) - set(number)):
        problems.add(Problem(where, f"the image {shown(name)} has no pose", f"add it to {POSES_NAME}"))
    for name in sorted(set(number) - set(points.names["image"])):
        what = f"the image {shown(name)} has no points"
        problems.add(Problem(str(folder / POSES_NAME), what, f"add them to {POINTS_NAME}, or take it out"))
    numbers = _numbers(points, [*POINT_COLUMNS[2:], "du"])
    for k in np.flatnonzero(np.isnan(camera.normalised(numbers[:, :2])).any(axis=1)).tolist():
        what = f"the camera shows nothing at the pixel of {points.names['image'][k]} {points.names['point'][k]}"
        problems.add(Problem(where, what, "check the pixel, and the distortion in the camera file"))
    problems.raise_any(_SEE)
    places = [number[name] for name in points.names["image"]]
    wide = _numbers(poses, [*POSE_COLUMNS[1:], *POSE_WIDTHS])
    seen = points.names["point"], numbers
    return _study(said["setup"], camera, provenance, (poses.names["image"], wide), places, seen)


def _numbers(table: Table, columns: Sequence[str]) -> Floats:
    """Columns of a table, 0 where it has none."""
    absent = np.zeros(len(table.names["image"]))
    return np.nan_to_num(np.stack([table.values.get(name, absent) for name in columns], axis=1))


def _study(
    setup: Setup, camera: Camera, provenance: Texts, poses: tuple[Sequence[str], Floats],
    image: Sequence[int], points: tuple[Sequence[str], Floats],
) -> HandEyeStudy:  # fmt: skip
    """Of tables with names: (n, 13) positions, quaternions and half-widths, (N, 6) pixels, points and half-widths."""
    (images, hand), (names, seen) = poses, points
    return HandEyeStudy(
        setup=setup, camera=camera, images=tuple(images), poses=Pose(hand[:, :3], hand[:, 3:7]),
        image=np.array(image, np.intp), names=tuple(names), pixels=seen[:, :2], points=seen[:, 2:5],
        half_width=seen[:, 5], pose_half_width=hand[:, 7:], provenance=provenance,
    )  # fmt: skip


def load_hand_poses(
    path: StrPath, *, rotation: str | None = None, unit: str = "", base_in_hand: bool = False, names: Sequence[str] = ()
) -> dict[str, tuple[float, ...]]:
    """By image x, y, z, qw, qx, qy, qz of the hand in the base frame, mm, of a table in any form of `poses_of_log`.

    base_in_hand  the table has the base in the hand frame instead
    names         of rows that have none, in order

    Raises InputError.
    """
    given, position, quaternion = poses_of_log(read_log(Path(path)), rotation, unit)
    if not given and names and len(names) != len(position):
        what = f"has {len(position)} poses without names, and there are {len(names)} photographs"
        raise unusable(str(path), what, "add a column image with their names")
    given = given or list(names) or [f"pose{k}" for k in range(1, len(position) + 1)]
    twice = [name for name, count in Counter(given).items() if count > 1]
    if twice:
        raise unusable(str(path), f"names {shown(twice[0])} twice", "give each image one pose")
    pose = Pose(position, quaternion)
    if base_in_hand:
        pose = inverse(pose)
    return by_name(given, pose)


def by_name(names: Sequence[str], poses: Pose) -> dict[str, Numbers]:
    """x, y, z (mm), qw, qx, qy, qz of poses (n)."""
    rows = np.concatenate([poses.position, poses.quaternion], axis=1).tolist()
    return dict(zip(names, map(tuple, rows), strict=True))


def _camera_file(reader: TomlReader, path: KeyPath, value: object) -> str:
    name = text(reader, path, value)
    if not name or Path(name).name != name:
        reader.wrong(path, f"camera is {shown(name)}", "name a camera file in the same folder")
    return name


def _table(path: Path, required: list[str], optional: list[str], problems: Problems) -> Table:
    return read_table(path, 0, problems, _ABSENT, required=lambda _: required, optional=lambda _: optional)


def save_hand_eye(study: HandEyeStudy, folder: StrPath) -> Path:
    """Write the study's four files into `folder`; floats so that they are read back bit for bit. Raises InputError."""
    settings = document(HANDEYE_FORMAT, {"study": {"setup": study.setup, "camera": CAMERA_NAME}}, study.provenance)
    pose_columns, point_columns = POSE_COLUMNS, POINT_COLUMNS
    poses, points = [study.poses.position, study.poses.quaternion], [study.pixels, study.points]
    if study.uncertain:
        pose_columns, poses = [*pose_columns, *POSE_WIDTHS], [*poses, study.pose_half_width]
    if study.half_width.any():
        point_columns, points = [*point_columns, "du"], [*points, study.half_width[:, None]]
    places, seen = (np.concatenate(parts, axis=1).tolist() for parts in (poses, points))
    named = zip(study.image, study.names, seen, strict=True)
    files = {
        HANDEYE_NAME: settings,
        CAMERA_NAME: camera_bytes(study.camera),
        POSES_NAME: csv_table(pose_columns, ([name, *row] for name, row in zip(study.images, places, strict=True))),
        POINTS_NAME: csv_table(point_columns, ([study.images[k], name, *row] for k, name, row in named)),
    }
    write_folder(Path(folder), files, head=HANDEYE_NAME)
    return Path(folder)


# ------------------------------------------------------------------------------------------------------------------
# The study in a run, one file that the checker reads: numbers as float64, and each pixel without the lens's distortion.


def study_json(study: HandEyeStudy) -> bytes:
    """The bytes of study.json."""
    camera, poses = study.camera, study.poses
    numbers = [study.pixels, study.rays, study.points, study.half_width[:, None]]
    places = np.concatenate([poses.position, poses.quaternion, study.pose_half_width], axis=1).tolist()
    points = np.concatenate(numbers, axis=1).tolist()
    data = {
        "format": STUDY_FORMAT,
        "provenance": dict(study.provenance),
        "setup": study.setup,
        "camera": {
            "size": [camera.width, camera.height],
            "focal": camera.focal.tolist(),
            "center": camera.center.tolist(),
            "distortion": camera.distortion.tolist(),
            "model": camera.model,
        },
        "images": [[name, *row] for name, row in zip(study.images, places, strict=True)],
        "points": [[k, name, *row] for k, name, row in zip(study.image.tolist(), study.names, points, strict=True)],
    }
    return (json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n").encode()


def load_study_json(folder: StrPath, *, undistorted: bool = False) -> HandEyeStudy:
    """The study of a run, or `undistorted` what a camera without its lens shows: other lenses take a while to load.

    Raises InputError.
    """
    path = Path(folder) / STUDY_NAME
    remedy = "run cpcal handeye again"
    data = json_object(path, remedy, remedy)
    try:
        camera, images, points = data["camera"], data["images"], data["points"]
        poses = floats([row[1:] for row in images]).reshape(-1, 13)
        numbers = floats([row[2:] for row in points]).reshape(-1, 8)
        width, height = camera["size"]
        focal, center, distortion = (np.array(camera[key], np.float64) for key in ("focal", "center", "distortion"))
        lens = Camera(width, height, focal, center, distortion, camera["model"])
        if undistorted:
            lens, numbers[:, :2] = Camera(width, height, focal, center, np.zeros(5)), numbers[:, 2:4]
        return _study(
            data["setup"], lens,
            {str(key): str(value) for key, value in data.get("provenance", {}).items()},
            ([row[0] for row in images], poses), [row[0] for row in points],
            ([row[1] for row in points], np.delete(numbers, [2, 3], axis=1)),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise unusable(str(path), f"lacks or garbles a field: {shown(str(error))}", remedy) from None
