"""Dots in rendered images: accuracy, honesty of the stated errors, and whatever else an image may look like or be."""

import itertools

import numpy as np
import pytest

from benchmarks.vision_scenes import DotErrors, errors, facing_poses, true_centers
from cpcal.common.errors import InputError
from cpcal.robot import Pose, quaternion_from_rotation_vector
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.dots import observe_dots
from cpcal.vision.opencv import opencv
from cpcal.vision.render import Scene, render
from cpcal.vision.target import DELTALAB_TARGET, Target

TILTED = Pose(np.array([10.0, -5.0, 650.0]), quaternion_from_rotation_vector([np.pi - 0.4, 0.15, 0.1]))


def plate(radius: float, pitch: float, bright: bool) -> Target:
    """6 x 6 dots; at a distance of the focal length a millimetre is a pixel."""
    ticks = (np.arange(6) - 2.5) * pitch
    return Target("plate", np.array(list(itertools.product(ticks, ticks))), radius, bright)


def collected(found: list[DotErrors]) -> tuple[np.ndarray, np.ndarray]:
    assert sum(e.missing for e in found) == 0
    assert sum(e.false for e in found) == 0
    return np.concatenate([e.pixels for e in found]), np.concatenate([e.normalised for e in found])


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).mean(axis=0))


def test_errors_are_a_hundredth_of_a_pixel_and_as_stated():
    found = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        scene = Scene(rng.uniform(0.5, 1.2), rng.uniform(1.0, 4.0), gradient=tuple(rng.uniform(-0.4, 0.4, 2)))
        found.append(errors(DELTALAB_TARGET, DELTALAB_CAMERA, facing_poses(rng, 1).rows(0), scene, seed))
    pixels, _ = collected(found)
    assert (rms(pixels) < 0.01).all()
    bound = float(np.sqrt((np.concatenate([e.bound for e in found]) ** 2).mean()))
    assert (rms(pixels) < 1.08 * bound).all()  # the Cramer-Rao bound for a known edge
    assert np.abs(pixels).max() < 0.05
    assert np.abs(pixels.mean(axis=0)).max() < 0.001


@pytest.mark.parametrize(("blur", "noise"), [(0.5, 4.0), (1.2, 1.0)])
def test_stated_errors_are_calibrated_at_each_condition(blur, noise):
    scene = Scene(blur, noise, gradient=(0.4, -0.4))
    poses = [facing_poses(np.random.default_rng(100 + seed), 1).rows(0) for seed in range(3)]
    found = [errors(DELTALAB_TARGET, DELTALAB_CAMERA, pose, scene, seed) for seed, pose in enumerate(poses)]
    pixels, normalised = collected(found)
    assert ((rms(normalised) > 0.85) & (rms(normalised) < 1.15)).all()
    assert (rms(pixels) < 0.0125).all()  # the bound at the last one is 0.0104


def test_without_noise_only_rounding_is_left():
    """Of 16 bits, so that it shows the renderer's and the model's own errors; 8 bits leave 0.0006 pixels."""
    for blur in (0.5, 1.2):
        pixels, normalised = collected(
            [errors(plate(6.0, 40.0, True), DELTALAB_CAMERA, TILTED, Scene(blur, 0.0, bits=16), bright=True)]
        )
        assert np.abs(pixels).max() < 0.001
        assert (rms(normalised) < 1.15).all()


@pytest.mark.parametrize(
    ("radius", "gap", "bright"), [(2.5, 5.0, True), (4.0, 5.0, False), (15.0, 15.0, True), (40.0, 30.0, False)]
)
def test_dots_of_any_size_close_together(radius, gap, bright):
    pose = Pose(np.array([3.0, 7.0, 903.2]), quaternion_from_rotation_vector([np.pi - 0.2, 0.1, 0.1]))
    target = plate(radius, 2.0 * radius + gap, bright)
    scenes = [Scene(blur, 2.0, gradient=(0.3, -0.2)) for blur in (0.5, 1.2)]
    found = [errors(target, DELTALAB_CAMERA, pose, scene, seed) for seed, scene in enumerate(scenes)]
    pixels, normalised = collected(found)
    assert len(pixels) == 72
    assert (rms(pixels) < 0.02 / np.sqrt(radius)).all()
    assert ((rms(normalised) > 0.7) & (rms(normalised) < 1.3)).all()


def test_every_kind_of_image_shows_the_same_dots():
    image = render(DELTALAB_TARGET, DELTALAB_CAMERA, TILTED, Scene(gradient=(0.3, 0.2)))
    expected = observe_dots(image, bright=True)
    assert expected.bright
    assert ((expected.quality > 0.9) & (expected.quality <= 1.0)).all()
    assert (expected.axes[:, 0] >= expected.axes[:, 1]).all()
    assert (np.linalg.eigvalsh(expected.covariance) > 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        expected.centers[0] = 0.0
    assert len(expected) == len(DELTALAB_TARGET.dots)
    colours = np.repeat(image[..., None], 4, axis=2)
    kinds = [image, image[..., None], colours[..., :3], colours, image.astype(np.uint16) * 257]
    kinds += [image.astype(np.uint16), (image.astype(np.uint16) * 16).astype(">u2"), np.asfortranarray(image)]
    for kind in kinds:
        found = observe_dots(kind)
        assert found.bright
        assert np.abs(found.centers - expected.centers).max() < 1e-3
        assert np.allclose(found.covariance, expected.covariance, rtol=0.05, atol=5e-7)
        assert np.array_equal(observe_dots(kind).centers, found.centers)
    dark = observe_dots(255 - image)
    assert not dark.bright
    assert len(dark) == len(expected)
    assert len(observe_dots(image, bright=False)) == 0
    shifted = observe_dots(image[7:, 11:])
    off = np.linalg.norm(shifted.centers + [11.0, 7.0] - expected.centers[:, None], axis=2)
    assert max(off.min(axis=0).max(), off.min(axis=1).max()) < 2e-3


def test_dots_at_the_border_are_left_out():
    pose = Pose(np.array([-228.0, 0.0, 600.0]), TILTED.quaternion)
    found = observe_dots(render(DELTALAB_TARGET, DELTALAB_CAMERA, pose, Scene(noise=1.0)), bright=True)
    true = true_centers(DELTALAB_TARGET, DELTALAB_CAMERA, pose)
    apart = np.linalg.norm(found.centers[:, None] - true, axis=-1).min(axis=1)
    assert apart.max() < 0.02  # a cut dot's centre would be off by far more
    low, high = true.min(axis=1), (true - [DELTALAB_CAMERA.width - 1, DELTALAB_CAMERA.height - 1]).max(axis=1)
    cut = (low < 9.0) | (high > -9.0)
    assert (cut & (low > -9.0) & (high < 9.0)).any()  # so that the question was asked
    assert len(found) <= (~cut).sum()
    assert len(found) >= ((low > 18.0) & (high < -18.0)).sum()


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
        for shown in (plain, cv2.GaussianBlur(plain, (0, 0), 0.7), cv2.warpAffine(plain, turn, SHAPE[::-1])):
            assert len(observe_dots(shown)) <= 1


def test_saturated_and_dim_dots_are_found_and_hopelessly_blurred_ones_are_not(image):
    number = len(DELTALAB_TARGET.dots)
    assert len(observe_dots(np.minimum(image.astype(np.int64) * 2, 255).astype(np.uint8))) == number
    assert len(observe_dots(image // 8)) == number
    assert len(observe_dots(np.full_like(image, 255) * (image > 0))) <= 1
    assert len(observe_dots(opencv().GaussianBlur(image, (0, 0), 25.0))) == 0
