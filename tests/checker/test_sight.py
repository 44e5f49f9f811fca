"""Rows of a target in an image: at most zero at every truth, in exact numbers, and hardly below where a box is met."""

import random
from fractions import Fraction as F

import numpy as np
import pytest

from cpcal.checker import Refused
from cpcal.checker.bounds import between, number
from cpcal.checker.lens import NEAREST, Cameras, least_slope, slopes
from cpcal.checker.rule import Box
from cpcal.checker.sight import SIDES, Dot, Rows, Sight, rows_of
from cpcal.vision.camera import DELTALAB_CAMERA
from cpcal.vision.target import DELTALAB_TARGET
from tests.checker.proofs import across, applied, rotation_of, times, value_at

WIDTHS = (0.2, 0.2, 0.1, 0.1, 2e-4, 2e-4, 2e-5, 2e-5, 1e-4)
BENT = (600.0, 601.0, 511.0, 380.0, -0.33, 0.15, 1e-3, -1e-3, -0.03)


def pixel(numbers: list[F], x: list[F]) -> list[F]:
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = numbers
    u, v = x[0] / x[2], x[1] / x[2]
    s = u * u + v * v
    g = 1 + s * (k1 + s * (k2 + s * k3))
    bent = u * g + 2 * p1 * u * v + p2 * (s + 2 * u * u), v * g + 2 * p2 * u * v + p1 * (s + 2 * v * v)
    return [cx + fx * bent[0], cy + fy * bent[1]]


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize(("numbers", "off"), [(tuple(DELTALAB_CAMERA.numbers.tolist()), 0.0), (BENT, 0.01)])
def test_rows_are_at_most_zero_at_every_truth(numbers: tuple[float, ...], off: float, spread: bool) -> None:
    rng = random.Random(f"{numbers} {spread}")

    def drawn(size: float) -> F:
        return F(rng.uniform(-size, size))

    size = 3 if spread else 0
    by = [[drawn(w) for _ in range(size)] for w in WIDTHS]
    t = [rng.choice([drawn(0.5), F(rng.choice([-1, 1]), 2)]) for _ in range(size)]
    true = [F(v) + sum((a * b for a, b in zip(row, t, strict=True)), F(0)) for v, row in zip(numbers, by, strict=True)]
    about = [drawn(1.0) for _ in range(4)]
    seen = rotation_of([drawn(0.2), F(1), drawn(0.2), drawn(0.2)])
    place = [drawn(30.0), drawn(30.0), 700 + drawn(150.0)]
    half, dots, reach = F(0.05), [], []
    for k in rng.sample(range(len(DELTALAB_TARGET.dots)), 5):
        p = [*map(F, DELTALAB_TARGET.dots[k].tolist()), F(0)]
        x = applied(seen, [v + drawn(off) for v in p])
        x = [a + b for a, b in zip(place, x, strict=True)]
        edges = [rng.choice([-half, half, drawn(0.05)]) for _ in range(2)]
        pixels = [between(v + e - half, v + e + half) for v, e in zip(pixel(true, x), edges, strict=True)]
        beside = F(rng.choice([-1, 0, 1]), 100) if spread or off else F(0)  # any direction of the field is sound
        ray = x[0] / x[2] + beside, x[1] / x[2] - beside
        dots.append(Dot([number(v) for v in p], [number(F(off))] * 3, pixels, ray))
        reach.append(any(abs(e) == half for e in edges))
    sight = Sight(tuple(dots), False, Cameras([F(v) for v in numbers], by, F(6, 10)), number(F(6)), number(0))
    at = [v for row in times(seen, across(rotation_of(about))) for v in row] + place + t
    everywhere = rows_of(sight, range(len(dots)), about, None).root
    assert everywhere.holds(at, at)
    near = Box((*(v - F(1, 50) for v in at[:12]), *[F(-1)] * size), (*(v + F(1, 50) for v in at[:12]), *[F(1)] * size))
    for root in (everywhere, near):
        rows = Rows(sight, range(len(dots)), about, root, placed=False)
        values = {}
        for side, k in rows.tags:
            value = value_at(rows.row(side, k), at)
            assert value <= 0
            values[side, k] = float(value / 2**80 / place[2])
        assert not any(map(rows.fails, range(len(dots))))
        if not spread and not off:  # a box that is met at its edge is told from a hair wider
            for k, met in enumerate(reach):
                assert not met or max(values[side, k] for side in SIDES[:4]) > -1e-5


def test_pixels_to_the_first_order_are_within_what_is_given_away() -> None:
    """In wide boxes of pixels of a bent lens the second order counts: a tenth of what is given away is too little."""
    cameras, rng, largest = Cameras([F(v) for v in BENT], [()] * 9, F(6, 10)), random.Random(3), F(0)
    for _ in range(20):
        x0 = [F(rng.uniform(-0.35, 0.35)) for _ in range(2)]
        x = [v + F(rng.uniform(-0.02, 0.02)) for v in x0]
        seen, middle = (pixel([F(v) for v in BENT], [*at, F(1)]) for at in (x, x0))
        one = cameras.linear([between(min(p), max(p)) for p in zip(seen, middle, strict=True)], (x0[0], x0[1]))
        for k in range(2):
            moved = sum((s.middle.ends[0] * (a - b) for s, a, b in zip(one.slope[k], x, x0, strict=True)), F(0))
            off = abs(seen[k] - middle[k] - moved)
            assert off <= one.rest[k].ends[1] + F(1, 10**9)
            largest = max(largest, off / one.rest[k].ends[1])
    assert largest > F(1, 10)


def test_a_dot_that_no_pose_shows_fails_and_unknown_rows_are_refused() -> None:
    cameras = Cameras([F(v) for v in DELTALAB_CAMERA.numbers.tolist()], [()] * 9, F(6, 10))
    places = [[0.0, 0.0], [40.0, 0.0], [0.0, 40.0]]
    pixels = DELTALAB_CAMERA.project(np.array([[*p, 0.0] for p in places]) * [1, -1, -1] + [0, 0, 700.0])
    pixels[2] += 1.0
    dots = tuple(
        Dot(
            [*(number(F(v)) for v in p), number(0)],
            [number(0)] * 3,
            [between(F(v) - F(1, 9), F(v) + F(1, 9)) for v in u],
            (F(p[0]) / 700, -F(p[1]) / 700),
        )
        for p, u in zip(places, pixels.tolist(), strict=True)
    )
    sight = Sight(dots, False, cameras, number(F(6)), number(0))
    about = [F(0), F(1), F(0), F(0)]
    at = [F(v) for v in (1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 700)]
    rows = Rows(
        sight,
        range(3),
        about,
        Box(tuple(v - F(1, 10**4) for v in at), tuple(v + F(1, 10**4) for v in at)),
        placed=False,
    )
    assert [rows.fails(k) for k in range(3)] == [False, False, True]
    for side, k in (("u+", 3), ("ball", 0), ("turn+", 21), ("depth", 7)):
        with pytest.raises(Refused, match="there is no row"):
            rows.row(side, k)


@pytest.mark.parametrize("numbers", [tuple(DELTALAB_CAMERA.numbers.tolist()), BENT])
def test_slopes_and_bias_are_bounded_in_the_field(numbers: tuple[float, ...]) -> None:
    cameras = Cameras([F(v) for v in numbers], [()] * 9, F(6, 10))
    rng = np.random.default_rng(5)
    for x in rng.uniform(-0.42, 0.42, (40, 2)).tolist():
        at = [number(F(v)) for v in x]
        assert cameras.least.lo <= least_slope(cameras.over(slopes(at))).lo
        for part in cameras.bias(at, number(F(1, NEAREST)), [number(F(v)) for v in (0.6, -0.64, 0.48)]):
            assert part.size.hi <= cameras.field_bias[0].hi


def test_a_lens_that_turns_back_in_its_field_is_refused() -> None:
    with pytest.raises(Refused, match="turn back within its field"):
        assert Cameras([F(v) for v in BENT], [()] * 9, F(2)).least
