"""Homographies from one recognised row and two dots beside it, for when the other row is hidden or out of the image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Floats, Ints
from cpcal.vision.homography import mapped
from cpcal.vision.identify.runs import RowMatches
from cpcal.vision.identify.views import View
from cpcal.vision.target import Target

FEWEST = 5  # dots of the row
CHOICES = 6  # nearest neighbours of a dot of the row that are tried, in the image and on the target
_ROWS = 3  # matches of each row that are followed
_COUNTED = 40  # homographies whose hits are counted, those that suit the row best
_FOLLOWED = 3  # homographies of each
_ON_ROW = 0.1  # of the spacing: how far the row's other dots may be off
_AROUND = 40  # dots of the target that are counted


def seeds(view: View, target: Target, row: int, matches: RowMatches) -> Iterator[tuple[Ints, Ints]]:
    """Found dots and dots of the target that they would be, for the most promising homographies."""
    line = np.array(target.lines[row])
    for dots, count in zip(matches.dots[:_ROWS], matches.count[:_ROWS], strict=True):
        if count < FEWEST:
            return
        yield from _of_match(view, target, line[dots >= 0], dots[dots >= 0])


def _of_match(view: View, target: Target, numbers: Ints, found: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Every choice of a neighbour of the row's first dot and of one of its last dot, on the target and in the image."""
    ends = [0, -1]
    on_target = [_beside(target.dots, numbers, numbers[end]) for end in ends]
    in_image = [_beside(view.points, found, found[end]) for end in ends]
    if min(len(near) for near in on_target + in_image) == 0:
        return
    choice = np.stack(np.meshgrid(on_target[0], on_target[1], in_image[0], in_image[1], indexing="ij"), axis=-1)
    choice = choice.reshape(-1, 4)
    choice = choice[(choice[:, 0] != choice[:, 1]) & (choice[:, 2] != choice[:, 3])]
    places = np.concatenate([_repeated(target.dots[numbers[ends]], len(choice)), target.dots[choice[:, :2]]], axis=1)
    images = np.concatenate([_repeated(view.points[found[ends]], len(choice)), view.points[choice[:, 2:]]], axis=1)
    homographies = _through_four(places, images)
    off = np.linalg.norm(mapped(homographies, target.dots[numbers]) - view.points[found], axis=2).max(axis=1)
    homographies = homographies[np.argsort(off)[: min(_COUNTED, int((off < _ON_ROW * view.spacing).sum()))]]
    middle = target.dots[numbers].mean(axis=0)
    around = np.argsort(np.linalg.norm(target.dots - middle, axis=1))[:_AROUND]
    hits = [_hit(view, h, target.dots[around]) for h in homographies]
    for k in np.argsort([-h.sum() for h in hits], kind="stable")[:_FOLLOWED]:
        predicted = mapped(homographies[k], target.dots[around[hits[k]]])
        nearest = np.linalg.norm(view.points - predicted[:, None], axis=2).argmin(axis=1)
        yield nearest, around[hits[k]]


def _beside(points: Floats, on_row: Ints, anchor: int) -> Ints:
    away = np.linalg.norm(points - points[anchor], axis=1)
    away[on_row] = np.inf
    order = np.argsort(away)[:CHOICES]
    return np.asarray(order[np.isfinite(away[order])])


def _repeated(points: Floats, count: int) -> Floats:
    return np.broadcast_to(points, (count, *points.shape))


def _through_four(places: Floats, images: Floats) -> Floats:
    """The homographies (m, 3, 3) that take four places (m, 4, 2) to four images; nan where three are in line."""
    rows = np.zeros((len(places), 4, 2, 8))
    rows[..., 0, 0:2] = rows[..., 1, 3:5] = places
    rows[..., 0, 2] = rows[..., 1, 5] = 1.0
    rows[..., 6:] = -images[..., None] * places[..., None, :]
    equations = rows.reshape(-1, 8, 8)
    scale = np.abs(equations).max(axis=1, keepdims=True)
    scale[scale == 0.0] = 1.0
    proper = np.abs(np.linalg.det(equations / scale)) > 1e-9
    out = np.full((len(places), 9), np.nan)
    out[:, 8] = 1.0
    out[proper, :8] = np.linalg.solve(equations[proper], images.reshape(-1, 8, 1)[proper])[..., 0]
    return out.reshape(-1, 3, 3)


def _hit(view: View, homography: Floats, dots: Floats) -> npt.NDArray[np.bool_]:
    """Which of the dots (n, 2) are predicted near a found one."""
    difference = view.points - mapped(homography, dots)[:, None]
    square = (difference * difference).sum(axis=2)
    return np.asarray(np.nanmin(np.where(np.isnan(square), np.inf, square), axis=1) < (0.1 * view.spacing) ** 2)
