"""Images without dots, of something else, and what is no image."""

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.robot import Pose, quaternion_from_rotation_vector
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.dots import observe_dots
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene, render
from cpcal.vision.target import DELTALAB_TARGET

SHAPE = (480, 640)


@pytest.fixture(scope="module")
def image():
    pose = Pose(np.array([0.0, 0.0, 700.0]), quaternion_from_rotation_vector([np.pi, 0.2, 0.1]))
    return render(DELTALAB_TARGET, DELTALAB_CAMERA, pose, Scene())


@pytest.mark.parametrize(
    "value",
    [
        None,
        "image.png",
        [[1, 2], [3, 4]],
        np.zeros((0, 0), np.uint8),
        np.zeros((5, 5, 0), np.uint8),
        np.zeros(640, np.uint8),
        np.zeros((5, 5, 2), np.uint8),
        np.zeros((2, 5, 5, 3), np.uint8),
        np.zeros(SHAPE),
        np.zeros((5, 5), object),
        np.broadcast_to(np.uint8(0), (20_000, 20_000)),
        np.broadcast_to(np.uint8(0), (1, 40_000)),
    ],
    ids=lambda value: f"{type(value).__name__}{getattr(value, 'shape', '')}{getattr(value, 'dtype', '')}",
)
def test_what_is_no_image_is_refused(value):
    with pytest.raises(InputError) as refused:
        observe_dots(value)
    assert "give an array" in refused.value.problems[0].remedy


def test_checkerboards_stripes_squares_and_ramps_have_no_dots():
    cv2 = opencv()
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    pictures = [x % 256, 255 * ((x // 12) % 2), np.tile(np.linspace(0, 255, SHAPE[1]), (SHAPE[0], 1))]
    for side in (9, 20, 40):
        pictures.append(255 * ((x // side + y // side) % 2))
        pictures.append(np.where((x % (3 * side) < side) & (y % (3 * side) < side), 220, 20))
    for picture in pictures:
        plain = picture.astype(np.uint8)
        turn = cv2.getRotationMatrix2D((320, 240), 30, 1.0)
        for one in (plain, cv2.GaussianBlur(plain, (0, 0), 0.7), cv2.warpAffine(plain, turn, SHAPE[::-1])):
            assert len(observe_dots(one)) <= 1


def test_saturated_and_dim_dots_are_found_and_hopelessly_blurred_ones_are_not(image):
    number = len(DELTALAB_TARGET.dots)
    assert len(observe_dots(np.minimum(image.astype(np.int64) * 2, 255).astype(np.uint8))) == number
    assert len(observe_dots(image // 8)) == number
    assert len(observe_dots(np.full_like(image, 255) * (image > 0))) <= 1
    assert len(observe_dots(opencv().GaussianBlur(image, (0, 0), 25.0))) == 0
