"""The comparison of boards: exact images of the boards that OpenCV prints, and nothing that a method does is lost."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import boards
from benchmarks.board_methods import AprilTags, Charuco, Failed, FoundBoard
from benchmarks.board_render import Board, bright_share, cells_at, render_board
from benchmarks.isolation import ONE_THREAD
from cpcal.robot import Pose, transformed
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Image, Scene

pytest.importorskip("cv2")

POSE = boards.poses(DELTALAB_CAMERA, 1, 4)[0]
SHARE = 1 << 6  # points of a pixel, each way, that a count of them has


def checkered(count: int) -> Board:
    return Board(np.indices((count, count)).sum(axis=0) % 2 == 1, 292.0 / count)


def test_a_board_is_drawn_where_it_is_seen() -> None:
    """Against points counted in each pixel; a row of pixels across borders adds up to where the borders are."""
    board = checkered(40)
    drawn = bright_share(board, DELTALAB_CAMERA, POSE, blur=0.0)
    at = np.rint(DELTALAB_CAMERA.project(POSE.position)).astype(int)
    inside = (np.arange(8 * SHARE) + 0.5) / SHARE - 0.5
    looked = cells_at(board, DELTALAB_CAMERA, POSE, np.stack(np.meshgrid(at[0] + inside, at[1] + inside), axis=-1))
    column, row = np.moveaxis(np.floor(looked).astype(int), -1, 0)
    counted = board.cells[row, column].reshape(8, SHARE, 8, SHARE).mean(axis=(1, 3))
    error = drawn[at[1] : at[1] + 8, at[0] : at[0] + 8] - counted
    assert np.abs(error).max() < 0.01
    assert np.abs(error.mean(axis=0)).max() < 1e-3
    assert np.abs(error.mean(axis=1)).max() < 1e-3
    assert 0.05 < counted.mean() < 0.95  # there are borders


def test_cells_are_where_the_pose_and_the_camera_put_them() -> None:
    board = checkered(40)
    corners = np.array([[0.0, 0.0], [40.0, 0.0], [17.5, 31.25]])
    seen = DELTALAB_CAMERA.project(transformed(POSE, board.on_plate(corners)))
    assert cells_at(board, DELTALAB_CAMERA, POSE, seen) == pytest.approx(corners, abs=1e-9)
    assert board.on_plate(corners)[0] == pytest.approx([-146.0, 146.0, 0.0])  # the upper left one: y is up


def test_blur_moves_nothing_and_what_is_out_of_view_is_left_out() -> None:
    """The darkness of one dark square: its area and its centroid are those of the polygon that it is seen as."""
    board = Board(np.zeros((1, 1), dtype=bool), 40.0)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    along = np.linspace(0.0, 1.0, 200, endpoint=False)[:, None]
    outline = np.concatenate([a + along * (b - a) for a, b in itertools.pairwise(corners)])
    p = DELTALAB_CAMERA.project(transformed(POSE, board.on_plate(outline)))
    q = np.roll(p, -1, axis=0)
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    centroid = ((p + q) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())
    for blur in (0.0, 1.2):
        dark = 1.0 - bright_share(board, DELTALAB_CAMERA, POSE, blur=blur).astype(np.float64)
        row, column = np.indices(dark.shape)
        assert dark.sum() == pytest.approx(0.5 * abs(cross.sum()), rel=1e-4)
        found = np.array([(dark * column).sum(), (dark * row).sum()]) / dark.sum()
        assert found == pytest.approx(centroid, abs=5e-4)
    half = Pose(np.array([0.5 * 600.0 * 1024.0 / 903.2, 0.0, 600.0]), POSE.quaternion)
    cut = bright_share(checkered(10), DELTALAB_CAMERA, half, blur=1.0)
    assert cut.min() < 0.01
    assert (cut[:, :400] == 1.0).all()
    gone = Pose(np.array([3000.0, 0.0, 600.0]), POSE.quaternion)
    assert (bright_share(checkered(10), DELTALAB_CAMERA, gone, blur=1.0) == 1.0).all()


def test_boards_are_those_that_opencv_prints() -> None:
    aruco = opencv().aruco
    charuco, tags = Charuco(6, 10), AprilTags(3, 2)
    prints = aruco.CharucoBoard((6, 6), 10.0, 6.0, aruco.getPredefinedDictionary(aruco.DICT_4X4_50))
    grid = aruco.GridBoard((3, 3), 8.0, 2.0, aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11))
    for method, printed in ((charuco, prints), (tags, grid)):
        side = 10 * len(method.board.cells)
        image = printed.generateImage((side, side), marginSize=0, borderBits=1)
        assert (method.board.cells == (image[5::10, 5::10] > 127)).all()


@pytest.mark.parametrize(("method", "accuracy"), [(Charuco(8, 12), 0.05), (AprilTags(refinement="APRILTAG"), 0.15)])
def test_corners_without_noise_are_where_they_should_be(method: Charuco | AprilTags, accuracy: float) -> None:
    """As far as the method goes; the renderer's own accuracy is tested above."""
    image = render_board(method.board, DELTALAB_CAMERA, POSE, Scene(noise=0.0))
    found = method.measure(image, DELTALAB_CAMERA, boards.origin(method, DELTALAB_CAMERA))
    error = found.pixels - method.exact(DELTALAB_CAMERA, POSE)[found.numbers]
    assert len(error) == method.count
    assert np.sqrt(np.mean(error**2)) < accuracy
    assert found.pose.position == pytest.approx(POSE.position, abs=0.1)


def test_a_method_without_any_pose_has_no_errors() -> None:
    fake: Any = Fake()
    fake.moved = (None, None, None, None)
    (row,) = boards.studied("nominal", 2, 1, [fake])
    assert (row.failures, row.points, row.worst) == (2, 0.0, 0.0)
    assert np.isnan([row.pixels, row.lateral, row.depth, row.degrees]).all()
    assert boards._told(row)["pixels"] is None
    assert any("2 x no idea" in line for line in boards.printed([row]))


class Fake:
    """Finds the four corners of a square, wrongly in the way of its turn."""

    name, drawing, count = "fake", "square", 4
    moved = (np.zeros(3), np.array([0.0, 0.0, 9.0]), np.array([0.0, 3.0, 4.0]), None)

    def __init__(self) -> None:
        self.turn, self.pose = 0, POSE

    def draw(self, camera: Camera, pose: Pose, scene: Scene, seed: int) -> Image:
        self.pose = pose
        return np.zeros((1, 1), dtype=np.uint8)

    def measure(self, image: Image, camera: Camera, shift: object) -> FoundBoard:
        moved = self.moved[(self.turn - 1) % 4]
        self.turn += 1
        if self.turn == 1:
            moved = np.zeros(3)  # the first image tells the origin
        if moved is None:
            raise Failed("no idea")
        pixels = self.exact(camera, self.pose)[:3] + [0.02, 0.0]
        return FoundBoard(pixels, np.arange(3), Pose(self.pose.position + moved, self.pose.quaternion))

    def exact(self, camera: Camera, pose: Pose) -> np.ndarray:
        return np.arange(8.0).reshape(4, 2)


def test_failures_and_wrong_poses_count() -> None:
    (row,) = boards.studied("nominal", 4, 1, [Fake()])
    assert (row.images, row.failures, row.wrong, row.reasons) == (4, 1, 1, {"no idea": 1})
    assert (row.points, row.of) == (3.0, 4)
    assert row.pixels == pytest.approx(0.02 / np.sqrt(2.0))
    assert row.worst == pytest.approx(0.02)
    assert row.lateral == pytest.approx(np.sqrt(9.0 / 6.0))
    assert row.depth == pytest.approx(np.sqrt((81.0 + 16.0) / 3.0))
    assert row.degrees == pytest.approx(0.0, abs=1e-9)


def test_the_study_prints_a_table_and_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "boards.json"
    for name, value in ONE_THREAD.items():  # so that they are as before afterwards
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.argv", ["boards", "--images", "1", "--settings", "nominal", "-o", str(file)])
    boards.main()
    table, told = capsys.readouterr().out, json.loads(file.read_text(encoding="utf-8"))
    ours, *peers = told["rows"]
    assert [row["images"] for row in told["rows"]] == [1] * len(boards.methods())
    assert (ours["failures"], ours["wrong"]) == (0, 0)
    assert ours["pixels"] < 0.01 < min(row["pixels"] for row in peers)
    assert all(row["method"] in table and row["failures"] == 0 for row in peers)
