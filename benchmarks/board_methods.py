"""What measures a pose from an image of one board: our dots, OpenCV's ChArUco and AprilTag boards.

The peers' settings are the best that were found, on images that the study does not use. For all: corners are refined
until they move by less than 1e-4 pixels (OpenCV's default is 0.1).
- ChArUco: the smallest dictionary (10 times faster than the largest), markers refined and looked for again
  (`tryRefineMarkers`: up to twice as many corners in poor images), 8 pixels for a bit. Markers of 6 / 8 of a square,
  as is usual, are worse than those of 6 / 10 or 6 / 12: they reach into the corners' windows. Two boards, because the
  finer one is better in good images and the coarser one in poor images.
- AprilTag, `SUBPIX`: windows of 4 pixels, not shortened. `APRILTAG`: the lines of the AprilTag detector. `CONTOUR` is
  worse than both. 5, 6 and 8 tags each way are about as good.
- Giving the detectors the camera, other thresholds and refining ChArUco's corners once more in windows of another size
  gained little or nothing. (Blurring the images by 1 pixel first does for plain corners, 10 to 40 %; it is not how
  these detectors are used.)

Their pose is the least-squares one of the reprojection with the exact camera: OpenCV's SQPNP, then its
Levenberg-Marquardt refinement, repeated without the corners that are more than four robust standard deviations off.
Ours is the program's own, which screens its dots as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from benchmarks.board_render import Board, render_board
from cpcal.common.arrays import Floats, Indices
from cpcal.robot import Pose, quaternion_from_rotation_vector, transformed
from cpcal.vision.camera import Camera
from cpcal.vision.dot_model import predicted_centers
from cpcal.vision.measure import NotMeasured, measure_pose
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Image, Scene, render
from cpcal.vision.target import Target

SIDE = 292.0  # mm: what the dots of our target span, edge to edge, of a plate of 300 mm
_LEAST_CORNERS = 6
_OUTLIER = 4.0  # standard deviations
_MEDIAN = 1.177  # standard deviations: of the length of a normal error in two dimensions
_SCREENINGS = 5


class Failed(Exception):
    """No pose from this image, and why."""


@dataclass(frozen=True)
class FoundBoard:
    """Of one image: pixels (n, 2), which of the method's points (n,) they are, the pose of the target in the camera."""

    pixels: Floats
    numbers: Indices
    pose: Pose


class BoardMethod(Protocol):
    """A board and how its pose is measured. `drawing` names the board: methods with the same one share images."""

    @property
    def name(self) -> str: ...

    @property
    def drawing(self) -> str: ...

    @property
    def count(self) -> int:
        """How many points there are to be found."""
        ...

    def draw(self, camera: Camera, pose: Pose, scene: Scene, seed: int) -> Image: ...

    def measure(self, image: Image, camera: Camera, shift: Floats) -> FoundBoard:
        """Pixels as found less the shift (2,) of the method's origin, and the pose from those. Raises Failed."""
        ...

    def exact(self, camera: Camera, pose: Pose) -> Floats:
        """Where the method's points (n, 2) are seen, pixels."""
        ...


@dataclass(frozen=True)
class DotBoard:
    """Our target and the program's whole chain."""

    target: Target
    name: str = "cpcal dots"
    drawing: str = "dots"

    @property
    def count(self) -> int:
        return len(self.target.dots)

    def draw(self, camera: Camera, pose: Pose, scene: Scene, seed: int) -> Image:
        return render(self.target, camera, pose, scene, seed=seed)

    def measure(self, image: Image, camera: Camera, shift: Floats) -> FoundBoard:
        if shift.any():
            raise ValueError("the origin of our pixels is where it should be")
        try:
            found = measure_pose(image, self.target, camera)
        except NotMeasured as error:
            raise Failed(str(error)) from error
        mine = found.identification
        return FoundBoard(found.dots.centers[mine.found], np.asarray(mine.numbers), found.pose)

    def exact(self, camera: Camera, pose: Pose) -> Floats:
        return predicted_centers(self.target, camera, pose)


class _OpenCVBoard:
    """A board of cells whose corners OpenCV finds."""

    def __init__(self, name: str, drawing: str, board: Board, points: Floats) -> None:
        self.name, self.drawing, self.board, self.points = name, drawing, board, points
        self.count = len(points)

    def draw(self, camera: Camera, pose: Pose, scene: Scene, seed: int) -> Image:
        return render_board(self.board, camera, pose, scene, seed=seed)

    def measure(self, image: Image, camera: Camera, shift: Floats) -> FoundBoard:
        pixels, numbers = self.corners(image)
        pixels = pixels - shift
        if len(numbers) < _LEAST_CORNERS:
            raise Failed(f"{len(numbers)} corners")
        return FoundBoard(pixels, numbers, least_squares_pose(self.points[numbers], pixels, camera))

    def exact(self, camera: Camera, pose: Pose) -> Floats:
        return camera.project(transformed(pose, self.points))

    def corners(self, image: Image) -> tuple[Floats, Indices]:
        """Pixels (n, 2) of the points of the given numbers (n,)."""
        raise NotImplementedError


class Charuco(_OpenCVBoard):
    """`squares` each way, markers of 4 x 4 bits with a border, 6 cells, in squares of `cells`."""

    def __init__(self, squares: int = 10, cells: int = 10) -> None:
        aruco = opencv().aruco
        size = next(n for n in (50, 100, 250, 1000) if n >= squares**2 // 2)
        markers = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_4X4_{size}"))
        printed = aruco.CharucoBoard((squares, squares), float(cells), 6.0, markers)
        row, column = np.indices((squares, squares))
        white = np.kron((row + column) % 2 == 1, np.ones((cells, cells), dtype=bool))
        board = Board(_with_markers(white, printed, 6), SIDE / (squares * cells))
        points = board.on_plate(printed.getChessboardCorners())
        super().__init__("OpenCV ChArUco", f"{squares} x {squares}, markers 6/{cells}", board, points)
        charuco, refining = aruco.CharucoParameters(), _refining(aruco.CORNER_REFINE_SUBPIX)
        charuco.tryRefineMarkers = True
        refining.perspectiveRemovePixelPerCell = 8
        self._detector = aruco.CharucoDetector(printed, charuco, refining)

    def corners(self, image: Image) -> tuple[Floats, Indices]:
        corners, numbers, _, _ = self._detector.detectBoard(image)
        if numbers is None:
            return np.zeros((0, 2)), np.zeros(0, dtype=np.intp)
        return np.asarray(corners, dtype=np.float64).reshape(-1, 2), np.asarray(numbers, dtype=np.intp).ravel()


class AprilTags(_OpenCVBoard):
    """`tags` of 36h11 each way, 8 cells with their border, `gap` cells apart."""

    def __init__(self, tags: int = 6, gap: int = 2, refinement: str = "SUBPIX") -> None:
        aruco = opencv().aruco
        markers = aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11)
        printed = aruco.GridBoard((tags, tags), 8.0, float(gap), markers)
        size = 8 * tags + gap * (tags - 1)
        board = Board(_with_markers(np.ones((size, size), dtype=bool), printed, 8), SIDE / size)
        points = board.on_plate(np.concatenate(printed.getObjPoints()))
        super().__init__(f"OpenCV AprilTag {refinement}", f"{tags} x {tags}, {gap} cells apart", board, points)
        self._first = {int(number): 4 * i for i, number in enumerate(np.ravel(printed.getIds()))}
        refining = _refining(getattr(aruco, f"CORNER_REFINE_{refinement}"))
        refining.cornerRefinementWinSize = 4
        if hasattr(refining, "relativeCornerRefinmentWinSize"):  # since OpenCV 4.9; before, windows were not shortened
            refining.relativeCornerRefinmentWinSize = 1.0
        self._detector = aruco.ArucoDetector(markers, refining)

    def corners(self, image: Image) -> tuple[Floats, Indices]:
        corners, numbers, _ = self._detector.detectMarkers(image)
        known = [(c, self._first[n]) for c, n in zip(corners, _numbers(numbers), strict=True) if n in self._first]
        if not known:
            return np.zeros((0, 2)), np.zeros(0, dtype=np.intp)
        firsts = np.array([first for _, first in known], dtype=np.intp)
        pixels = np.concatenate([np.asarray(c, dtype=np.float64).reshape(4, 2) for c, _ in known])
        return pixels, (firsts[:, None] + np.arange(4)).ravel()


def least_squares_pose(points: Floats, pixels: Floats, camera: Camera) -> Pose:
    """The pose of points (n, 3) mm that were seen at pixels (n, 2), outliers among them screened. Raises Failed."""
    cv2 = opencv()
    matrix = np.array([[camera.focal[0], 0.0, camera.center[0]], [0.0, camera.focal[1], camera.center[1]], [0, 0, 1]])
    lens = (matrix, np.array(camera.distortion))
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-10)
    kept = np.ones(len(points), dtype=bool)
    try:
        ok, turn, position = cv2.solvePnP(points, pixels, *lens, flags=cv2.SOLVEPNP_SQPNP)
        if not ok:
            raise Failed("SQPNP finds no pose")
        for _ in range(_SCREENINGS):
            turn, position = cv2.solvePnPRefineLM(points[kept], pixels[kept], *lens, turn, position, until)
            pose = Pose(np.ravel(position), quaternion_from_rotation_vector(np.ravel(turn)))
            error = np.linalg.norm(camera.project(transformed(pose, points)) - pixels, axis=1)
            screened = error < _OUTLIER * np.median(error) / _MEDIAN
            if screened.sum() < _LEAST_CORNERS or (screened == kept).all():
                break
            kept = screened
    except cv2.error as error:
        raise Failed(f"OpenCV's pose: {error}") from error
    return pose


def _with_markers(white: npt.NDArray[np.bool_], printed: Any, cells: int) -> npt.NDArray[np.bool_]:
    """The board's cells with the markers' own, each `cells` wide, where OpenCV says that they are."""
    aruco = opencv().aruco
    out = white.copy()
    for number, corners in zip(np.ravel(printed.getIds()), printed.getObjPoints(), strict=True):
        x, y = np.rint(np.asarray(corners)[0, :2]).astype(int)
        drawn = aruco.generateImageMarker(printed.getDictionary(), int(number), cells, borderBits=1)
        out[y : y + cells, x : x + cells] = drawn > 127
    return out


def _numbers(found: Any) -> list[int]:
    return [] if found is None else [int(number) for number in np.ravel(found)]


def _refining(method: int) -> Any:
    """OpenCV's parameters for accurate corners."""
    parameters = opencv().aruco.DetectorParameters()
    parameters.cornerRefinementMethod = method
    parameters.cornerRefinementMaxIterations = 100
    parameters.cornerRefinementMinAccuracy = 1e-4
    return parameters
