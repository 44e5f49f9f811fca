"""Which found dot is which dot of the target.

Two rows of the target are recognised by cross-ratios along collinear runs (`runs`); together they give a
homography, and every other dot is predicted and looked for. Where too little of the rows is seen, the regular dots give
one up to a symmetry, and all of these are tried (`lattice`). What is accepted has passed five tests:

- chance: were the found dots strewn at random, each predicted dot would be hit with a probability p (the share of the
  area near found dots). The expected number of hypotheses as good by accident, hypotheses tried times the binomial tail
  P(hits or more of those predicted in view, beyond the dots that made the hypothesis), must be below 1e-9;
- shares: at least half of the dots predicted in view are found, and at least half of the found ones are explained;
- rivals: call each dot missing in view and each found dot unexplained an error. Every other way to lay the target onto
  the found dots by one of its near-symmetries (`symmetry`) must make four errors more. If errors come
  singly, in one dot of thirty, that is a likelihood ratio near a million. It is also a guarantee: where a near-symmetry
  makes d errors on the perfect target, it makes at least d - e on one with e errors, so it can only win when
  2 e >= d + 4. For the DeltaLab target d is 18 (its turns), so no ten errors, wherever they are, make it wrong; where
  its rows were not recognised, or only a part of it is in view, d must be 17 at least among the dots in view, which
  says the same (or as much as d is on the whole target, where that is less);
- alone: the dots that are left must not show the target once more, or mirrored;
- orientation: a camera never sees a target mirrored, and mirrored near-symmetries are rivals like all others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.special import bdtrc

from cpcal.common.errors import CpcalError
from cpcal.common.values import Bools, Floats, Ints
from cpcal.vision.camera import Camera
from cpcal.vision.identify.runs import CHOICES, RowMatches, collinear, match_rows, seeds, straightness
from cpcal.vision.identify.views import (
    TRIED,
    View,
    grid_homographies,
    guesses,
    pairs,
    seen_by,
    self_maps,
)
from cpcal.vision.projection import fitted, mapped, median, orientation
from cpcal.vision.target import Target

# ------------------------------------------------------------------------------------------------------------------
# From two recognised rows to a homography that explains the dots, and what rivals it has.

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
    for row, matches in enumerate(rows if span >= ONE_ROW else []):
        for found, numbers in seeds(view, target, row, matches):
            fit = _grown(view, target, found, numbers) if len(found) >= _BEYOND else None
            if fit is not None:
                yield fit, len(rows) * len(matches.count) * CHOICES**4


def from_grid(view: View, target: Target) -> Hypothesis | None:
    """A fit to the regular part of the target, laid in the near-symmetry that makes the fewest errors."""
    for homography in grid_homographies(view, target):
        radius = _radius(homography, target)
        ways = mapped(homography, np.concatenate([target.dots[None], self_maps(target).places]))
        best = min(ways, key=lambda predicted: _compared(view, predicted, radius)[3])
        found, numbers = pairs(view, best, view.reach)
        fit = _grown(view, target, found, numbers) if len(found) >= _BEYOND else None
        if fit is not None:
            return fit
    return None


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


def hypothesis_of(view: View, target: Target, homography: Floats) -> Hypothesis:
    radius = target.radius * _scale(homography, target.dots)
    found, numbers, in_view, errors = _compared(view, mapped(homography, target.dots), radius)
    mirrored = bool(median(orientation(homography, target.dots)) > 0.0)  # y points up on the target, down in the view
    return Hypothesis(homography, found, numbers, in_view, errors, mirrored)


def _compared(view: View, predicted: Floats, radius: Floats) -> tuple[Ints, Ints, Bools, int]:
    """Found dots and those of the target (n, 2) that explain them, which should be in view, and the errors."""
    found, numbers = pairs(view, predicted, view.reach)
    in_view = view.in_view(predicted, radius)
    in_view[numbers] = True
    return found, numbers, in_view, int(in_view.sum()) + len(view.points) - 2 * len(found)


def _radius(homography: Floats, target: Target) -> Floats:
    """(n,) the usual radius of the dots."""
    return np.full(len(target.dots), target.radius * median(_scale(homography, target.dots)))


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
    radius = _radius(fit.homography, target)
    errors = np.array([_compared(view, way, radius)[3] for way in mapped(fit.homography, maps.places[close])])
    best = int(errors.argmin())
    return min(int(errors[best]) - fit.errors, least), bool(maps.mirrored[close[best]])


def apart(view: View, target: Target, fit: Hypothesis) -> int:
    """How many errors, `_APART` at most, the best near-symmetry that a camera could see (none of the mirrored) makes on
    dots that are all where `fit` has them, and in view. Maps that explain too little of these are not laid."""
    maps, radius = self_maps(target), _radius(fit.homography, target)
    close = ((fit.in_view & (maps.image < 0)).sum(axis=1) < _APART) & ~maps.mirrored
    perfect = replace(view, points=mapped(fit.homography, target.dots[fit.in_view]))
    ways = mapped(fit.homography, maps.places[close])
    return min([_APART, *(_compared(perfect, way, radius)[3] for way in ways)])


ACCIDENTS = 1e-9  # expected number of hypotheses as good by chance
MARGIN = 4  # errors by which every rival must be worse
FEWEST = 12  # dots: two rows of four, and four more that speak for them
_SHARE = 0.5
_ANOTHER = 20  # dots that are not the target's and so may be another one's
_MIRRORED = "the dots show the target's mirror image"
_NEARLY = 0.1  # errors per dot with which no better guess of the distortion is looked for
_APART = 2 * 10 - MARGIN + 1  # errors between two ways to lay the target, so that no ten errors exchange them
_GRID_AFTER = 5  # the span after which the target's regular part is looked for
_EFFORTS = ((8, 3), (8, 5), (10, 7), (24, 16))  # near neighbours that lines start from; span of compared dots
_LOOKS = (13, 8, 3, 3)  # guesses of the distortion that each effort looks at, the straightest: a refusal costs a second


class Unidentified(CpcalError):
    """The found dots are not, or not certainly, those of the target. Its text is the reason."""


@dataclass(frozen=True, eq=False)
class Identification:
    """Pairs of found dots and dots of the target.

    found       (m,) which of the given centres
    numbers     (m,) which dots of the target they are
    homography  (3, 3) from the target's plane (mm) to the coordinates of the view: directions when a camera was given,
                otherwise pixels freed from an estimated distortion
    false       found dots that are none of the target's
    missing     dots of the target that should be in view and were not found
    accidents   expected number of hypotheses as good by chance
    margin      how many errors more every rival has at least
    """

    found: Ints
    numbers: Ints
    homography: Floats
    false: Ints
    missing: Ints
    accidents: float
    margin: int


def identify(
    centers: npt.ArrayLike,
    target: Target,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    near: Floats | None = None,
) -> Identification:
    """Which of the centres (n, 2), pixels, is which dot of the target.

    With a camera its distortion is taken away first. Without one an ordinary lens is allowed for: radial distortion of
    one parameter is searched for, about the middle of the image when its `size` (width, height) is given.
    `near` (3, 3) is a homography from the target's plane (mm) to the camera's directions that may be near the true one,
    as that of the image before: it saves the search where it leaves no choice, and what it leads to passes the same
    tests.

    Raises Unidentified with the reason. Centres that are not finite count as false dots.
    """
    pixels = np.asarray(centers, dtype=np.float64).reshape(-1, 2)
    usable = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    _check_count(len(usable), target)
    if camera is None:
        seen = tuple(guesses(pixels[usable], size))
    else:
        view = seen_by(camera, pixels[usable])
        shown = np.isfinite(view.points).all(axis=1)
        usable = usable[shown]
        _check_count(len(usable), target)
        seen = (replace(view, points=view.points[shown]),)
    if not seen[0].spacing > 0.0:
        raise Unidentified("most dots lie on one another")
    found = _followed(seen[0], target, near) or _identified(seen, target)
    if camera is not None:
        _check_alone(seen[0], target, found)
    mine = usable[found.found]
    return replace(found, found=mine, false=_others(len(pixels), mine))


def _check_count(count: int, target: Target) -> None:
    if count < FEWEST:
        raise Unidentified(f"{count} dots are too few: at least {FEWEST} are needed")
    if count > len(target.dots) / _SHARE:
        raise Unidentified(f"{count} dots are too many: the target has {len(target.dots)}")


def _check_alone(view: View, target: Target, found: Identification) -> None:
    """Raises Unidentified when the other dots show the target once more, or its mirror image: which one is meant?"""
    if len(found.false) < _ANOTHER:
        return
    rest = replace(view, points=view.points[found.false])
    for neighbours, span in _EFFORTS[:2]:
        answer = _in_view(rest, target, neighbours, span)
        if isinstance(answer, Identification):
            raise Unidentified("ambiguous: the target is in sight twice")
        if answer.reason == _MIRRORED:
            raise Unidentified("ambiguous: the target and its mirror image are in sight")


def _followed(view: View, target: Target, near: Floats | None) -> Identification | None:
    fit = None if near is None else followed(view, target, near)
    answer = None if fit is None else _judgement(view, target, fit, 1)
    return answer if isinstance(answer, Identification) else None


def _identified(seen: tuple[View, ...], target: Target) -> Identification:
    """The first view that explains nearly all, or the best of the first effort that finds anything."""
    reason = "no two rows of the target were recognised among the dots"
    for (neighbours, span), looks in zip(_EFFORTS, _LOOKS, strict=True):
        if looks < len(seen):
            # those in which most dots stand in line: where the distortion is guessed best, rows are straight
            seen = tuple(sorted(seen, key=lambda view: straightness(view.points, view.fine), reverse=True)[:looks])
        best: Identification | None = None
        for view in seen:
            answer = _in_view(view, target, neighbours, span)
            if isinstance(answer, _Refusal) and not answer.final and len(seen) == 1 and span == _GRID_AFTER:
                answer = _on_grid(view, target) or answer
            if isinstance(answer, _Refusal):
                reason = answer.reason or reason
                if answer.final and (len(seen) == 1 or answer.errors <= _NEARLY * len(view.points)):
                    raise Unidentified(reason)
                continue
            if best is None or len(answer.found) > len(best.found):
                best = answer
            if len(answer.missing) + len(answer.false) <= _NEARLY * len(view.points):
                return answer
        if best is not None:
            return best
    raise Unidentified(reason)


@dataclass(frozen=True)
class _Refusal:
    """Why not ("" when that is not worth telling), whether no other hypothesis could change that, and the errors that
    the refused one makes."""

    reason: str
    final: bool = False
    errors: int = 0


def _in_view(view: View, target: Target, neighbours: int, span: int) -> Identification | _Refusal:
    refusal = _Refusal("")
    for hypothesis, candidates in hypotheses(view, target, neighbours, span):
        answer = _judgement(view, target, hypothesis, candidates)
        if isinstance(answer, Identification) or answer.final:
            return answer
        refusal = answer if answer.reason else refusal
    return refusal


def _on_grid(view: View, target: Target) -> Identification | None:
    fit = from_grid(view, target)
    answer = None if fit is None else _judgement(view, target, fit, TRIED)
    if fit is None or not isinstance(answer, Identification):
        return None
    return answer if apart(view, target, fit) >= _APART else None


def _judgement(view: View, target: Target, fit: Hypothesis, candidates: int) -> Identification | _Refusal:
    """The tests of one hypothesis."""
    in_view = int(fit.in_view.sum())
    by_chance = accidents(view, fit, candidates)
    if by_chance > ACCIDENTS or len(fit.found) < FEWEST:
        return _Refusal("")
    if len(fit.found) < _SHARE * in_view:
        return _Refusal(f"only {len(fit.found)} of the {in_view} dots of the target that should be in view were found")
    if len(fit.found) < _SHARE * len(view.points):
        return _Refusal(f"only {len(fit.found)} of the {len(view.points)} dots found would be the target's")
    margin, reflected = best_rival(view, target, fit, MARGIN)
    if fit.mirrored:
        return _Refusal(_MIRRORED if margin >= MARGIN else "", margin >= MARGIN, fit.errors)
    if margin < MARGIN:
        other = "the target's mirror image fits" if reflected else "another assignment fits"
        return _Refusal(
            f"ambiguous: {other} as well or nearly so", margin > -MARGIN, fit.errors
        )  # else it is to be found
    if not fit.in_view.all() and not _sure(view, target, fit):
        return _Refusal("ambiguous: too few of the dots that tell the target's turns apart are in view")
    false = _others(len(view.points), fit.found)
    unseen = _others(len(target.dots), fit.numbers)
    missing = unseen[fit.in_view[unseen]]
    return Identification(fit.found, fit.numbers, fit.homography, false, missing, by_chance, margin)


def _sure(view: View, target: Target, fit: Hypothesis) -> bool:
    """Whether no ten errors among the dots in view exchange two ways to lay the target, or as few as on all of it."""
    maps = self_maps(target)
    in_all = 2 * (maps.image[~maps.mirrored] < 0).sum(axis=1).min(initial=_APART)  # dots missing, and as many too many
    return apart(view, target, fit) >= min(_APART, int(in_all))


def _others(count: int, some: Ints) -> Ints:
    """The numbers from 0 to count that are not among some."""
    rest = np.ones(count, dtype=bool)
    rest[some] = False
    return np.flatnonzero(rest)
