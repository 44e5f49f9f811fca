"""From two recognised rows to a homography that explains the dots, and what rivals it has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.special import bdtrc

from cpcal.common.arrays import Bools, Floats, Ints
from cpcal.vision.homography import fitted, mapped, orientation
from cpcal.vision.identify import lattice, one_row
from cpcal.vision.identify.nearest import mutually_nearest
from cpcal.vision.identify.runs import RowMatches, collinear, match_rows
from cpcal.vision.identify.symmetry import self_maps
from cpcal.vision.identify.views import View
from cpcal.vision.median import median
from cpcal.vision.target import Target

_PER_EFFORT = 30  # hypotheses followed
_CROSSING = 0.3  # of the spacing: how far apart two rows may see their crossing point
_NEAREST = 0.3  # of the spacing: no further from its predicted place is a dot looked for
_STRAYED = 0.3  # of the spacing: how far dots may be from where the image before has them
_NEARLY_ALL = 0.9  # of the dots: a homography that needs no more growing
ONE_ROW = 12  # from this span on, one row is tried with two dots beside it
_BEYOND = 8  # dots that make a hypothesis and so do not speak for it


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A homography (target mm to points of the view) with the pairs that it explains.

    found, numbers (m,) pairs; in_view (n,) which of the target's dots should be seen; errors: dots in view without a
    found one, and found dots without one of the target
    """

    homography: Floats
    found: Ints
    numbers: Ints
    in_view: Bools
    errors: int
    mirrored: bool


def hypotheses(view: View, target: Target, neighbours: int, span: int) -> Iterator[tuple[Hypothesis, int]]:
    """Fits to pairs of recognised rows, best first, each with the number of pairs that there were to choose from."""
    lines = collinear(view.points, view.fine, neighbours)
    if not len(lines.origin):
        return
    rows = match_rows(target, lines, view.fine, span, _NEAREST * view.spacing)
    candidates = [
        (one.count[i] + other.count[j], one.dots[i], other.dots[j], k, m)
        for k, one in enumerate(rows)
        for m, other in enumerate(rows[k + 1 :], start=k + 1)
        for i, j in _crossing_pairs(target, k, m, one, other, view)
    ]
    candidates.sort(key=lambda candidate: -int(candidate[0]))
    for _, one_dots, other_dots, k, m in candidates[:_PER_EFFORT]:
        numbers = np.array(target.lines[k] + target.lines[m])
        found = np.concatenate([one_dots, other_dots])
        fit = _grown(view, target, found[found >= 0], numbers[found >= 0])
        if fit is not None:
            yield fit, max(len(candidates), 1)
    if span >= ONE_ROW:
        yield from _from_one_row(view, target, rows)


def _from_one_row(view: View, target: Target, rows: list[RowMatches]) -> Iterator[tuple[Hypothesis, int]]:
    for row, matches in enumerate(rows):
        for found, numbers in one_row.seeds(view, target, row, matches):
            fit = _grown(view, target, found, numbers) if len(found) >= _BEYOND else None
            if fit is not None:
                yield fit, len(rows) * len(matches.count) * one_row.CHOICES**4


def from_grid(view: View, target: Target) -> Iterator[tuple[Hypothesis, int]]:
    """Fits to the regular part of the target, each laid in the near-symmetry that makes the fewest errors."""
    for homography in lattice.grid_homographies(view, target):
        rough = hypothesis_of(view, target, homography)
        places = lattice.laid(homography, target)
        best = int(np.argmin([_errors(view, target, rough, predicted) for predicted in places]))
        found, numbers = pairs(view, places[best], view.reach)
        fit = _grown(view, target, found, numbers) if len(found) >= _BEYOND else None
        if fit is not None:
            yield fit, lattice.TRIED
            return


def followed(view: View, target: Target, homography: Floats) -> Hypothesis | None:
    """The fit that a homography near the true one begins, where it leaves no choice: nearly all dots are where the
    target has them, and none lies between there and the next. None otherwise."""
    found, numbers = pairs(view, mapped(homography, target.dots), _STRAYED * view.spacing)
    if len(found) < _NEARLY_ALL * min(len(target.dots), len(view.points)):
        return None
    fit = _grown(view, target, found, numbers)
    if fit is None or len(fit.found) < _NEARLY_ALL * len(view.points):
        return None
    wider = pairs(view, mapped(fit.homography, target.dots), _STRAYED * view.spacing)[1]
    return fit if np.array_equal(wider, fit.numbers) else None


def _crossing_pairs(
    target: Target, k: int, m: int, one: RowMatches, other: RowMatches, view: View
) -> list[tuple[int, int]]:
    """Matches of two rows that see the crossing point of the rows in one place; any when the rows are parallel."""
    if not len(one.line) or not len(other.line):
        return []
    different = one.line[:, None] != other.line
    places = _crossing(target, k, m)
    if places is not None:
        gap = one.place(places[0])[:, None, :] - other.place(places[1])
        different &= (gap * gap).sum(axis=2) <= (_CROSSING * view.spacing) ** 2
    return [(int(i), int(j)) for i, j in np.argwhere(different)]


@lru_cache(maxsize=256)
def _crossing(target: Target, k: int, m: int) -> tuple[float, float] | None:
    """Where two rows cross, along each of them (mm from its first dot)."""
    first, second = (target.dots[list(target.lines[i])] for i in (k, m))
    along = np.stack([first[-1] - first[0], -(second[-1] - second[0])], axis=1)
    lengths = np.linalg.norm(along, axis=0)
    along = along / lengths
    if abs(np.linalg.det(along)) < 0.05:
        return None
    s, t = np.linalg.solve(along, second[0] - first[0])
    return float(s), float(t)


def _grown(view: View, target: Target, found: Ints, numbers: Ints) -> Hypothesis | None:
    """The homography of some pairs, grown over all dots that it predicts."""
    if len(set(found.tolist())) < len(found):
        return None
    homography = fitted(target.dots[numbers], view.points[found])
    for reach in (0.2 * view.spacing, 0.2 * view.spacing, view.reach):
        grown = pairs(view, mapped(homography, target.dots), max(reach, view.reach))
        if len(grown[0]) < _BEYOND:
            return None
        found, numbers = grown
        homography = fitted(target.dots[numbers], view.points[found])
        if len(found) > _NEARLY_ALL * min(len(target.dots), len(view.points)):
            break
    return hypothesis_of(view, target, homography)


def pairs(view: View, predicted: Floats, reach: float) -> tuple[Ints, Ints]:
    """Found dots and predicted ones (n, 2) that are each other's nearest, within `reach`."""
    nearest = np.empty(len(predicted), dtype=np.int64)
    mutually_nearest(view.points, predicted, reach, nearest)
    numbers = np.flatnonzero(nearest >= 0)
    return nearest[numbers], numbers


def hypothesis_of(view: View, target: Target, homography: Floats) -> Hypothesis:
    predicted = mapped(homography, target.dots)
    found, numbers = pairs(view, predicted, view.reach)
    in_view = view.in_view(predicted, target.radius * _scale(homography, target.dots))
    in_view[numbers] = True
    errors = int(in_view.sum()) - len(numbers) + len(view.points) - len(found)
    mirrored = bool(median(orientation(homography, target.dots)) > 0.0)  # y points up on the target, down in the view
    return Hypothesis(homography, found, numbers, in_view, errors, mirrored)


def _scale(homography: Floats, points: Floats) -> Floats:
    """How much H enlarges lengths at each of the points (..., 2), in the mean over all ways."""
    depth = points @ homography[2, :2] + homography[2, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.abs(np.linalg.det(homography) / depth**3)))


def accidents(view: View, hypothesis: Hypothesis, candidates: int) -> float:
    """Expected number of hypotheses that explain as many dots if the dots were strewn at random."""
    chance = min(1.0, len(view.points) * np.pi * view.reach**2 / max(view.area, 1e-300))
    hits, trials = len(hypothesis.found) - _BEYOND, int(hypothesis.in_view.sum()) - _BEYOND
    if hits <= 0:
        return float(candidates)
    return float(candidates * bdtrc(hits - 1, trials, chance))


def best_rival(view: View, target: Target, fit: Hypothesis, margin: int) -> tuple[int, bool]:
    """How many errors more than `fit` the best near-symmetric hypothesis makes, and whether it is mirrored to it. Maps
    that cannot come within the margin are not laid: what they make at least is told of them."""
    maps = self_maps(target)
    seen = np.zeros(len(target.dots), dtype=bool)
    seen[fit.numbers] = True
    false = len(view.points) - len(fit.found)
    unexplained = (seen & (maps.image < 0)).sum(axis=1) - false  # at least: false dots may become true ones
    close = np.flatnonzero(unexplained < fit.errors + margin)
    passed = np.delete(unexplained, close) - fit.errors
    least = int(passed.min()) if len(passed) else len(target.dots)
    if not len(close):
        return least, False
    back = np.linalg.inv(maps.matrix[close])
    predicted = mapped(
        fit.homography, ((target.dots - maps.shift[close][:, None, :]) @ np.swapaxes(back, 1, 2)).reshape(-1, 2)
    ).reshape(len(close), -1, 2)
    errors = np.array([_errors(view, target, fit, places) for places in predicted]) - fit.errors
    best = int(errors.argmin())
    return min(int(errors[best]), least), bool(maps.mirrored[close[best]])


def apart_at_least(view: View, target: Target, homography: Floats, in_view: Bools, enough: int) -> int:
    """At least so many errors are between the target and each of its near-symmetries, none of them mirrored, when the
    dots `in_view` (n,) are all found; no more than `enough` is counted."""
    maps = self_maps(target)
    unexplained = (in_view & (maps.image < 0)).sum(axis=1)
    least = enough
    for k in np.flatnonzero((unexplained < enough) & ~maps.mirrored):
        laid_on_nothing = np.setdiff1d(np.arange(len(target.dots)), maps.image[k])
        places = (target.dots[laid_on_nothing] - maps.shift[k]) @ np.linalg.inv(maps.matrix[k]).T
        margin = target.radius * _scale(homography, places)
        missing = int(view.in_view(mapped(homography, places), margin).sum())
        least = min(least, int(unexplained[k]) + missing)
    return least


def apart(view: View, target: Target, fit: Hypothesis) -> int:
    """How many errors the best near-symmetry that a camera could see (none of the mirrored) makes on dots that are all
    where `fit` has them, and in view."""
    perfect = replace(view, points=mapped(fit.homography, target.dots[fit.in_view]))
    places = lattice.laid(fit.homography, target)[1:][~self_maps(target).mirrored]
    exact = hypothesis_of(perfect, target, fit.homography)
    return min((_errors(perfect, target, exact, predicted) for predicted in places), default=len(target.dots))


def _errors(view: View, target: Target, fit: Hypothesis, predicted: Floats) -> int:
    found, numbers = pairs(view, predicted, view.reach)
    radius = target.radius * median(_scale(fit.homography, target.dots))
    in_view = view.in_view(predicted, np.full(len(predicted), radius))
    in_view[numbers] = True
    return int(in_view.sum()) - len(numbers) + len(view.points) - len(found)
