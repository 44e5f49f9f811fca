"""Homographies from the regular part of a target, for when too few dots of its rows are seen to recognise one.

A dot near the middle of the image and two of its neighbours are taken for such a frame of the target; that is right up
to a way of laying the grid onto itself. The homography is grown from there over all dots, and the target is then laid
in each of its near-symmetries: the one with the fewest errors is judged as any other hypothesis, by its rivals as well.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from cpcal.common.arrays import Floats, Ints
from cpcal.common.values import frozen_array
from cpcal.vision.homography import fitted, mapped
from cpcal.vision.identify.symmetry import self_maps
from cpcal.vision.identify.views import View
from cpcal.vision.target import Target

TRIED = 257 * 64  # homographies, at most: for what chance alone would explain
_ANCHORS = 8  # dots of the image that are tried
_NEAR = 5  # neighbours of a dot
_CROOKED = 0.6  # cosine between the two sides of a frame, at most
_UNEQUAL = 1.6  # ratio of their lengths, at most
_GROWTH = (1.6, 2.4, 3.6, 5.5, 8.5)  # sides of a frame: how far from it dots are predicted, in turn
_REACH = 0.25  # of the spacing: how far from there a dot may be found, meanwhile
_FEWEST = 5
_SHARE = 0.5  # of the dots, that a homography must explain


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


def laid(homography: Floats, target: Target) -> Floats:
    """Where the dots of the target (m, n, 2) are seen when it is laid as it is (first) or in each near-symmetry."""
    maps = self_maps(target)
    back = np.linalg.inv(maps.matrix)
    others = (target.dots - maps.shift[:, None, :]) @ np.swapaxes(back, 1, 2)
    places = np.concatenate([target.dots[None], others])
    return mapped(homography, places.reshape(-1, 2)).reshape(places.shape)


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
        found, numbers = _pairs(view, mapped(homography, dots[near]))
        if len(found) < max(_FEWEST, _SHARE * len(near)):
            return None
        fit = _affine if growth == _GROWTH[0] else fitted
        homography = fit(dots[near[numbers]], view.points[found])
    explained = len(_pairs(view, mapped(homography, dots))[0])
    return homography if explained >= _SHARE * min(len(dots), len(view.points)) else None


def _pairs(view: View, predicted: Floats) -> tuple[Ints, Ints]:
    square = ((view.points[:, None] - predicted) ** 2).sum(axis=2)
    square[np.isnan(square)] = np.inf
    nearest = square.argmin(axis=0)
    away = square[nearest, np.arange(len(predicted))]
    numbers = np.flatnonzero(away <= (_REACH * view.spacing) ** 2)
    return nearest[numbers], numbers


def _affine(places: Floats, images: Floats) -> Floats:
    columns = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    out = np.eye(3)
    out[:2] = np.linalg.lstsq(columns, images, rcond=None)[0].T
    return out
