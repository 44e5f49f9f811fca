"""Targets that people have, in rendered images and in real photographs: found, and where they are."""

from pathlib import Path

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.common.values import Floats
from cpcal.models.sight import PixelBoxes, enclose_pose
from cpcal.robot import Pose, quaternion_conjugate, quaternion_from_rotation_vector, quaternion_product, rotation_vector
from cpcal.vision.calibrate import calibrate_from_images
from cpcal.vision.camera import Camera
from cpcal.vision.files.target_print import dark_squares
from cpcal.vision.measure import DEVIATION, NotMeasured, measure_pose
from cpcal.vision.opencv import Grey, opencv
from cpcal.vision.pose import estimate_pose
from cpcal.vision.render import Scene, exposed, overlay, render
from cpcal.vision.target import Board, Target, target_from

CAMERA = Camera(640, 480, [800.0, 802.0], [322.0, 238.0], [-0.12, 0.05, 3e-4, -2e-4, 0.0])
FISHEYE = Camera(640, 480, [500.0, 501.0], [321.0, 241.0], [0.05, -0.02, 0.004, -0.001], "fisheye")
RATIONAL = Camera(640, 480, [800.0, 802.0], [322.0, 238.0], [0.3, 0.05, 3e-4, -2e-4, 0.01, 0.4, 0.02, 0.0], "rational")
_MM, _FINE = 5, 3  # pixels of the picture a mm; places in a pixel each way


def seen_at(depth: float, *vector: float, target: Target) -> Pose:
    """The middle of a target before the camera, turned from facing it by a rotation vector."""
    quaternion = quaternion_from_rotation_vector(np.array(vector))
    pose = Pose(np.zeros(3), quaternion)
    return Pose(np.array([8.0, -5.0, depth]) - pose.rotation @ target.points.mean(axis=0), quaternion)


def photographed(target: Target, camera: Camera, pose: Pose, scene: Scene, seed: int = 0) -> Grey:
    """A printed board, whose picture is looked up along the ray of every fine pixel."""
    if not target.printed:
        return render(target, camera, pose, scene, seed=seed)
    cv2, squares = opencv(), dark_squares(Board.parsed(target.board))
    low = squares[:, :2].min(axis=0) - 30.0
    size = np.ceil(((squares[:, :2] + squares[:, 2:]).max(axis=0) + 30.0 - low) * _MM).astype(int)
    picture = np.full(size[::-1], 255, dtype=np.uint8)
    for x, y, side in np.rint((squares - [*low, 0.0]) * _MM).astype(int).tolist():
        picture[y : y + side, x : x + side] = 0
    x = (np.arange(camera.width * _FINE) + 0.5) / _FINE - 0.5
    y = (np.arange(camera.height * _FINE) + 0.5) / _FINE - 0.5
    rays = camera.normalised(np.stack(np.meshgrid(x, y), axis=-1))
    plane = np.linalg.inv(np.column_stack([pose.rotation[:, :2], pose.position]))
    at = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) @ plane.T
    places = ((at[..., :2] / at[..., 2:] - low) * _MM - 0.5).astype(np.float32)
    fine = cv2.remap(picture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderValue=255)
    share = fine.reshape(camera.height, _FINE, camera.width, _FINE).mean(axis=(1, 3)).astype(np.float32) / 255.0
    return exposed(cv2.GaussianBlur(share, (0, 0), scene.blur), scene, seed=seed)


BOARDS = {
    "acircles:4x7:20:16": 550.0,
    "chessboard:7x6:20": 420.0,
    "charuco:6x5:30:20:4X4_50": 420.0,
    "grid:4x3:32:8:APRILTAG_36h11": 420.0,
}


@pytest.mark.parametrize(
    ("text", "camera"),
    [
        *((text, CAMERA) for text in BOARDS),
        ("acircles:4x7:20:16", FISHEYE),
        ("acircles:4x7:20:16", RATIONAL),
        *(
            pytest.param(text, lens, marks=pytest.mark.nightly)
            for text in [*BOARDS][1:]
            for lens in (FISHEYE, RATIONAL)
        ),
    ],
)
def test_a_board_is_found_where_it_is(text: str, camera: Camera) -> None:
    """With any lens; nothing is mistaken, residuals are as large as stated, and a proved set of poses holds the true
    one where the lens is one that proofs know."""
    target = target_from(text)
    depth = BOARDS[text] * camera.focal[0] / CAMERA.focal[0]
    for k, vector in enumerate(((0.25, 0.1, 0.1), (-0.2, 0.3, -0.3))):
        pose = seen_at(depth, *vector, target=target)
        image = photographed(target, camera, pose, Scene(blur=0.8, noise=2.0), seed=k)
        found = measure_pose(image, target, camera)
        assert len(found.numbers) >= 0.9 * len(target.dots)
        off = found.centers - camera.project(target.points[found.numbers] @ pose.rotation.T + pose.position)
        assert np.abs(off).max() < 0.5
        assert np.abs(found.pose.position - pose.position).max() < (0.02 if not target.printed else 0.6)
        stated = DEVIATION.get(text.partition(":")[0])
        assert stated is None or 0.2 * stated < found.estimate.rms < 2.0 * stated
        assert overlay(image, found, target, camera, 320)
        boxes = PixelBoxes.around(found.numbers, found.centers, 5.0 * (stated or 0.01), of_images=True)
        if camera is CAMERA:
            assert pose in enclose_pose(boxes, target, camera)
            continue
        with pytest.raises(InputError, match=f"camera: has a lens of the model {camera.model}"):
            enclose_pose(boxes, target, camera)


@pytest.mark.parametrize("text", ["circles:7x5:20:12", "chessboard:8x6:20"])
def test_a_board_that_looks_the_same_turned_needs_a_hint(text: str) -> None:
    target = target_from(text)
    for turn, side in ((np.pi / 2.0, "right"), (np.pi - 0.1, "bottom")):
        spin = quaternion_from_rotation_vector(np.array([0.0, 0.0, turn]))
        pose = Pose(np.zeros(3), spin)
        pose = Pose(np.array([0.0, 0.0, 520.0]) - pose.rotation @ target.points.mean(axis=0), spin)
        image = photographed(target, CAMERA, pose, Scene(), seed=2)
        with pytest.raises(NotMeasured, match="ambiguous: the target looks the same when it is turned"):
            measure_pose(image, target, CAMERA)
        near = Pose(pose.position + [5.0, -8.0, 20.0], pose.quaternion)
        for hint in (side, near):
            found = measure_pose(image, target, CAMERA, first_row=hint)
            assert np.abs(found.pose.position - pose.position).max() < 0.5
        if turn != np.pi / 2.0:
            continue
        with pytest.raises(NotMeasured, match="not clearly where the hint says"):
            measure_pose(image, target, CAMERA, first_row="top")


@pytest.mark.parametrize(
    "text",
    [
        "acircles:4x11:16:14",
        pytest.param("circles:7x5:20:12", marks=pytest.mark.nightly),
        pytest.param("charuco:6x5:30:20:4X4_50", marks=pytest.mark.nightly),
    ],
)
def test_a_camera_is_calibrated_from_a_board(text: str) -> None:
    target, images = target_from(text), []
    for k, (x, y) in enumerate(((0.5, 0.0), (-0.5, 0.2), (0.0, 0.5), (0.2, -0.5), (-0.3, -0.4), (0.1, 0.1))):
        pose = seen_at(480.0 if "11" in text else 430.0, x, y, 0.1 * k, target=target)
        images.append(photographed(target, CAMERA, pose, Scene(), seed=k))
    found = calibrate_from_images(images, target)
    assert all(not view.reason for view in found.views)
    assert (np.abs(found.camera.numbers - CAMERA.numbers) < 5.0 * found.standard_errors).all()
    assert found.standard_errors[0] < 8.0


# Eight photographs of an asymmetric circle grid on a wooden, scratched table, by a camera on a robot's hand.

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "circle_grid"
LENS = [-0.0450238, -0.00447247, 0.00013755, -0.000281302, 0.866311]
ROBOT_CAMERA = Camera(1920, 1200, [2069.9, 2069.45], [955.283, 588.688], LENS)


def opencv_rms(image: Grey, target: Target) -> tuple[Floats, float]:
    """OpenCV's centres, and what its pose leaves of them, pixels per axis."""
    cv2 = opencv()
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
    centers = cv2.findCirclesGrid(255 - image, (7, 11), flags=flags)[1].reshape(-1, 2)
    matrix = np.diag([*ROBOT_CAMERA.focal, 1.0])
    matrix[:2, 2] = ROBOT_CAMERA.center
    _, turn, place = cv2.solvePnP(target.points, centers, matrix, ROBOT_CAMERA.distortion)
    predicted = cv2.projectPoints(target.points, turn, place, matrix, ROBOT_CAMERA.distortion)[0].reshape(-1, 2)
    return centers, float(np.sqrt(((predicted - centers) ** 2).mean()))


@pytest.mark.real_data
@pytest.mark.skipif(not FOLDER.exists(), reason=f"the photographs of a circle grid are not at {FOLDER}")
@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.nightly)])
def test_eight_real_circle_grids_fit_better_than_opencvs_centres(step: int) -> None:
    """All are found, none is wrong; residuals are smaller in each, and two halves of the board tell the same pose
    (its middle, and its rotation) more nearly, along each axis."""
    target = target_from("acircles:7x11:10:8")  # the diameter is that of the images
    apart, middle = [], target.points.mean(axis=0)
    for k in range(0, 8, step):
        image = opencv().imread(str(FOLDER / f"image{k}.png"), opencv().IMREAD_GRAYSCALE)
        found = measure_pose(image, target, ROBOT_CAMERA)
        centers, rms = opencv_rms(image, target)
        assert len(found.numbers) >= 76
        assert not len(found.identification.false)
        assert np.linalg.norm(centers[found.numbers] - found.centers, axis=1).max() < 0.25
        assert found.estimate.rms < 0.9 * rms
        spread = found.dots.covariance[found.identification.found][~found.estimate.outliers]
        for seen in (found.centers, centers[found.numbers]):
            halves = [
                estimate_pose(seen[part], spread[part], found.numbers[part], target, ROBOT_CAMERA).pose
                for part in (found.numbers % 7 < 4, found.numbers % 7 >= 3)
            ]
            turn = quaternion_product(halves[0].quaternion, quaternion_conjugate(halves[1].quaternion))
            places = [half.rotation @ middle + half.position for half in halves]
            apart.append(np.concatenate([places[0] - places[1], rotation_vector(turn)]))
    if step > 1:
        return  # three images say little of halves
    ours, theirs = (np.sqrt(np.mean(np.square(apart[who::2]), axis=0)) for who in (0, 1))
    assert (ours < theirs).all()
    assert (ours < [0.005, 0.003, 0.1, 0.0006, 0.001, 0.0002]).all()  # mm, rad


def test_what_is_no_board_is_refused_with_the_reason() -> None:
    empty = np.full((480, 640), 200, dtype=np.uint8)
    for text in ("chessboard:7x6:20", "charuco:6x5:30:20:4X4_50", "grid:4x3:32:8:APRILTAG_36h11"):
        with pytest.raises(NotMeasured, match=f"the board {text} is not found"):
            measure_pose(empty, target_from(text), CAMERA)
