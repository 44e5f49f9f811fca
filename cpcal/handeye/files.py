"""Hand-eye studies in files (docs/hand-eye.md): a folder of handeye.toml, camera.toml, poses.csv and points.csv."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from cpcal.checker.files import STUDY_NAME
from cpcal.checker.hand_eye import STUDY_FORMAT
from cpcal.common.errors import InputError, Problem, Problems, shown
from cpcal.common.files import write_folder
from cpcal.files.settings import KeyPath, TomlReader, document, one_of, text
from cpcal.files.tables import Table, csv_table, json_object, read_table, small_file
from cpcal.handeye.study import SETUPS, HandEyeStudy, Setup
from cpcal.robot import Pose
from cpcal.vision.camera import Camera
from cpcal.vision.files.plate_and_camera import camera_bytes, load_camera

HANDEYE_FORMAT = "cpcal-handeye/1"
HANDEYE_NAME, POSES_NAME, POINTS_NAME, CAMERA_NAME = "handeye.toml", "poses.csv", "points.csv", "camera.toml"
POSE_COLUMNS = ["image", "x", "y", "z", "qw", "qx", "qy", "qz"]
POSE_WIDTHS = ("dx", "dy", "dz", "drx", "dry", "drz")
POINT_COLUMNS = ["image", "point", "u", "v", "X", "Y", "Z"]

_ABSENT = f"a hand-eye study is a folder with {HANDEYE_NAME}, a camera file, {POSES_NAME} and {POINTS_NAME}"
_SEE = "docs/hand-eye.md, which lists every key and column."


def load_hand_eye(path: str | os.PathLike[str]) -> HandEyeStudy:
    """The study in the folder `path`.

    handeye.toml states the setup and names the camera file; poses.csv has the hand in the base frame, in mm, with a
    unit quaternion, scalar first, and perhaps half-widths; points.csv has pixels as measured, the target's points in mm
    and perhaps half-widths du of the pixels. Points of images without a pose, or too close to the camera's horizon, are
    problems.

    Raises one InputError that lists every problem of the four files.
    """
    folder, problems = Path(path), Problems()
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise InputError([Problem(str(folder), what, _ABSENT)], see=_SEE)
    setup, camera = _settings(folder, problems)
    poses = _table(folder / POSES_NAME, POSE_COLUMNS, list(POSE_WIDTHS), problems)
    points = _table(folder / POINTS_NAME, POINT_COLUMNS, ["du"], problems)
    problems.raise_any(_SEE)
    assert setup is not None  # what keeps these from being read is a problem, and was raised
    assert camera is not None
    study = _study(folder, setup, camera, poses, points, problems)
    problems.raise_any(_SEE)
    assert study is not None
    return study


def load_hand_poses(path: str | os.PathLike[str]) -> dict[str, tuple[float, ...]]:
    """By image x, y, z, qw, qx, qy, qz of a table like poses.csv. Raises InputError with every problem."""
    problems = Problems()
    table = _table(Path(path), POSE_COLUMNS, list(POSE_WIDTHS), problems)
    problems.raise_any(_SEE)
    rows = table.columns(*POSE_COLUMNS[1:]).tolist()
    return {name: tuple(row) for name, row in zip(table.image, rows, strict=True)}


def _settings(folder: Path, problems: Problems) -> tuple[Setup | None, Camera | None]:
    content = small_file(folder / HANDEYE_NAME, problems, _ABSENT)
    if content is None:
        return None, None
    reader = TomlReader.of(content, str(folder / HANDEYE_NAME), HANDEYE_FORMAT, ("study", "provenance"), problems)
    if reader is None:
        return None, None
    reader.provenance()
    found = reader.section("study", {"setup": one_of(SETUPS), "camera": _camera_file})
    if found is None:
        return None, None
    setup, name = found["setup"], found["camera"]
    try:
        return setup, load_camera(folder / name).camera
    except InputError as error:
        for problem in error.problems:
            problems.add(problem)
        return setup, None


def _camera_file(reader: TomlReader, path: KeyPath, value: object) -> str:
    name = text(reader, path, value)
    if not name or Path(name).name != name:
        reader.wrong(path, f"camera is {shown(name)}", "name a camera file in the same folder")
    return name


def _table(path: Path, required: list[str], optional: list[str], problems: Problems) -> Table:
    return read_table(path, 0, problems, _ABSENT, required=lambda _: required, optional=lambda _: optional)


def _study(
    folder: Path, setup: Setup, camera: Camera, poses: Table, points: Table, problems: Problems
) -> HandEyeStudy | None:
    where = str(folder / POINTS_NAME)
    number = {name: k for k, name in enumerate(poses.image)}
    for name in sorted(set(points.image) - set(number)):
        problems.add(Problem(where, f"the image {shown(name)} has no pose", f"add it to {POSES_NAME}"))
    for name in sorted(set(number) - set(points.image)):
        what = f"the image {shown(name)} has no points"
        problems.add(Problem(str(folder / POSES_NAME), what, f"add them to {POINTS_NAME}, or take it out"))
    pixels = np.stack([points.values["u"], points.values["v"]], axis=1)
    for k in np.flatnonzero(np.isnan(camera.normalised(pixels)).any(axis=1)).tolist():
        what = f"the camera shows nothing at the pixel of {points.image[k]} {points.point[k]}"
        problems.add(Problem(where, what, "check the pixel, and the distortion in the camera file"))
    if problems:
        return None
    width = points.values.get("du", np.zeros(len(pixels)))
    return HandEyeStudy(
        setup=setup,
        camera=camera,
        images=tuple(poses.image),
        poses=Pose(poses.columns("x", "y", "z"), poses.columns("qw", "qx", "qy", "qz")),
        image=np.array([number[name] for name in points.image], dtype=np.intp),
        names=tuple(points.point),
        pixels=pixels,
        points=points.columns("X", "Y", "Z"),
        half_width=np.nan_to_num(width),
        pose_half_width=np.nan_to_num(
            np.stack([poses.values.get(name, np.zeros(len(number))) for name in POSE_WIDTHS], axis=1)
        ),
    )


def save_hand_eye(study: HandEyeStudy, folder: str | os.PathLike[str]) -> Path:
    """Write the study's four files into `folder`; floats so that they are read back bit for bit. Raises InputError."""
    write_folder(Path(folder), hand_eye_files(study), head=HANDEYE_NAME)
    return Path(folder)


def hand_eye_files(study: HandEyeStudy) -> dict[str, bytes]:
    """The bytes of the four files, by name."""
    settings = document(HANDEYE_FORMAT, {"study": {"setup": study.setup, "camera": CAMERA_NAME}}, {})
    moved = bool(study.pose_half_width.any())
    columns = [study.poses.position, study.poses.quaternion, *([study.pose_half_width] if moved else [])]
    poses = np.concatenate(columns, axis=1).tolist()
    wide = bool(study.half_width.any())
    parts = [study.pixels, study.points, *([study.half_width[:, None]] if wide else [])]
    points = np.concatenate(parts, axis=1).tolist()
    named = [(study.images[k], name) for k, name in zip(study.image, study.names, strict=True)]
    return {
        HANDEYE_NAME: settings,
        CAMERA_NAME: camera_bytes(study.camera),
        POSES_NAME: csv_table(
            [*POSE_COLUMNS, *POSE_WIDTHS] if moved else POSE_COLUMNS,
            zip(((name,) for name in study.images), poses, strict=True),
        ),
        POINTS_NAME: csv_table([*POINT_COLUMNS, "du"] if wide else POINT_COLUMNS, zip(named, points, strict=True)),
    }


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


def load_study_json(folder: str | os.PathLike[str]) -> HandEyeStudy:
    """The study of a run. Raises InputError."""
    path = Path(folder) / STUDY_NAME
    remedy = "run cpcal handeye again"
    data = json_object(path, remedy, remedy)
    try:
        camera, images, points = data["camera"], data["images"], data["points"]
        poses = np.array([row[1:] for row in images], dtype=np.float64).reshape(-1, 13)
        numbers = np.array([row[2:] for row in points], dtype=np.float64).reshape(-1, 8)
        return HandEyeStudy(
            setup=data["setup"],
            camera=Camera(
                width=camera["size"][0],
                height=camera["size"][1],
                focal=np.array(camera["focal"], np.float64),
                center=np.array(camera["center"], np.float64),
                distortion=np.array(camera["distortion"], np.float64),
                model=camera["model"],
            ),
            images=tuple(row[0] for row in images),
            poses=Pose(poses[:, :3], poses[:, 3:7]),
            image=np.array([row[0] for row in points], dtype=np.intp),
            names=tuple(row[1] for row in points),
            pixels=numbers[:, :2],
            points=numbers[:, 4:7],
            half_width=numbers[:, 7],
            pose_half_width=poses[:, 7:],
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError([Problem(str(path), f"lacks or garbles a field: {shown(str(error))}", remedy)]) from None
