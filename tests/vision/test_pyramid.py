"""Pixel boxes as pyramids, and their rows: checked against exact fractions of what they enclose."""

from __future__ import annotations

from fractions import Fraction as F

import numpy as np
import pytest

from cpcal.common.errors import InputError
from cpcal.robot import Pose, normalised
from cpcal.solver.interval import Box, IntervalArray
from cpcal.vision.camera import DELTALAB_CAMERA, Camera
from cpcal.vision.pose_sets.enclosed import NAMES, Frames, PoseBox, exact, half_vector, rotation
from cpcal.vision.pose_sets.pose_rows import pose_rows
from cpcal.vision.pose_sets.sight import PixelBoxes, Pyramids, Sight, pixels_of, pyramids
from cpcal.vision.pose_sets.uncertain import CameraSet, TargetSet, curvatures, field_of_view, lens_bounds
from cpcal.vision.target import Target

MIDDLE = np.array([511.0, 380.0])
CAMERAS = (
    DELTALAB_CAMERA,
    Camera(1024, 768, np.array([600.0, 601.0]), MIDDLE, np.array([-0.33, 0.15, 1e-3, -1e-3, -0.03])),
    Camera(1024, 768, np.array([600.0, 601.0]), MIDDLE, np.array([-0.6, 0.0, 1e-3, -1e-3, 0.0])),
    Camera(640, 480, np.array([500.0, 520.0]), MIDDLE / 2, np.array([0.2, 0.1, 0.0, 0.0, 0.01])),
)


def exact_pixel(camera: Camera, x: F, y: F) -> list[F]:
    k1, k2, p1, p2, k3 = map(F, camera.distortion.tolist())
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent = (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )
    return [F(c) + F(f) * d for c, f, d in zip(camera.center.tolist(), camera.focal.tolist(), bent, strict=True)]


def in_the_field(camera: Camera, rng: np.random.Generator, count: int) -> np.ndarray:
    angle, radius = rng.uniform(-np.pi, np.pi, count), np.sqrt(rng.uniform(0.0, 1.0, count))
    return field_of_view(CameraSet(camera)).radius * radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("camera", CAMERAS)
def test_pixels_slopes_and_curvatures_are_enclosed(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    numbers = exact(camera.numbers)
    points = in_the_field(camera, rng, 50)
    pixels = pixels_of(camera, exact(points))
    for k, (x, y) in enumerate(points.tolist()):
        for low, value, high in zip(pixels.lo[k], exact_pixel(camera, F(x), F(y)), pixels.hi[k], strict=True):
            assert low <= value <= high
            assert high - low < 1e-9
    boxes = IntervalArray(points - 0.01, points + 0.01)
    bounds, bent = lens_bounds(boxes, numbers), curvatures(boxes, numbers)
    for corner in ((0.01, 0.01), (-0.01, 0.0), (0.0, 0.0)):
        jets = camera.jets(points + corner)
        inside, first, curved = bounds.jacobian, jets[:, [[2, 3], [3, 4]]], jets[:, 5:9]
        assert ((inside.lo <= first + 1e-12) & (first - 1e-12 <= inside.hi)).all()
        assert ((bent.lo <= curved + 1e-12) & (curved - 1e-12 <= bent.hi)).all()


@pytest.mark.parametrize("camera", CAMERAS)
def test_pyramids_hold_what_their_boxes_show_and_little_more(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.uniform([0.3, 0.3], [0.7, 0.7], (40, 2)) * [camera.width, camera.height]
    size = 0.1
    found = pyramids(CameraSet(camera), IntervalArray(pixels - size, pixels + size))
    for planes, lo, hi, pixel in zip(found.planes, found.lo, found.hi, pixels, strict=True):
        for corner in rng.choice([-1.0, 1.0], (5, 2)) * rng.choice([1.0, 0.3], (5, 1)):
            direction = camera.normalised(pixel + 0.9999999 * size * corner)
            shown = exact_pixel(camera, *map(F, direction.tolist()))
            assert max(abs(a - F(b)) for a, b in zip(shown, pixel.tolist(), strict=True)) <= F(size)
            assert (lo <= direction).all()
            assert (direction <= hi).all()
            point = [F(v) for v in (*direction.tolist(), 1.0)]
            assert all(sum(F(g) * x for g, x in zip(plane, point, strict=True)) <= 0 for plane in planes.tolist())
        for side in ([1.001, 0.0], [-1.001, 0.0], [0.0, 1.001], [0.0, -1.001]):
            direction = camera.normalised(pixel + size * np.array(side))
            assert (planes @ [*direction, 1.0]).max() > 0.0


@pytest.mark.parametrize("camera", CAMERAS)
def test_pyramids_hold_what_every_camera_of_a_set_shows(camera: Camera) -> None:
    rng = np.random.default_rng(2)
    widths = np.array([0.5, 0.5, 0.3, 0.3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3])
    for cameras in (
        CameraSet.intervals(camera, widths),
        CameraSet.ellipsoid(camera, np.diag(widths**2), 1.0),
    ):
        pixels = rng.uniform([0.3, 0.3], [0.7, 0.7], (20, 2)) * [camera.width, camera.height]
        found = pyramids(cameras, IntervalArray(pixels - 0.1, pixels + 0.1))
        for _ in range(5):
            t = rng.choice([-1.0, 1.0], cameras.size) * rng.choice([1.0, 0.5], cameras.size)
            t = 0.9999999 * (t / np.linalg.norm(t) if cameras.ball else t)
            other = camera.with_numbers(camera.numbers + cameras.spread @ t)
            direction = other.normalised(pixels + 0.0999999 * rng.choice([-1.0, 1.0], pixels.shape))
            rays = np.concatenate([direction, np.ones((20, 1))], axis=1)
            values = (found.planes @ rays[:, :, None])[..., 0] + found.shared @ t
            assert (values <= 0.0).all()
            assert ((found.lo <= direction) & (direction <= found.hi)).all()


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_field_is_what_the_image_shows_before_the_lens_turns_back(camera: Camera) -> None:
    field = field_of_view(CameraSet(camera))
    points = in_the_field(camera, np.random.default_rng(5), 2000)
    slopes = np.linalg.eigvalsh(camera.distortion_jacobian(points))
    assert slopes.min() >= field.least_slope > 0.0
    middle = camera.normalised(np.array([[0.35, 0.35], [0.65, 0.65]]) * [camera.width, camera.height])
    assert (np.linalg.norm(middle, axis=1) < field.radius).all()


def test_boxes_beside_the_image_are_refused() -> None:
    lo = np.array([[500.0, 300.0], [5000.0, 300.0]])
    with pytest.raises(InputError, match="pixel box 1"):
        pyramids(CameraSet(DELTALAB_CAMERA), IntervalArray(lo, lo + 1.0))


def exact_rotation(q: list[F]) -> list[list[F]]:
    w, x, y, z = q
    n = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return [[v / n for v in row] for row in rows]


def times(matrix: list[list[F]], vector: list[F]) -> list[F]:
    return [sum((a * b for a, b in zip(row, vector, strict=True)), F()) for row in matrix]


def plus(left: list[F], right: list[F]) -> list[F]:
    return [a + b for a, b in zip(left, right, strict=True)]


def fractions(values: np.ndarray) -> list[F]:
    return [F(v) for v in values.tolist()]


def drawn_motion(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-300.0, 300.0, 3), rng.standard_normal(4))


def test_rows_are_what_the_geometry_says() -> None:
    """Each row is (1 + s.s) g.X, times one power of two for all, or less by no more than its rounding."""
    rng = np.random.default_rng(2)
    frames, center = Frames(drawn_motion(rng), drawn_motion(rng)), drawn_motion(rng)
    dots, planes = rng.uniform(-150.0, 150.0, (3, 2)), rng.uniform(-900.0, 900.0, (3, 4, 3))
    points = np.concatenate([dots, np.zeros((3, 1))], axis=1)
    size = np.array([20.0, 20.0, 20.0, 0.05, 0.05, 0.05])
    nothing = np.zeros((3, 2))
    seen = Pyramids(planes, np.zeros((3, 4, 0)), nothing, nothing, nothing)
    target, boxes = TargetSet.of(Target("three", dots, 1e-3, ())), PixelBoxes(np.arange(3), nothing, nothing)
    whole = PoseBox(center, IntervalArray(-size[:3], size[:3]), IntervalArray(-size[3:], size[3:]))
    sight = Sight(boxes, target, CameraSet(DELTALAB_CAMERA), frames)
    rows = pose_rows(sight, seen, whole, Box(NAMES, -size, size))
    values, expected = [], []
    for x in rng.uniform(-size, size, (4, 6)):
        moved, s = fractions(x[:3]), fractions(x[3:])
        stretch = 1 + sum(v * v for v in s)
        turn, near = exact_rotation([F(1), *s]), exact_rotation(fractions(center.quaternion))
        position = plus(fractions(center.position), [v / stretch for v in moved])
        for k, point in enumerate(points):
            mobile = plus(
                fractions(frames.target.position),
                times(exact_rotation(fractions(frames.target.quaternion)), fractions(point)),
            )
            base = plus(position, times(turn, times(near, mobile)))
            shown = plus(
                fractions(frames.camera.position), times(exact_rotation(fractions(frames.camera.quaternion)), base)
            )
            for j in range(4):
                expected.append(stretch * sum(F(g) * v for g, v in zip(planes[k, j].tolist(), shown, strict=True)))
                r = 4 * k + j
                pairs = [s[0] ** 2, s[1] ** 2, s[2] ** 2, s[0] * s[1], s[0] * s[2], s[1] * s[2]]
                terms = [F(a) * b for a, b in zip(rows.linear[r].tolist(), [*moved, *s], strict=True)]
                terms += [F(a) * b for a, b in zip(rows.bilinear[r].tolist(), pairs, strict=True)]
                values.append(sum(terms, F(float(rows.constant[r]))))
    scale = F(2) ** round(np.log2(float(values[0] / expected[0])))
    for value, wanted in zip(values, expected, strict=True):
        assert 0 <= scale * wanted - value < F(1e-8)


def test_boxes_about_another_centre_hold_the_same_poses() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        center = Pose(rng.uniform(-300.0, 300.0, 3), normalised(rng.standard_normal(4)))
        size, half = rng.uniform(0.0, 5.0, 3), rng.uniform(0.0, 0.1, 3)
        box = PoseBox(center, IntervalArray(-size, 2.0 * size), IntervalArray(-half, 2.0 * half))
        again = box.about(box.middle)
        assert again is not None
        x = rng.uniform(np.concatenate([-size, -half]), 2.0 * np.concatenate([size, half]))
        turned = times_quaternion([F(1), *fractions(x[3:])], fractions(center.quaternion))
        to = fractions(again.center.quaternion)
        w, *v = times_quaternion(turned, [to[0], -to[1], -to[2], -to[3]])
        for k in range(3):
            assert again.half_turn.lo[k] <= v[k] / w <= again.half_turn.hi[k]
            moved = F(float(x[k])) + F(float(center.position[k])) - F(float(again.center.position[k]))
            assert again.position.lo[k] <= moved <= again.position.hi[k]
        assert (again.half_turn.rad <= 1.1 * box.half_turn.rad.max()).all()
    opposite = Pose(
        box.center.position, np.array(times_quaternion(box.center.quaternion.tolist(), [0.0, 1.0, 0.0, 0.0]))
    )
    assert box.about(opposite) is None


def times_quaternion(p, q):
    return [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    ]


def test_half_vectors_of_rotations() -> None:
    rng = np.random.default_rng(4)
    for s in rng.standard_normal((20, 3)):
        found = half_vector(rotation([1.0, *s]))
        assert found is not None
        assert ((found.lo <= s) & (s <= found.hi)).all()
    assert half_vector(rotation([0.0, 1.0, 0.0, 0.0])) is None
