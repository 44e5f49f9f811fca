"""Collinear runs of found dots, and which rows of a target they may show, by cross-ratios.

Candidate lines pass through two dots that are near neighbours. A line's dots in order are compared with a row of the
target by the cross-ratios of four dots each, consecutive ones first; every match fixes a 1-D homography between row
and line, and the row's other dots are then predicted along it. So dots may be missing on the line, and false ones may
stand there.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cpcal.common.values import Bools, Floats, Ints, frozen_array
from cpcal.vision.identify.views import View, pairs
from cpcal.vision.opencv import opencv
from cpcal.vision.projection import line_maps, mapped, on_line
from cpcal.vision.target import Target

_SAMPLE = [0, 1, 3]  # of four matched dots, those that fix the 1-D homography; the fourth agrees by its cross-ratio
_KEPT = 60  # matches of each row
_FEW = 8  # neighbours of a dot, to see whether lines are straight


@dataclass(frozen=True, eq=False)
class DotLines:
    """Lines x = origin + t direction with their dots in order.

    origin, direction (L, 2); members (L, m) numbers of found dots, -1 at the end; at (L, m) their t, nan at the end
    """

    origin: Floats
    direction: Floats
    members: Ints
    at: Floats


@dataclass(frozen=True, eq=False)
class RowMatches:
    """Possible images of one row of the target, best first.

    dots (M, k) for each dot of the row the found dot or -1; count (M,) how many; crossing points are found with
    `place`: maps (M, 3) and start (M,) of the 1-D homographies, line (M,)
    """

    dots: Ints
    count: Ints
    maps: Floats
    start: Floats
    line: Ints
    lines: DotLines

    def place(self, s: float) -> Floats:
        """Where each match sees the place s (mm along the row): (M, 2)."""
        t = on_line(self.maps, self.start, np.full((len(self.line), 1), s))
        return np.asarray(self.lines.origin[self.line] + t * self.lines.direction[self.line])


def collinear(points: Floats, tolerance: float, neighbours: int) -> DotLines:
    """Lines through pairs of near neighbours with at least four of the points (n, 2) within `tolerance`."""
    mean = points.mean(axis=0)
    centred = (points - mean).astype(np.float32)  # to choose dots, seven digits are enough
    i, j = _near_pairs(points, neighbours)
    middle, along = 0.5 * (centred[i] + centred[j]), centred[j] - centred[i]
    length = np.sqrt((along * along).sum(axis=1))
    keep = length > 0.0
    middle, along, length = middle[keep], along[keep] / length[keep, None], length[keep]
    # errors of the two dots grow with the distance from them
    reach = np.abs(_along(centred, middle, along)) * (np.float32(0.5 * tolerance) / length[:, None])
    across = np.abs(_across(centred, middle, along))
    inside = across <= np.maximum(np.float32(tolerance), reach)
    origin, direction = _fitted_lines(points, inside)
    if not len(origin):
        return DotLines(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 4), dtype=np.int64), np.zeros((0, 4)))
    inside = np.abs(_across(points, origin, direction)) <= tolerance
    first = _distinct_rows(inside)
    return _ordered(points, inside[first], origin[first], direction[first])


def straightness(points: Floats, tolerance: float) -> tuple[int, int]:
    """How many dots the longest line holds, and how much all lines hold within half of the tolerance (squares of their
    numbers of dots): larger where less of a lens's distortion is left."""
    longest = (collinear(points, tolerance, _FEW).members >= 0).sum(axis=1).max(initial=0)
    counts = (collinear(points, 0.5 * tolerance, _FEW).members >= 0).sum(axis=1)
    return int(longest), int((counts[counts > 4] ** 2).sum())


def _near_pairs(points: Floats, neighbours: int) -> tuple[Ints, Ints]:
    """Each pair once."""
    count = len(points)
    near = np.asarray(cKDTree(points).query(points, min(neighbours + 1, count))[1], dtype=np.int64)[:, 1:]
    one = np.repeat(np.arange(count), near.shape[1])
    every = np.unique(count * np.minimum(one, near.ravel()) + np.maximum(one, near.ravel()))
    return every // count, every % count


def _along(points: npt.NDArray[Any], origin: npt.NDArray[Any], direction: npt.NDArray[Any]) -> npt.NDArray[Any]:
    out = direction @ points.T
    out -= (direction * origin).sum(axis=1, keepdims=True)
    return np.asarray(out)


def _across(points: npt.NDArray[Any], origin: npt.NDArray[Any], direction: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return _along(points, origin, np.stack([-direction[:, 1], direction[:, 0]], axis=1))


@lru_cache(maxsize=64)
def _column_weights(count: int) -> Floats:
    """Random numbers whose sums tell sets of columns apart."""
    return frozen_array(np.random.default_rng(0).uniform(1.0, 2.0, count))


def _distinct_rows(inside: Bools) -> Ints:
    """Where each distinct row of at least four came first."""
    signature = np.round(inside.astype(np.float64) @ _column_weights(inside.shape[1]), 9)
    first = np.unique(signature, return_index=True)[1]
    return np.asarray(first[inside[first].sum(axis=1) >= 4])


def _fitted_lines(points: Floats, inside: Bools) -> tuple[Floats, Floats]:
    """Least-squares lines through the points of each distinct row of at least four: origins and unit directions."""
    mean = points.mean(axis=0)
    x, y = (points - mean).T
    columns = np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y, _column_weights(len(x))], axis=1)
    moments = inside.astype(np.float64) @ columns
    moments = moments[moments[:, 0] >= 4]
    moments = moments[np.unique(np.round(moments[:, 6], 9), return_index=True)[1]]
    count, x, y, xx, xy, yy, _ = moments.T
    x, y = x / count, y / count
    xx, xy, yy = xx / count - x * x, xy / count - x * y, yy / count - y * y
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return np.stack([x, y], axis=1) + mean, np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _ordered(points: Floats, inside: Bools, origin: Floats, direction: Floats) -> DotLines:
    at = np.where(inside, _along(points, origin, direction), np.inf)
    longest = int(inside.sum(axis=1).max(initial=4))
    order = np.argsort(at, axis=1)[:, :longest]
    at = np.take_along_axis(at, order, axis=1)
    beyond = np.isinf(at)
    return DotLines(origin, direction, np.where(beyond, -1, order), np.where(beyond, np.nan, at))


@dataclass(frozen=True, eq=False)
class _Quads:
    """Four dots of each row of the target: by cross-ratio, both ways along the row."""

    ratio: Floats  # (Q,) rising
    row: Ints  # (Q,)
    dots: Ints  # (Q, 4) positions in the row, rising or falling
    amplified: Floats  # (Q, k) how errors of the three sampled dots grow at each dot of the longest row


@lru_cache(maxsize=64)
def row_places(target: Target, row: int) -> Floats:
    """The places (k,) mm of a row's dots along it, from its first."""
    dots = target.dots[list(target.lines[row])]
    along = dots[-1] - dots[0]
    return frozen_array((dots - dots[0]) @ along / np.linalg.norm(along))


@lru_cache(maxsize=8)
def _target_quads(target: Target, span: int) -> _Quads:
    """All fours of dots no further than `span` apart in their row."""
    longest = max(len(line) for line in target.lines)
    ratio, rows, dots, amplified = [], [], [], []
    for row, line in enumerate(target.lines):
        s = row_places(target, row)
        for four in itertools.combinations(range(len(line)), 4):
            if four[3] - four[0] > span:
                continue
            for chosen in (four, four[::-1]):
                ratio.append(float(_cross_ratios(*s[list(chosen)])))
                rows.append(row)
                dots.append(chosen)
                a, b, c = s[np.array(chosen)[_SAMPLE]]
                growth = abs((s - b) * (s - c) / ((a - b) * (a - c))) + abs((s - a) * (s - c) / ((b - a) * (b - c)))
                growth = growth + abs((s - a) * (s - b) / ((c - a) * (c - b)))
                amplified.append(np.pad(growth, (0, longest - len(line))))
    order = np.argsort(ratio, kind="stable")
    return _Quads(np.array(ratio)[order], np.array(rows)[order], np.array(dots)[order], np.array(amplified)[order])


def _cross_ratios(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    return np.asarray(((c - a) * (d - b)) / ((c - b) * (d - a)))


def match_rows(target: Target, lines: DotLines, tolerance: float, span: int, nearest: float) -> list[RowMatches]:
    """For each row of the target the lines that may be its image.

    tolerance  of a dot's place along its line, in the units of the points
    span       the furthest apart that four compared dots may stand in the order of their line and row
    nearest    predicted dots are looked for no further away than this
    """
    quads = _target_quads(target, span)
    line, members, which = _ratio_matches(lines, quads, tolerance, span)
    return [
        _row_matches(target, row, lines, quads, line[mine], members[mine], which[mine], tolerance, nearest)
        for row in range(len(target.lines))
        for mine in [quads.row[which] == row]
    ]


def _ratio_matches(lines: DotLines, quads: _Quads, tolerance: float, span: int) -> tuple[Ints, Ints, Ints]:
    """Lines, fours of members (their order numbers) and quads of the target with equal cross-ratios."""
    ratio, margin, line, members = [], [], [], []
    longest = lines.at.shape[1]
    for b, c, d in itertools.combinations(range(1, min(span, longest - 1) + 1), 3):
        steps = [lines.at[:, k : longest - d + k] for k in (0, b, c, d)]
        valid = ~np.isnan(steps[3])
        t = [step[valid] for step in steps]
        ratio.append(_cross_ratios(*t))
        relative = 1.0 / (t[2] - t[0]) + 1.0 / (t[3] - t[1]) + 1.0 / (t[2] - t[1]) + 1.0 / (t[3] - t[0])
        margin.append(tolerance * relative * ratio[-1])
        i, first = np.nonzero(valid)
        line.append(i)
        members.append(first[:, None] + np.array([0, b, c, d]))
    if not ratio:
        empty = np.zeros(0, dtype=np.int64)
        return empty, np.zeros((0, 4), dtype=np.int64), empty
    all_ratios, margins = np.concatenate(ratio), np.concatenate(margin)
    low = np.searchsorted(quads.ratio, all_ratios - margins)
    count = np.searchsorted(quads.ratio, all_ratios + margins, side="right") - low
    found = np.repeat(np.arange(len(count)), count)
    which = np.arange(len(found)) - np.repeat(np.cumsum(count) - count, count) + low[found]
    return np.concatenate(line)[found], np.concatenate(members)[found], which


def _row_matches(
    target: Target,
    row: int,
    lines: DotLines,
    quads: _Quads,
    line: Ints,
    members: Ints,
    which: Ints,
    tolerance: float,
    nearest: float,
) -> RowMatches:
    """The best match of each line and way along it."""
    s = row_places(target, row)
    places = s[quads.dots[which][:, _SAMPLE]]
    maps = line_maps(places, np.take_along_axis(lines.at[line], members[:, _SAMPLE], axis=1))
    predicted = on_line(maps, places[:, 0], np.broadcast_to(s, (len(line), len(s))))
    gap = np.abs(predicted[:, :, None] - lines.at[line][:, None, :])
    gap = np.where(np.isnan(gap), np.inf, gap)
    closest = gap.argmin(axis=2)
    off = np.take_along_axis(gap, closest[..., None], axis=2)[..., 0]
    hit = off <= np.minimum(tolerance * (1.0 + quads.amplified[which][:, : len(s)]), nearest)
    dots = np.where(hit, np.take_along_axis(lines.members[line], closest, axis=1), -1)
    count = hit.sum(axis=1)
    rising = quads.dots[which][:, 3] > quads.dots[which][:, 0]
    order = np.lexsort([np.where(hit, off, 0.0).sum(axis=1), -count])
    _, first = np.unique((2 * line + rising)[order], return_index=True)
    best = order[np.sort(first)][:_KEPT]
    return RowMatches(dots[best], count[best], maps[best], places[best, 0], line[best], lines)


# ------------------------------------------------------------------------------------------------------------------
# Homographies from one recognised row and two dots beside it, for when the other row is hidden or out of the image.

FEWEST = 5  # dots of the row
CHOICES = 6  # nearest neighbours of a dot of the row that are tried, in the image and on the target
_ROWS = 3  # matches of each row that are followed
_COUNTED = 40  # homographies whose hits are counted, those that suit the row best
_FOLLOWED = 3  # homographies of each
_ON_ROW = 0.1  # of the spacing: how far the row's other dots may be off
_NEAR = 0.1  # of the spacing: how far dots that are counted may be off
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
    places, images = target.dots[numbers[ends]], view.points[found[ends]]
    homographies = np.array([_through_four(places, images, target.dots[c[:2]], view.points[c[2:]]) for c in choice])
    off = np.linalg.norm(mapped(homographies, target.dots[numbers]) - view.points[found], axis=2).max(axis=1)
    homographies = homographies[np.argsort(off)[: min(_COUNTED, int((off < _ON_ROW * view.spacing).sum()))]]
    middle = target.dots[numbers].mean(axis=0)
    around = np.argsort(np.linalg.norm(target.dots - middle, axis=1))[:_AROUND]
    hits = [pairs(view, mapped(h, target.dots[around]), _NEAR * view.spacing) for h in homographies]
    for nearest, hit in sorted(hits, key=lambda both: -len(both[0]))[:_FOLLOWED]:
        yield nearest, around[hit]


def _beside(points: Floats, on_row: Ints, anchor: int) -> Ints:
    away = np.linalg.norm(points - points[anchor], axis=1)
    away[on_row] = np.inf
    order = np.argsort(away)[:CHOICES]
    return np.asarray(order[np.isfinite(away[order])])


def _through_four(places: Floats, images: Floats, more_places: Floats, more_images: Floats) -> Floats:
    """The homography that takes two places (2, 2) and two more to their images; far off where three are in line."""
    every = np.concatenate([places, more_places]).astype(np.float32), np.concatenate([images, more_images])
    return np.asarray(opencv().getPerspectiveTransform(every[0], every[1].astype(np.float32)))
