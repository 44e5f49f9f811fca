"""What a pose set assumes: boxes of pixels, cameras, targets and frames, and where dots are for a box of poses."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property, lru_cache
from typing import Any

from .bounds import (
    Bounds,
    Matrix,
    Vector,
    applied,
    between,
    cross,
    inner,
    minus,
    number,
    plus,
    product,
    rotation,
    total,
    transposed,
)
from .lens import NEAREST, Cameras, View
from .readers import choice, dyadic, many, record, text, whole
from .refusal import Refused

FARTHEST = number(1 << 20)  # mm
_PAIR = many(dyadic, 2)
_INPUTS = record(
    {
        "name": text,
        "files": many(record({"name": text, "sha256": text})),
        "pixels": record(
            {"of": choice("images", "centers"), "numbers": many(whole(1 << 30)), "lo": many(_PAIR), "hi": many(_PAIR)}
        ),
        "camera": record(
            {
                "numbers": many(dyadic, 9),
                "spread": many(many(dyadic), 9),
                "ball": choice(True, False),
                "field": dyadic,
            }
        ),
        "target": record(
            {"radius": dyadic, "dots": many(_PAIR), "half_widths": many(many(dyadic, 3)), "scale": dyadic}
        ),
        "frames": record({"camera": many(dyadic, 7), "target": many(dyadic, 7)}),
    }
)
_MOST_SPREAD = 100


@dataclass(frozen=True)
class Dot:
    """Its place with the half-widths of its box (mm, target frame), and its box of pixels."""

    at: tuple[Bounds, Bounds]
    widths: tuple[Bounds, ...]
    pixels: tuple[Bounds, Bounds]


@dataclass
class Sight:
    """All that is assumed; frames: position and quaternion."""

    dots: list[Dot]
    of_images: bool
    cameras: Cameras
    radius: Bounds
    camera: Vector
    target: Vector
    scale: Bounds

    @cached_property
    def turns(self) -> tuple[Matrix, Matrix]:
        """Rotations of the frames of camera and target."""
        return rotation(self.camera[3:]), rotation(self.target[3:])

    def point(self, dot: int) -> list[Bounds]:
        """A dot in the mobile frame."""
        one = self.dots[dot]
        place = [*one.at, number(0)]
        local = [p.around(w) for p, w in zip(place, one.widths, strict=True)]
        return plus(self.target[:3], applied(self.turns[1], local))

    def mobile_in_base(self, box: list[Bounds]) -> tuple[Matrix, list[Bounds]]:
        """Of motions (P, r1, r2) of the target in the camera frame."""
        first, second = box[3:6], box[6:9]
        columns = [[v.within(-1, 1) for v in column] for column in (first, second, cross(first, second))]
        camera, target = self.turns
        back = transposed(camera)
        turned = product(product(back, transposed(columns)), transposed(target))
        moved = applied(back, minus(box[:3], self.camera[:3]))
        return turned, minus(moved, applied(turned, self.target[:3]))

    def by_scale(self, pose: Vector, moved: Vector, turned: Vector) -> list[Bounds]:
        """How far a plate's error of scale moves poses that are so far from one, at most: by the share of the target's
        origin in the base frame."""
        camera, arm = self.turns[0], self.target[:3]
        origin = plus(pose[:3], applied(rotation(pose[3:]), arm))
        origin = plus(origin, applied(transposed(camera), self.camera[:3]))
        swung = total(turned) * total(a.size for a in arm)
        return [self.scale * (o.size + m + swung) for o, m in zip(origin, moved, strict=True)]

    def about(self, pose: Vector, root: Vector) -> Place:
        """Of a box of (W, s) about a pose."""
        return Place(self, pose, root)

    def view(self, dot: int, ray: tuple[F, F], place: Place | None, kept: dict[Any, View]) -> View:
        """What planes of a dot are made of; the same for its four sides."""
        if (dot, ray) not in kept:
            x0 = [number(v) for v in ray]
            kept[dot, ray] = self.cameras.view(self._seen(dot, x0, place), x0)
        return kept[dot, ray]

    def _seen(self, dot: int, ray: Vector, place: Place | None) -> list[Bounds]:
        """The box of pixels of a dot's centre."""
        pixels = list(self.dots[dot].pixels)
        if not self.of_images:
            return pixels
        if place is None:
            return minus(pixels, self.cameras.bias_anywhere(pixels, ray))
        at, nearest = place.point(dot), number(NEAREST) * self.radius
        depth = Bounds(max(at[2].lo, nearest.lo), at[2].hi)
        x = [at[0] / depth, at[1] / depth]
        return minus(pixels, self.cameras.bias(x, self.radius / depth, place.normal))


class Place:
    """Poses P0 + W / (1 + s.s), R(1, s) R(q0) with (W, s) in a box."""

    def __init__(self, sight: Sight, pose: Vector, root: Vector) -> None:
        self.sight, self.pose, self.move, self.turn = sight, pose, root[:3], root[3:6]
        self.size = [v.size for v in root]
        self.stretch = number(1) + total(s.square for s in self.turn)
        self.start = rotation(pose[3:])
        self.turned = product(rotation([number(1), *self.turn]), self.start)
        self.origin = plus(pose[:3], [w / self.stretch for w in self.move])
        camera, target = sight.turns
        self.middle = plus(sight.camera[:3], applied(camera, pose[:3]))
        self.normal = [row[2] for row in product(camera, product(self.turned, target))]
        self.points = dict[int, list[Bounds]]()

    def point(self, dot: int) -> list[Bounds]:
        """A dot in the camera frame."""
        if dot not in self.points:
            base = plus(self.origin, applied(self.turned, self.sight.point(dot)))
            self.points[dot] = plus(self.sight.camera[:3], applied(self.sight.turns[0], base))
        return self.points[dot]


def sight_of(inputs: Any) -> Sight:
    """What is assumed, read and checked. Raises Refused."""
    _, _, pixels, camera, target, frames = _INPUTS(inputs)
    of, numbers, lo, hi = pixels
    radius, dots, widths, scale = target
    count = len(numbers)
    if {len(lo), len(hi), len(dots), len(widths)} != {count} or len(set(numbers)) < count or not count:
        raise Refused("there is not one box of pixels, one place and one box of places for each dot")
    if any(a > b for one, other in zip(lo, hi, strict=True) for a, b in zip(one, other, strict=True)):
        raise Refused("a box of pixels is empty")
    if radius <= 0 or not 0 <= scale < 1 or any(w < 0 for one in widths for w in one):
        raise Refused("a radius, half-width or scale is out of range")
    values, spread, ball, field = camera
    if len({len(row) for row in spread}) != 1 or len(spread[0]) > _MOST_SPREAD:
        raise Refused("the camera's spread is no matrix")
    if any(not any(frame[3:]) for frame in frames):
        raise Refused("a quaternion is zero")
    listed = [
        Dot(
            (number(x), number(y)),
            tuple(number(w) for w in widths[k]),
            (between(lo[k][0], hi[k][0]), between(lo[k][1], hi[k][1])),
        )
        for k, (x, y) in enumerate(dots)
    ]
    cameras = _cameras(values, spread, ball, field)
    one, other = ([number(v) for v in frame] for frame in frames)
    return Sight(listed, of == "images", cameras, number(radius), one, other, number(scale))


@lru_cache(maxsize=4)
def _cameras(values: tuple[F, ...], spread: tuple[tuple[F, ...], ...], ball: bool, field: F) -> Cameras:
    """The same for many images of a folder: what is found out of its field is kept."""
    return Cameras([number(v) for v in values], [[number(v) for v in row] for row in spread], ball, number(field))


def slope_size(g: Vector) -> Bounds:
    """The length of a vector."""
    return inner(g, g).root.most
