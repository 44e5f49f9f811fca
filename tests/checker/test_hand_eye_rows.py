"""The rows of hand-eye studies, derived in exact numbers, hold at exact truths and fail where they should."""

import math
from dataclasses import replace
from fractions import Fraction as F

import numpy as np
import pytest
from flint import arb, fmpq

from cpcal.checker import Refused
from cpcal.checker.bounds import numbers
from cpcal.checker.frames import EQUATIONS, SIDES, Rows, Study, asked_box, holds
from cpcal.checker.hand_eye import errors
from cpcal.checker.lens import distorted
from cpcal.checker.rule import Box
from tests.checker.proofs import across, applied, rotation_of, times, value_at
from tests.vision.test_camera import LENSES

SETUPS = [True, False]


def rational(random, count, scale, power=20):
    return tuple(F(int(v), 1 << power) for v in (random.uniform(-scale, scale, count) * (1 << power)).round())


def turned(q):
    return rotation_of([F(int(v * (1 << 40)), 1 << 40) for v in q])


def truth_of(random, in_hand, *, wide):
    """A study whose pixels are exact for its frames at readings of its poses, and all unknowns at the truth."""
    near = np.array([1.0, 0.1, -0.2, 0.3])
    x_q, f_q = (tuple(F(int(v), 1 << 20) for v in (near + random.uniform(-0.2, 0.2, 4)) * (1 << 20)) for _ in "xf")
    x_turn, x_place = turned(x_q), rational(random, 3, 50.0)
    poses, widths, readings, seen = [], [], [], []
    for _ in range(3):
        q, place = rational(random, 4, 1.0), rational(random, 3, 300.0)
        half = (F(1, 2),) * 3 + (F(1, 1024),) * 3 if wide else (F(0),) * 6
        reading = [F(int(s)) * h for s, h in zip(random.choice([-1, 1], 6), half, strict=True)]
        more = turned([F(1), *(v / 2 for v in reading[3:])])
        poses.append((place, q))
        widths.append(half)
        readings.append(reading)
        seen.append((times(more, turned(q)), [p + d for p, d in zip(place, reading[:3], strict=True)]))
    # the board is 700 mm before the camera in the first image, whatever the others see
    f_turn = turned(f_q)
    turn, place = seen[0]
    before = [a + b for a, b in zip(applied(x_turn, [F(10), F(-20), F(700)]), x_place, strict=True)]
    board_place = applied(across(turn), [b - p for b, p in zip(before, place, strict=True)])
    if in_hand:
        board_place = [a + p for a, p in zip(applied(turn, before), place, strict=True)]
    f_place = tuple(board_place)
    images, names, rays, points = [], [], [], []
    focal, center = (F(1000), F(1001)), (F(640), F(481))
    a_of = []
    for k, (turn, place) in enumerate(seen):
        back = across(turn)
        h = (back, [-v for v in applied(back, place)]) if in_hand else (turn, place)
        a = times(across(x_turn), times(h[0], f_turn))
        offset = applied(
            across(x_turn), [u + v - w for u, v, w in zip(applied(h[0], f_place), h[1], x_place, strict=True)]
        )
        a_of.append((a, offset))
        for n in range(4):
            p = rational(random, 3, 60.0)
            x = [u + v for u, v in zip(applied(a, p), offset, strict=True)]
            images.append(k)
            names.append(f"p{n}")
            points.append(p)
            rays.append(tuple(c + f * v / x[2] for c, f, v in zip(center, focal, x, strict=False)))
    # pixels are dyadic in a study; what that changes of them is their half-width
    short = [tuple(F(round(v * 2**30), 2**30) for v in ray) for ray in rays]
    study = Study(
        in_hand, focal, center, ("a", "b", "c"), tuple(poses), tuple(widths), tuple(images), tuple(names),
        tuple(short), tuple(points), (F(1, 2**30),) * len(names),
    )  # fmt: skip
    return study, (x_turn, x_place, f_turn, f_place), readings, a_of


def unknowns(rows, truth, readings, a_of, hand, board):
    """The values of all unknowns of a stage."""
    x_turn, x_place, f_turn, f_place = truth
    at = [v for row in x_turn for v in row] + list(x_place) + [v for row in f_turn for v in row] + list(f_place)
    at += applied(across(x_turn), [w - t for w, t in zip(hand, x_place, strict=True)])
    at += [a + b for a, b in zip(applied(f_turn, board), f_place, strict=True)]
    if rows.stage == "image":
        at = []
    for k in rows.first:
        a, offset = a_of[k]
        at += [v for row in a for v in row] + [u + v for u, v in zip(applied(a, board), offset, strict=True)]
        if rows.stage == "links" and rows.wide:
            s = [v / 2 for v in readings[k][3:]]
            scale = 1 + sum(v * v for v in s)
            at += [2 * v / scale for v in s] + list(readings[k][:3])
    assert len(at) == rows.size
    return at


@pytest.mark.parametrize("in_hand", SETUPS)
@pytest.mark.parametrize(("stage", "wide"), [("image", True), ("links", False), ("links", True), ("frames", False)])
@pytest.mark.parametrize("seed", range(3))
def test_every_row_holds_at_the_truth_and_equations_are_met(in_hand, stage, wide, seed):
    random = np.random.default_rng(seed)
    study, truth, readings, a_of = truth_of(random, in_hand, wide=wide)
    hand, board = rational(random, 3, 40.0, 3), rational(random, 3, 10.0, 3)
    box = Box((F(-1),) * 9 + (F(-9000),) * 21, (F(1),) * 9 + (F(9000),) * 21)
    sets = {}
    for k in (0, 1):
        a, offset = a_of[k]
        pose = [v for row in a for v in row] + [u + v for u, v in zip(applied(a, board), offset, strict=True)]
        low = tuple(F((v * 2**20).__floor__(), 2**20) for v in pose)
        sets[k] = low, tuple(v + F(1, 2**20) for v in low)
    front = [k for k, error in enumerate(errors_at(study, truth, readings)) if error is not None]
    images = [0] if stage == "image" else front
    rows = Rows(study, stage, images, F(0), hand, board, {k: v for k, v in sets.items() if k in images}, box)
    at, kinds = unknowns(rows, truth, readings, a_of, hand, board), set()
    for side, k in rows.tags:
        found = value_at(rows.row(side, k), at)
        assert found <= 0, (side, k)
        kinds.add(side)
        if side[:-1] in ("turn", "tie") or (side[:-1] == "link" and not wide):
            assert found == 0, (side, k)
    root = rows.root
    assert all(lo <= v <= hi for lo, v, hi in zip(root.lo, at, root.hi, strict=True))
    assert len(kinds) == {"image": 6, "links": 10, "frames": 10}[stage]


def errors_at(study, truth, readings):
    """The checker's own errors, by quaternions of the true frames that are exact for their matrices."""
    x_turn, x_place, f_turn, f_place = truth

    def quaternion(m):
        w = 1 + m[0][0] + m[1][1] + m[2][2]
        return [w, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]

    def whole(q):  # rational quaternions are as good as dyadic ones: times what they are divided by
        common = 1
        for v in q:
            common *= v.denominator
        return [v * common for v in q]

    placed = [*x_place, *whole(quaternion(x_turn)), *f_place, *whole(quaternion(f_turn))]
    return errors(study, placed, readings if study.uncertain else ())


@pytest.mark.parametrize("in_hand", SETUPS)
@pytest.mark.parametrize("wide", [False, True])
def test_errors_of_the_truth_are_what_rounding_left_of_its_pixels(in_hand, wide):
    study, truth, readings, _ = truth_of(np.random.default_rng(7), in_hand, wide=wide)
    assert errors_at(study, truth, readings)[0] == 0  # within the half-width
    off = replace(study, rays=tuple((u + 1, v) for u, v in study.rays))
    assert F(99, 100) < errors_at(off, truth, readings)[0] <= 1 + F(1, 2**29)


def test_points_behind_the_camera_have_no_error():
    study, (x_turn, x_place, *target), readings, _ = truth_of(np.random.default_rng(7), True, wide=False)
    back = [[a, -b, -c] for a, b, c in x_turn]  # the camera looks the other way
    assert errors_at(study, (back, x_place, *target), readings)[0] is None


@pytest.mark.parametrize("in_hand", SETUPS)
def test_rows_fail_for_a_pixel_beyond_the_tolerance_and_a_reading_beyond_its_half_width(in_hand):
    random = np.random.default_rng(3)
    study, truth, readings, a_of = truth_of(random, in_hand, wide=True)
    hand = board = (F(0),) * 3
    box = Box((F(-1),) * 9 + (F(-2000),) * 21, (F(1),) * 9 + (F(2000),) * 21)
    moved = replace(study, rays=tuple((u + F(1, 8), v) for u, v in study.rays))
    for eps, fails in ((F(7, 64), True), (F(9, 64), False)):
        rows = Rows(moved, "image", [0], eps, hand, board, {}, box)
        at = unknowns(rows, truth, readings, a_of, hand, board)
        assert any(value_at(rows.row(side, n), at) > 0 for side in SIDES[:4] for n in range(4)) == fails
    rows = Rows(study, "links", [0], F(0), hand, board, {}, box)
    at = unknowns(rows, truth, readings, a_of, hand, board)
    for j in (12, 15):  # w and d of the image
        off = list(at)
        off[rows.first[0] + j] = -off[rows.first[0] + j]
        assert any(value_at(rows.row(side, k), off) > 0 for side in SIDES[8:10] for k in range(12))


def test_rows_that_are_none_are_refused():
    study, *_ = truth_of(np.random.default_rng(0), True, wide=False)
    box = Box((F(-1),) * 9 + (F(-2000),) * 21, (F(1),) * 9 + (F(2000),) * 21)
    origin = (F(0),) * 3
    for stage, tags in (
        ("image", [("u+", 4), ("turn+", 0), ("turn+", 3 * EQUATIONS), ("tie+", 0), ("link+", 0), ("pose+", 0)]),
        ("links", [("u+", 99), ("turn+", 9 * EQUATIONS), ("tie+", 6), ("link+", 36), ("pose+", 0)]),
        ("frames", [("turn+", 2 * EQUATIONS), ("tie-", 6), ("link+", 0), ("pose+", 0)]),
    ):
        rows = Rows(study, stage, [0] if stage == "image" else range(3), F(1), origin, origin, {}, box)
        for tag in tags:
            with pytest.raises(Refused, match="there is no"):
                rows.row(*tag)


@pytest.mark.parametrize("given", [{}, {1: (-70, -60), 9: (-1, 60)}])
@pytest.mark.parametrize("angle", [None, F(1, 1000), F(3, 2), F(60), F(179), F(180)])
def test_the_box_that_was_asked_for_holds_all_frames_within_its_angle_and_reach(angle, given):
    """Positions that are `given`, from the centre's, are within their own ends instead."""
    random = np.random.default_rng(2)
    center = [
        *rational(random, 3, 500.0),
        *rational(random, 4, 1.0),
        *rational(random, 3, 500.0),
        *rational(random, 4, 1.0),
    ]
    hand, board = rational(random, 3, 100.0), rational(random, 3, 100.0)
    names = {1: "camera.y", 9: "target.z"}
    known = [(names[k], center[k] + low, center[k] + high) for k, (low, high) in given.items()]
    box = asked_box(center, F(50), angle, known, hand, board)
    most = np.pi if angle is None else np.radians(float(angle))
    for _ in range(200):
        axes = random.normal(size=(2, 3))
        placed = []
        for k, first in enumerate((0, 7)):
            half = 0.4999999 * most * random.choice([-1.0, 1.0])
            more = np.concatenate([[np.cos(half)], np.sin(half) * axes[k] / np.linalg.norm(axes[k])])
            q = product_of(more, np.array([float(v) for v in center[first + 3 : first + 7]]))
            shift = [v + s for v, s in zip(center[first : first + 3], rational(random, 3, 50.0), strict=True)]
            placed += [*shift, *(F(float(v)) for v in q)]
        for k, ends in given.items():
            placed[k] = center[k] + F(int(random.integers(ends[0], ends[1] + 1)))
        assert holds(placed, center, F(50), angle, known)
        x_turn, f_turn = (turned(placed[k : k + 4]) for k in (3, 10))
        e = applied(across(x_turn), [w - t for w, t in zip(hand, placed[:3], strict=True)])
        f = [a + b for a, b in zip(applied(f_turn, board), placed[7:10], strict=True)]
        assert all(lo <= v <= hi for lo, v, hi in zip(box.lo[24:], [*e, *f], box.hi[24:], strict=True))
    for sign in (-1, 1):  # the edge itself
        edge = [v + sign * 50 if k % 7 < 3 else v for k, v in enumerate(center)]
        assert holds(edge, center, F(50), angle)
        for k, ends in given.items():
            edge[k] = center[k] + ends[sign > 0]
        assert holds(edge, center, F(50), angle, known)
        for k in given:
            assert not holds([v + F(sign, 1000) * (n == k) for n, v in enumerate(edge)], center, F(50), angle, known)
    away = list(center)
    away[8] += F(51)
    assert not holds(away, center, F(50), angle)
    if angle is not None and angle < 60:
        other = list(center)
        other[3:7] = [
            F(float(v)) for v in product_of(np.array([0.6, 0.8, 0.0, 0.0]), np.array([float(v) for v in center[3:7]]))
        ]
        assert not holds(other, center, F(50), angle)


@pytest.mark.parametrize("ends", [(0, 0), (0, 5), (F(1, 7), F(1, 3)), (30, 90), (90, 179), (180, 180)])
@pytest.mark.parametrize(("name", "entry"), [("camera.tilt", 8), ("target.tilt", 20)])
def test_a_known_tilt_bounds_the_cosine_in_a_rotation_from_outside(name, entry, ends):
    low, high = map(F, ends)
    box = asked_box([0, 0, 0, 1, 0, 0, 0] * 2, F(50), F(1), [(name, low, high)], [F(0)] * 3, [F(0)] * 3)
    least, most = (arb.cos_pi_fmpq(fmpq(t.numerator, t.denominator) / 180) for t in (high, low))
    lo, hi = (arb(fmpq(v.numerator, v.denominator)) for v in (box.lo[entry], box.hi[entry]))
    assert least - 1e-11 < lo <= least
    assert most <= hi < most + 1e-11


@pytest.mark.parametrize("camera", LENSES)
def test_where_a_lens_moves_directions_is_enclosed(camera):
    """Against OpenCV's formulas in arb."""
    rays = [[F(v) for v in x] for x in np.random.default_rng(2).uniform(-0.5, 0.5, (20, 2)).tolist()]
    k = camera.distortion.tolist()
    for ray, found in zip(rays, distorted(camera.model, list(map(F, k)), list(map(numbers, rays))), strict=True):
        x, y = (arb(fmpq(v.numerator, v.denominator)) for v in ray)
        s = x * x + y * y
        if camera.model == "fisheye":
            a = s.sqrt().atan()
            g, p1, p2 = a / s.sqrt() * (1 + sum(c * a ** (2 * n + 2) for n, c in enumerate(k))), 0, 0
        else:
            k1, k2, p1, p2, k3, k4, k5, k6 = k + [0] * (8 - len(k))
            g = (1 + k1 * s + k2 * s**2 + k3 * s**3) / (1 + k4 * s + k5 * s**2 + k6 * s**3)
        moved = g * x + 2 * p1 * x * y + p2 * (s + 2 * x * x), g * y + p1 * (s + 2 * y * y) + 2 * p2 * x * y
        for wanted, one in zip(moved, found, strict=True):
            lo, hi = (arb(fmpq(v.numerator, v.denominator)) for v in one.ends)
            assert hi - lo < 1e-14
            assert wanted.overlaps(lo.union(hi))


@pytest.mark.parametrize(
    ("model", "given", "edge"),
    [
        ("brown", (F(-1, 3), 0, 0, 0, 0), 1.0),
        ("brown", (0, 0, 0, F(1, 6), 0), 1.0),
        ("rational", (0, 0, 0, 0, 0, 1, 0, 0), 1.0),
        ("fisheye", (F(-1, 3), 0, 0, 0), math.tan(1.0)),
    ],
)
def test_a_lens_is_refused_only_where_it_turns_back(model, given, edge):
    distorted(model, given, [numbers([F(0.999 * edge), F(0)]), numbers([F(0)] * 2)])
    with pytest.raises(Refused, match="may turn back before its farthest point"):
        distorted(model, given, [numbers([F(1.001 * edge), F(0)])])


def product_of(a, b):
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([w, *v])
