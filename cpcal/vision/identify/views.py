"""Found dots as a pinhole camera without distortion would see them, exactly or by guesses of the distortion."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from cpcal.common.values import Bools, Floats, Ints, frozen_array
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import Camera
from cpcal.vision.projection import fitted, mapped, median
from cpcal.vision.target import Target

_EXACT = 0.015  # of the spacing: how far a dot may be off when the camera is known
_GUESSED = (0.02, 0.06)  # the same along a line and in the plane when the distortion is guessed
_BENDS = (0.0, 0.03, 0.06, 0.09, 0.12, -0.03, 0.15, 0.18, -0.06, 0.22, 0.26, 0.3, -0.1)  # radial, at half the diagonal


@dataclass(frozen=True, eq=False)
class View:
    """Points (n, 2) in which straight lines are straight; y still points down.

    spacing    median distance between nearest neighbours; the unit of the two tolerances is that of the points
    fine       how far a dot may be off its line, and off its place on the line
    reach      how far a dot may be off its predicted place in the plane
    camera     when known; otherwise dots are expected in the rectangle around the points
    """

    points: Floats
    spacing: float
    fine: float
    reach: float
    camera: Camera | None = None

    def in_view(self, predicted: Floats, margin: Floats) -> Bools:
        """Which predicted points (..., 2) would be seen whole, `margin` (...) their radius."""
        if self.camera is None:
            low, high = self.points.min(axis=0), self.points.max(axis=0)
            return np.asarray(((predicted >= low) & (predicted <= high)).all(axis=-1))
        low, high = _seen_rectangle(self.camera)
        inside: Bools = np.asarray(((predicted >= low) & (predicted <= high)).all(axis=-1))
        pixels = self.camera.pixels(np.where(inside[..., None], predicted, 0.0))
        edge = (2.0 * margin * self.camera.focal.max())[..., None]  # whole, and some plate around it
        size = np.array([self.camera.width, self.camera.height])
        return np.asarray(inside & ((pixels >= edge - 0.5) & (pixels <= size - 0.5 - edge)).all(axis=-1))

    @property
    def area(self) -> float:
        width, height = np.ptp(self.points, axis=0)
        return float(width * height)


@lru_cache(maxsize=8)
def _seen_rectangle(camera: Camera) -> tuple[Floats, Floats]:
    """The rectangle around all directions that the image shows."""
    x, y = np.linspace(-0.5, camera.width - 0.5, 9), np.linspace(-0.5, camera.height - 0.5, 9)
    border = [np.stack([x, np.full(9, end)], axis=1) for end in (y[0], y[-1])]
    border += [np.stack([np.full(9, end), y], axis=1) for end in (x[0], x[-1])]
    rays = camera.normalised(np.concatenate(border))
    return np.nanmin(rays, axis=0), np.nanmax(rays, axis=0)


def seen_by(camera: Camera, pixels: Floats) -> View:
    """The directions of pixels (n, 2); one that the camera cannot show stays nan."""
    rays = camera.normalised(pixels)
    spacing = _spacing(rays[np.isfinite(rays).all(axis=1)])
    return View(rays, spacing, _EXACT * spacing, _EXACT * spacing, camera)


def guesses(pixels: Floats, size: tuple[int, int] | None) -> Iterator[View]:
    """Pixels (n, 2) freed from a guessed radial distortion about the middle of the image (or of the dots)."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    middle = 0.5 * (low + high) if size is None else 0.5 * (np.array(size, dtype=np.float64) - 1.0)
    radius = float(np.linalg.norm(np.maximum(high - middle, middle - low)))
    arm = pixels - middle
    for bend in _BENDS:
        points = middle + arm * (1.0 + bend / radius**2 * (arm * arm).sum(axis=1, keepdims=True))
        spacing = _spacing(points)
        yield View(points, spacing, _GUESSED[0] * spacing, _GUESSED[1] * spacing)


def _spacing(points: Floats) -> float:
    return median(np.asarray(cKDTree(points).query(points, 2)[0])[:, 1]) if len(points) > 1 else 0.0


def pairs(view: View, predicted: Floats, reach: float) -> tuple[Ints, Ints]:
    """Found dots and predicted ones (n, 2) that are each other's nearest, within `reach`."""
    nearest = np.empty(len(predicted), dtype=np.int64)
    mutually_nearest(view.points, predicted, reach, nearest)
    numbers = np.flatnonzero(nearest >= 0)
    return nearest[numbers], numbers


@compiled
def mutually_nearest(points: Floats, places: Floats, reach: float, out: Ints) -> None:
    """For each of the places (n, 2) which of the points (m, 2) is nearest, if it is no further than `reach` and no
    other place is nearer to that point; -1 where none is. A place that is nan has none. (Asked some times an image.)"""
    closest, owner = np.full(len(points), np.inf), np.full(len(points), -1)
    for i in range(len(places)):
        out[i], least = -1, np.inf
        for k in range(len(points)):
            dx, dy = points[k, 0] - places[i, 0], points[k, 1] - places[i, 1]
            square = dx * dx + dy * dy
            if square < least:
                out[i], least = k, square
            if square < closest[k]:
                closest[k], owner[k] = square, i
        if not least <= reach * reach:
            out[i] = -1
    for i in range(len(places)):
        if out[i] >= 0 and owner[out[i]] != i:
            out[i] = -1


# ------------------------------------------------------------------------------------------------------------------
# Ways to lay a target onto itself so that many dots cover dots: what an identification may be mistaken for.
#
# A square grid goes over into itself by turns, shifts, shears and reflections; only the dots off the grid tell. These
# affine maps are found once for a target: every dot with two of its neighbours is laid onto a few dots with theirs.

_BASES = 12  # dots whose neighbourhoods are laid onto all others
_NEIGHBOURS = 5
_SHARE = 0.5  # of the dots that must cover dots, for a map to be kept
_KEPT = 256


@dataclass(frozen=True, eq=False)
class SelfMaps:
    """Maps S: x -> matrix x + shift, other than the identity, best first.

    matrix (m, 2, 2), shift (m, 2); image (m, n): the dot that S lays dot i on, or -1; mirrored (m,)
    places (m, n, 2) mm: what S lays on dot i, S^-1 of its place: where the dots are if the target is mistaken so
    """

    matrix: Floats
    shift: Floats
    image: Ints
    mirrored: Bools
    places: Floats


@lru_cache(maxsize=8)
def self_maps(target: Target, tolerance: float = 0.25) -> SelfMaps:
    """The maps that lay at least half of the dots onto dots, within `tolerance` of the dots' radius."""
    dots, reach = target.dots, tolerance * target.radius
    tree = cKDTree(dots)
    frames = _frames(dots, tree)
    rng = np.random.default_rng(0)
    bases = frames[rng.permutation(len(frames))[:_BASES]]
    start = _matrices(dots, bases)  # (B, 2, 2), columns are the two edges
    goal = _matrices(dots, frames)
    matrix = (goal[None] @ np.linalg.inv(start)[:, None]).reshape(-1, 2, 2)
    turned = matrix.reshape(len(bases), -1, 2, 2) @ dots[bases[:, 0]][:, None, :, None]
    shift = (dots[frames[:, 0]] - turned[..., 0]).reshape(-1, 2)
    trial = dots[rng.permutation(len(dots))[:16]]
    promising = _images(tree, trial, matrix, shift, reach)
    keep = (promising >= 0).mean(axis=1) >= 0.4
    matrix, shift = matrix[keep], shift[keep]
    image = _images(tree, dots, matrix, shift, reach)
    share = (image >= 0).mean(axis=1)
    identity = (image == np.arange(len(dots))).mean(axis=1) > 0.5
    matrix, shift, image, share = (a[(share >= _SHARE) & ~identity] for a in (matrix, shift, image, share))
    _, first = np.unique(image, axis=0, return_index=True)
    best = first[np.argsort(-share[first], kind="stable")][:_KEPT]
    matrix, shift = matrix[best], shift[best]
    places = (dots - shift[:, None, :]) @ np.swapaxes(np.linalg.inv(matrix), 1, 2)
    return SelfMaps(matrix, shift, image[best], np.linalg.det(matrix) < 0.0, places)


def _frames(dots: Floats, tree: cKDTree) -> Ints:
    """A dot and two neighbours not in line with it: (f, 3)."""
    count = min(_NEIGHBOURS + 1, len(dots))
    near = np.asarray(tree.query(dots, k=count)[1], dtype=np.int64)[:, 1:]
    both = itertools.permutations(range(count - 1), 2)
    frames = np.concatenate([np.stack([np.arange(len(dots)), near[:, a], near[:, b]], axis=1) for a, b in both])
    edges = _matrices(dots, frames)
    lengths = np.linalg.norm(edges, axis=1)
    return np.asarray(frames[np.abs(np.linalg.det(edges)) > 0.3 * lengths[:, 0] * lengths[:, 1]])


def _matrices(dots: Floats, frames: Ints) -> Floats:
    return np.stack([dots[frames[:, 1]] - dots[frames[:, 0]], dots[frames[:, 2]] - dots[frames[:, 0]]], axis=2)


def _images(tree: cKDTree, points: Floats, matrix: Floats, shift: Floats, reach: float) -> Ints:
    """Which dot each map lays each point on, (m, points), -1 for none."""
    moved = np.einsum("mij,nj->mni", matrix, points) + shift[:, None, :]
    away, nearest = tree.query(moved.reshape(-1, 2), distance_upper_bound=reach)
    found = np.where(np.isfinite(away), nearest, -1)
    return np.asarray(found, dtype=np.int64).reshape(len(matrix), len(points))


# ------------------------------------------------------------------------------------------------------------------
# Homographies from the regular part of a target, for when too few dots of its rows are seen to recognise one.
#
# A dot near the middle of the image and two of its neighbours are taken for such a frame of the target; that is right
# up to a way of laying the grid onto itself. The homography is grown from there over all dots, and the target is then
# laid in each of its near-symmetries: the one with the fewest errors is judged as any other hypothesis, by its rivals
# as well.

TRIED = 257 * 64  # homographies, at most: for what chance alone would explain
_ANCHORS = 8  # dots of the image that are tried
_NEAR = 5  # neighbours of a dot
_CROOKED = 0.6  # cosine between the two sides of a frame, at most
_UNEQUAL = 1.6  # ratio of their lengths, at most
_GROWTH = (1.6, 2.4, 3.6, 5.5, 8.5)  # sides of a frame: how far from it dots are predicted, in turn
_REACH = 0.25  # of the spacing: how far from there a dot may be found, meanwhile
_FEWEST = 5


def grid_homographies(view: View, target: Target) -> Iterator[Floats]:
    """Homographies (3, 3) that explain half of the dots at least, each up to a near-symmetry of the target."""
    frame = _frame(target)
    if frame is None:
        return
    middle = np.median(view.points, axis=0)
    order = np.argsort(((view.points - middle) ** 2).sum(axis=1))
    for anchor in order[:_ANCHORS]:
        for one, other in _sides(view.points, int(anchor), up=False):
            grown = _grown(view, target, frame, np.array([anchor, one, other]))
            if grown is not None:
                yield grown


@lru_cache(maxsize=8)
def _frame(target: Target) -> Ints | None:
    """A dot of the target with two neighbours at right angles, the most regular near the middle; None: it has none."""
    order = np.argsort(((target.dots - target.dots.mean(axis=0)) ** 2).sum(axis=1))
    best, found = np.inf, None
    for anchor in order[: len(order) // 2]:
        for one, other in _sides(target.dots, int(anchor), up=True):
            sides = target.dots[[one, other]] - target.dots[anchor]
            lengths = np.hypot(*sides.T)
            off = abs(lengths[0] / lengths[1] - 1.0) + abs(sides[0] @ sides[1]) / lengths.prod()
            if off < best - 1e-6:
                best, found = off, np.array([anchor, one, other])
    return None if found is None or best > 1e-3 else frozen_array(found).astype(np.int64)


def _sides(points: Floats, anchor: int, *, up: bool) -> Iterator[tuple[int, int]]:
    """Two neighbours each that are about as far and at about right angles, the second to the left of the first as y
    points up or down."""
    arms = points - points[anchor]
    length = np.hypot(*arms.T)
    near = np.argsort(length)[1 : _NEAR + 1]
    for one, other in itertools.permutations(near.tolist(), 2):
        cross = arms[one, 0] * arms[other, 1] - arms[one, 1] * arms[other, 0]
        flat = abs(arms[one] @ arms[other]) > _CROOKED * length[one] * length[other]
        if not flat and length[one] < _UNEQUAL * length[other] < _UNEQUAL**2 * length[one] and (cross > 0.0) == up:
            yield one, other


def _grown(view: View, target: Target, frame: Ints, seen: Ints) -> Floats | None:
    """The homography that the frame begins, over more and more of the target."""
    dots = target.dots
    side = float(np.hypot(*(dots[frame[1]] - dots[frame[0]])))
    away = np.hypot(*(dots - dots[frame[0]]).T)
    homography = _affine(dots[frame], view.points[seen])
    for growth in _GROWTH:
        near = np.flatnonzero(away < growth * side)
        found, numbers = pairs(view, mapped(homography, dots[near]), _REACH * view.spacing)
        if len(found) < max(_FEWEST, _SHARE * len(near)):
            return None
        fit = _affine if growth == _GROWTH[0] else fitted
        homography = fit(dots[near[numbers]], view.points[found])
    explained = len(pairs(view, mapped(homography, dots), _REACH * view.spacing)[0])
    return homography if explained >= _SHARE * min(len(dots), len(view.points)) else None


def _affine(places: Floats, images: Floats) -> Floats:
    columns = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    out = np.eye(3)
    out[:2] = np.linalg.lstsq(columns, images, rcond=None)[0].T
    return out
