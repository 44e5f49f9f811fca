"""Points of a board in photographs, found by OpenCV: chessboard, ChArUco, or AprilTag and ArUco grids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpcal.common.arrays import Floats, Indices
from cpcal.common.errors import InputError, Problem
from cpcal.handeye.hand_eye_study import HandEyeStudy, Setup
from cpcal.robot import Pose
from cpcal.vision.camera import Camera
from cpcal.vision.files.image_file import image_files, image_path, read_image
from cpcal.vision.opencv import opencv

REMEDY = (
    "write chessboard:COLUMNSxROWS:PITCH (inner corners), charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY (squares) or "
    "grid:COLUMNSxROWS:MARKER:GAP:DICTIONARY; mm; dictionaries such as 4X4_50, APRILTAG_36h11; or target:FILE, a "
    "target.toml"
)

Found = tuple[list[str], Floats, Floats]
NOTHING: Found = ([], np.zeros((0, 2)), np.zeros((0, 3)))


@dataclass(frozen=True)
class PrintedBoard:
    """What is printed. `lengths` in mm: pitch; square and marker; or marker and gap."""

    kind: str
    columns: int
    rows: int
    lengths: tuple[float, ...]
    dictionary: str = ""

    @staticmethod
    def parsed(text: str) -> PrintedBoard:
        """Of the form that REMEDY tells. Raises InputError."""
        kind, *rest = text.split(":")
        counts = {"chessboard": 1, "charuco": 2, "grid": 2}
        try:
            columns, rows = (int(part) for part in rest[0].lower().split("x"))
            lengths = tuple(float(part) for part in rest[1 : 1 + counts[kind]])
            (dictionary,) = rest[1 + counts[kind] :] or [""]
        except (ValueError, KeyError, IndexError):
            raise InputError([Problem("board", f"is {text!r:.80}", REMEDY)]) from None
        named = bool(dictionary) == (kind != "chessboard")
        if not named or len(lengths) < counts[kind] or min(columns, rows) < 2 or not min(lengths) > 0.0:
            raise InputError([Problem("board", f"is {text!r:.80}", REMEDY)])
        return PrintedBoard(kind, columns, rows, lengths, dictionary)

    @property
    def looks_the_same_turned(self) -> bool:
        """A chessboard with two even or two odd counts of inner corners is its own picture turned by 180 degrees."""
        return self.kind == "chessboard" and (self.columns + self.rows) % 2 == 0


def study_of_photos(
    folder: Path, board: PrintedBoard, *, camera: Camera, poses: dict[str, tuple[float, ...]], setup: Setup
) -> tuple[HandEyeStudy, list[str]]:
    """A study of the photographs in a folder, and what was left out, in sentences.

    poses   by the name of each photograph without its suffix: x, y, z, qw, qx, qy, qz of the hand in the base, mm

    Raises InputError where no photograph has both a pose and a board, UnreadableImageError, MissingExtraError.
    """
    find = _finder(board)
    return study_of_found(folder, lambda image: find(_grey(image)), camera=camera, poses=poses, setup=setup)


def study_of_found(
    folder: Path,
    find: Callable[[Any], Found],
    *,
    camera: Camera,
    poses: dict[str, tuple[float, ...]],
    setup: Setup,
) -> tuple[HandEyeStudy, list[str]]:
    """As `study_of_photos`, with what `find` finds in an image: names, pixels (n, 2) and points (n, 3) in mm.

    A photograph in a folder below goes by its path, as "folder/name", if its name alone has no pose.
    """
    seen: list[tuple[str, list[str], Floats, Floats]] = []
    left: list[str] = []
    for name in image_files(folder):
        stem = next((key for key in (Path(name).stem, Path(name).with_suffix("").as_posix()) if key in poses), None)
        if stem is None:
            left.append(f"{name} has no pose")
            continue
        image = read_image(image_path(folder, name), (camera.width, camera.height))
        names, pixels, points = find(image)
        if len(names) < 6:
            left.append(f"{name}: the board is not found")
            continue
        seen.append((stem, names, pixels, points))
    if not seen:
        what = "holds no photograph with a pose and the board: " + "; ".join(left[:3])
        raise InputError([Problem(str(folder), what, "check the board, the poses' names, the camera's size")])
    given = np.array([poses[stem] for stem, *_ in seen])
    study = HandEyeStudy(
        setup=setup,
        camera=camera,
        images=tuple(stem.replace("/", "-") for stem, *_ in seen),
        poses=Pose(given[:, :3], given[:, 3:]),
        image=np.concatenate([np.full(len(names), k) for k, (_, names, *_) in enumerate(seen)]),
        names=tuple(name for _, names, *_ in seen for name in names),
        pixels=np.concatenate([pixels for *_, pixels, _ in seen]),
        points=np.concatenate([points for *_, points in seen]),
    )
    return study, left


def _grey(image: Any) -> Any:
    cv2 = opencv()
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image


def _finder(board: PrintedBoard) -> Any:
    """What finds names, pixels (n, 2) and points (n, 3) in a grey image."""
    cv2 = opencv()
    if board.kind == "chessboard":
        return lambda grey: _chessboard(cv2, grey, board)
    name = "DICT_" + board.dictionary.removeprefix("DICT_")
    if not hasattr(cv2.aruco, name):
        raise InputError([Problem("board", f"has the dictionary {board.dictionary!r:.40}", REMEDY)])
    dictionary, size = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)), (board.columns, board.rows)
    if board.kind == "charuco":
        printed = cv2.aruco.CharucoBoard(size, board.lengths[0], board.lengths[1], dictionary)
        detector = cv2.aruco.CharucoDetector(printed)
        return lambda grey: _corners(detector.detectBoard(grey), np.asarray(printed.getChessboardCorners()))
    printed = cv2.aruco.GridBoard(size, board.lengths[0], board.lengths[1], dictionary)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    markers = cv2.aruco.ArucoDetector(dictionary, parameters)
    return lambda grey: _markers(markers.detectMarkers(grey), printed)


def _chessboard(cv2: Any, grey: Any, board: PrintedBoard) -> Found:
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY)
    if not found:
        return NOTHING
    pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    grid = np.stack(np.meshgrid(np.arange(board.columns), np.arange(board.rows)), axis=-1).reshape(-1, 2)
    points = np.concatenate([board.lengths[0] * grid, np.zeros((len(grid), 1))], axis=1)
    return [f"c{k}" for k in range(len(points))], pixels, points


def _corners(detected: Any, board: Floats) -> Found:
    corners, numbers, *_ = detected
    if numbers is None or not len(numbers):
        return NOTHING
    places: Indices = np.asarray(numbers).ravel().astype(np.intp)
    pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return [f"c{k}" for k in places], pixels, np.asarray(board, dtype=np.float64).reshape(-1, 3)[places]


def _markers(detected: Any, board: Any) -> Found:
    corners, numbers, *_ = detected
    if numbers is None or not len(numbers):
        return NOTHING
    printed = zip(board.getIds().ravel().tolist(), board.getObjPoints(), strict=True)
    known = {number: np.asarray(points, dtype=np.float64) for number, points in printed}
    names, pixels, points = [], [], []
    for number, four in zip(np.asarray(numbers).ravel().tolist(), corners, strict=True):
        if number in known:
            names += [f"m{number}c{k}" for k in range(4)]
            pixels.append(np.asarray(four, dtype=np.float64).reshape(4, 2))
            points.append(known[number].reshape(4, 3))
    return (names, np.concatenate(pixels), np.concatenate(points)) if names else NOTHING
