"""Dots that the light of all does not explain, a shadow's edge or a smudge: under light of their own.

What moves a dot's centre and no residual shows is light that is not symmetric about it. So each fit tells what further
terms of the light (its growth, and its cubic) would be, had they been fitted, and with which covariance: where they
differ from the other dots' by more than the other dots differ among themselves, and move the centre, they are fitted
as well. A lens's asymmetry passes for light, too, and moves all dots alike; what it makes of a dot with light of its
own is taken off, so that this dot is moved as the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpcal.common.arrays import Bools, Floats, Ints
from cpcal.vision.dots.asymmetry import TERMS, excesses, term_values
from cpcal.vision.dots.edge import CUBIC, LINEAR, PLAIN, Edges, fitted_edges
from cpcal.vision.dots.grey import Grey
from cpcal.vision.dots.light import light_misfit
from cpcal.vision.dots.segmentation import Spots
from cpcal.vision.median import median

_STRANGE = 1.5  # residuals, relative to the usual ones, that ask for light of the dot's own
_BETTER = 0.95  # residuals with it relative to those without, then
_RARE = {6: 22.5, 4: 18.5, 2: 13.8}  # chi-square by degrees of freedom: what one ordinary dot of a thousand exceeds
_FREQUENT = {4: 9.5, 2: 6.0}  # one of twenty: where the light of all is wrong, more dots are doubted
_MEDIAN = {6: 5.35, 4: 3.36, 2: 1.39}
_ALL_WRONG = 6.0  # times what noise makes of the centres' moves: then the light of all is wrong, and of no use
_BENT, _LEFT = (
    2.5,
    1.2,
)  # so it is from this on where it leaves as much of the levels, as a share of the noise: usual is 0.3
_IMPERFECT = (
    0.006  # of the contrast: what the model of an edge leaves out, symmetric, and seems not to be by the pixels' places
)
_ENOUGH = 20  # dots that tell what is common to all


def fitted_under(grey: Grey, found: Spots, room: Floats, light: Floats) -> Edges:
    """The fits of spots under a light (n, 2), its growth per pixel, or under one of their own; `room` (n,) pixels
    beyond its edge are a dot's own. Where `light` is nan, each has to tell it itself."""
    if np.isnan(light).any():
        return _all_alone(grey, found, room)
    edges = fitted_edges(grey, found.center, found.spread, room, light)
    fitted = ~np.isnan(edges.noise)
    if not fitted.any():
        return edges
    excess = _excess(edges, 0)
    moved = median(np.where(excess.worth, excess.moves, 0.0)[fitted]) / _MEDIAN[2]
    bent = moved > _BENT and light_misfit(grey, found, 2.0 * room) > _LEFT * median(edges.noise[fitted])
    if moved > _ALL_WRONG or bent:
        return _all_alone(grey, found, room)
    usual = np.maximum(median(edges.noise[fitted]), _IMPERFECT * np.abs(edges.contrast))
    noisy = ~(edges.noise < _STRANGE * usual)
    again = np.flatnonzero(_beyond(excess, 6) | noisy)
    if not len(again):
        return edges
    common = _medians(edges, _told(edges, 0, LINEAR - PLAIN)[0], 0)
    own = fitted_edges(grey, found.center[again], found.spread[again], room[again], light[again], LINEAR)
    own.center[:] -= common @ edges.odd[again, :, TERMS + 1 :]
    better = ~(noisy[again] & (own.noise > _BETTER * edges.noise[again]))
    return _cubic(grey, found, room, light, edges.replaced(again[better], own.kept(better)), again[better])


def _all_alone(grey: Grey, found: Spots, room: Floats) -> Edges:
    flat = np.zeros((len(found), 2))
    edges = fitted_edges(grey, found.center, found.spread, room, flat, LINEAR)
    return _cubic(grey, found, room, flat, edges, np.arange(len(found)), _FREQUENT)


def _cubic(
    grey: Grey, found: Spots, room: Floats, light: Floats, edges: Edges, members: Ints, rare: dict[int, float] = _RARE
) -> Edges:
    """With the light's cubic for those members that ask for it and are explained by it. What it moves them by is in
    doubt as a whole, either way: light that has a cubic has more."""
    still = members[_beyond(_excess(edges, LINEAR - PLAIN), 4, rare)[members]]
    if not len(still):
        return edges
    cubic = fitted_edges(grey, found.center[still], found.spread[still], room[still], light[still], CUBIC)
    moved = cubic.center - edges.center[still]
    doubt = moved[:, :, None] * moved[:, None, :]
    usual = median(edges.noise[~np.isnan(edges.noise)])
    explained = cubic.noise < _STRANGE * usual
    cubic.covariance[:] += doubt
    edges.covariance[still] += np.nan_to_num(doubt)
    return edges.replaced(still[explained], cubic.kept(explained))


@dataclass(frozen=True, eq=False)
class _Excess:
    """Chi-squares (n,) of terms of the light against those that dots have in common, and of the moves of the centre
    that they would make, 0 where there is nothing to tell; whether such a move is worth to be known."""

    shapes: Floats
    moves: Floats
    worth: Bools


def _excess(edges: Edges, first: int) -> _Excess:
    """Of the terms from `first` on."""
    sharpness = edges.noise**2 / (edges.noise**2 + (_IMPERFECT * edges.contrast) ** 2)
    variance = edges.covariance[:, 0, 0] + edges.covariance[:, 1, 1]
    values, inverse = _told(edges, first, TERMS)
    common, count = _medians(edges, values, first), len(variance)
    out = _Excess(np.empty(count), np.empty(count), np.empty(count, dtype=bool))
    excesses(edges.odd, values, inverse, sharpness, variance, common, out.shapes, out.moves, out.worth)
    return out


def _beyond(excess: _Excess, degrees: int, rare: dict[int, float] = _RARE) -> Bools:
    """Which (n,) terms are no noise, and move the centre; where all dots differ by more than noise says (a lens's
    asymmetry, a camera's processing) that is the measure. All dots, not those alone that light has moved: a wide
    shadow's edge would be its own measure."""
    out = excess.worth.copy()
    for square, freedom in ((excess.shapes, degrees), (excess.moves, 2)):
        told = square[square > 0.0]
        usual = median(told) / _MEDIAN[freedom] if len(told) >= _ENOUGH else 1.0
        out &= square > rare[freedom] * max(1.0, usual)
    return out


def _told(edges: Edges, first: int, last: int) -> tuple[Floats, Floats]:
    """The terms (n, last - first) had they been fitted, and their covariances."""
    count, size = len(edges.odd), last - first
    values, inverse = np.empty((count, size)), np.empty((count, size, size))
    term_values(edges.odd, first, last, values, inverse)
    return values, inverse


def _medians(edges: Edges, values: Floats, first: int) -> Floats:
    """The medians (6,) over dots of their terms from `first` on, zero for the others."""
    out = np.zeros(TERMS)
    fitted = values[~np.isnan(edges.noise)]
    if len(fitted) >= _ENOUGH:
        out[first : first + values.shape[1]] = [median(column) for column in fitted.T]
    return out
