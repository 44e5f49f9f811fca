"""Which found dot is which dot of the target.

A target has a regular part. Dots are numbered along such a lattice, which grows from one dot and its neighbours over
all of them, on the target and in the image; the target is laid onto the found dots in every way that takes lattice to
lattice (turns, shears, reflections, shifts), and in the way that makes the fewest errors. What is accepted has passed
five tests:

- chance: were the found dots strewn at random, each predicted dot would be hit with a probability p (the share of the
  area near found dots). The expected number of hypotheses as good by accident, hypotheses tried times the binomial tail
  P(hits or more of those predicted in view, beyond the dots that made the hypothesis), must be below 1e-9;
- shares: at least half of the dots predicted in view are found, and at least half of the found ones are explained;
- rivals: call each dot missing in view and each found dot unexplained an error. Every other way to lay the target onto
  the found dots by one of its near-symmetries must make four errors more. If errors come
  singly, in one dot of thirty, that is a likelihood ratio near a million. It is also a guarantee: where a near-symmetry
  makes d errors on the perfect target, it makes at least d - e on one with e errors, so it can only win when
  2 e >= d + 4. For the DeltaLab target d is 18 (its turns), so no ten errors, wherever they are, make it wrong; where
  only a part of it is in view, d must be 17 at least among the dots in view, which says the same (or as much as d is on
  the whole target, where that is less);
- alone: the dots that are left must not show the target once more, or mirrored;
- orientation: a camera never sees a target mirrored. Mirrored near-symmetries are rivals like all others, but for
  those of a target that is its own mirror image: of these nothing tells a photograph from its mirror image.

A target that is its own image when it is turned is identified only with a hint (`turned`).
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import bdtrc

from cpcal.common.errors import CpcalError
from cpcal.common.values import ArrayLike, ArrayPair, Bools, Floats, Ints, floats, norms
from cpcal.robot import Pose, transformed
from cpcal.solver.compiled import compiled
from cpcal.vision.camera import Camera
from cpcal.vision.projection import fit_homography, fitted, mapped, median
from cpcal.vision.target import Board, Target

# ------------------------------------------------------------------------------------------------------------------
# Found dots as a pinhole camera without distortion would see them, by the camera or by guesses of it.

_EXACT = 0.015  # of the spacing: how far a dot may be off when the camera is known
_GUESSED = 0.06  # the same when it is guessed
_ANGLES = (0.3, 0.42, 0.5, 0.57, 0.63, 0.68, 0.73, 0.78, 0.84)  # rad: of fisheyes' half diagonals, from mild to strong
_BENDS = (0.0, 0.03, 0.06, 0.1)  # of lenses that bend outwards, at half the diagonal; and none


@dataclass(frozen=True, eq=False)
class View:
    """Points (n, 2), directions in which straight lines are straight; their x rise, y still points down.

    members    (n,) which pixels show them
    spacing    median distance between nearest neighbours
    reach      how far a dot may be off its predicted place
    """

    points: Floats
    members: Ints
    spacing: float
    reach: float
    camera: Camera

    def in_view(self, predicted: Floats, margin: Floats) -> Bools:
        """Which predicted points (..., 2) would be seen whole, `margin` (...) their radius."""
        low, high = _seen_rectangle(self.camera)
        inside = np.asarray(((predicted >= low) & (predicted <= high)).all(axis=-1))
        pixels = self.camera.pixels(np.where(inside[..., None], predicted, 0.0))
        edge = (2.0 * margin * self.camera.focal.max())[..., None]  # whole, and some plate around it
        size = np.array([self.camera.width, self.camera.height])
        return np.asarray(inside & ((pixels >= edge - 0.5) & (pixels <= size - 0.5 - edge)).all(axis=-1))


@lru_cache(maxsize=8)
def _seen_rectangle(camera: Camera) -> ArrayPair:
    """The rectangle around all directions that the image shows."""
    rays = camera.normalised(camera.spread)
    return np.nanmin(rays, axis=0), np.nanmax(rays, axis=0)


def view_of(camera: Camera, pixels: Floats, off: float = _EXACT) -> View:
    """The directions of the pixels (n, 2) that the camera can show, which may be `off` by so much of the spacing."""
    rays = camera.normalised(pixels)
    members = np.argsort(rays[:, 0])[: np.isfinite(rays).all(axis=1).sum()]
    points = rays[members]
    spacing = median(np.asarray(cKDTree(points).query(points, 2)[0])[:, 1]) if len(points) > 1 else 0.0
    return View(points, members, spacing, off * spacing, camera)


def _guesses(size: tuple[int, int]) -> list[Camera]:
    """Cameras of an image's size (width, height): ordinary lenses, a little distorted, then more and more."""
    half = 0.5 * (np.array(size, np.float64) - 1.0)
    radius = float(np.linalg.norm(half))
    outwards = [Camera(*size, np.full(2, radius), half, np.array([bend, 0, 0, 0, 0])) for bend in _BENDS]
    inwards = [Camera(*size, np.full(2, radius / angle), half, np.zeros(4), "fisheye") for angle in _ANGLES]
    return [outwards[0], *inwards[:5], *outwards[1:], *inwards[5:]]


def nearest(view: View, predicted: Floats, reach: float) -> Ints:
    """For each predicted dot of m hypotheses (m, n, 2) the found one (m, n) that is its nearest, and the other way
    round, within `reach`; -1 where none is."""
    first, out = np.searchsorted(view.points[:, 0], predicted[..., 0] - reach), np.empty(predicted.shape[:-1], np.int64)
    mutually_nearest(view.points, predicted, first, reach, out)
    return out


def pairs(view: View, predicted: Floats, reach: float) -> tuple[Ints, Ints]:
    """Found dots and predicted ones (n, 2) that are each other's nearest, within `reach`."""
    found = nearest(view, predicted[None], reach)[0]
    numbers = np.flatnonzero(found >= 0)
    return found[numbers], numbers


@compiled
def mutually_nearest(points: Floats, places: Floats, first: Ints, reach: float, out: Ints) -> None:
    """`nearest` among points (k, 2) whose x rise, and the `first` (m, n) of them that is not too far to the left. A
    place that is nan has none."""
    for m in range(len(places)):
        closest, owner = np.full(len(points), np.inf), np.full(len(points), -1)
        for i in range(places.shape[1]):
            out[m, i], least, k = -1, reach * reach, first[m, i]
            while k < len(points) and points[k, 0] <= places[m, i, 0] + reach:
                dx, dy = points[k, 0] - places[m, i, 0], points[k, 1] - places[m, i, 1]
                square = dx * dx + dy * dy
                if square <= least:
                    out[m, i], least = k, square
                if square < closest[k]:
                    closest[k], owner[k] = square, i
                k += 1
        for i in range(places.shape[1]):
            if out[m, i] >= 0 and owner[out[m, i]] != i:
                out[m, i] = -1


# ------------------------------------------------------------------------------------------------------------------
# Lattices: dots numbered along the two shortest steps of a regular grid, whatever it is seen from.

_NEIGHBOURS, _TRIED = 8, 5  # of a dot, and those that may be a step away
_SYMMETRIC = 0.3  # of a step: how far two neighbours may be from opposite places
_CROOKED = 0.9  # cosine between the two steps, at most
_ANCHORS = 12  # dots that a lattice grows from, in turn
_RINGS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)  # steps from there, in which dots are numbered in turn
_OFF = 0.25  # of a step: how far from its place a dot is numbered, meanwhile
_SHARE, _PART = 0.5, 0.35  # of the dots that a way to lay the target must explain; and a lattice


class Lattice(NamedTuple):
    """nodes (k, 2) whole numbers of some dots; homography (3, 3) from there to the dots' places; members (k,) which."""

    nodes: Ints
    homography: Floats
    members: Ints


def lattices(points: Floats, off: float = _OFF) -> Iterator[Lattice]:
    """Lattices that explain a third of the points (n, 2) at least, to within `off` steps, from the most regular places
    first."""
    count = min(_NEIGHBOURS + 1, len(points))
    near = np.asarray(cKDTree(points).query(points, count)[1])[:, 1:]
    place = points @ [1.0, 1j]  # as complex numbers
    arms = place[near] - place[:, None]
    length = np.abs(arms)
    apart = np.abs(arms.T[:, :, None] + arms) / np.maximum(length, 1e-300)
    apart += np.triu(np.full((count - 1, count - 1), np.inf))[:, None]  # to a longer arm
    opposite, best = apart.argmin(axis=0), apart.min(axis=0)  # of each arm the one that is most nearly opposite
    anchors, taken = np.argsort(np.sort(best, axis=1)[:, 1]), np.zeros(len(points), bool)
    for _ in range(min(_ANCHORS, len(points))):
        first = int(taken[anchors].argmin())  # none that a lattice has, as long as there are others
        anchor, anchors = anchors[first], np.delete(anchors, first)
        even = best[anchor] < _SYMMETRIC
        steps = np.where(even, 0.5 * (arms[anchor] - arms[anchor, opposite[anchor]]), arms[anchor])
        both = itertools.combinations(range(min(_TRIED, count - 1)), 2)
        for one, other in sorted(both, key=lambda k: -even[[*k]].sum()):
            across = abs((steps[one] * steps[other].conjugate()).real)
            if across < _CROOKED * length[anchor, one] * length[anchor, other]:
                columns = np.array([steps[one], steps[other], place[anchor]])
                found = _grown_lattice(points, np.array([columns.real, columns.imag, [0.0, 0.0, 1.0]]), off)
                if found is not None:
                    taken[found.members] = True
                    yield found
                    break


def _grown_lattice(points: Floats, begun: Floats, off: float) -> Lattice | None:
    """What begins with a homography (3, 3) of two steps from a place, ring by ring over more and more of the points."""
    to_nodes, nodes, members = floats(np.linalg.inv(begun)), points[:0], np.arange(0)
    for ring in _RINGS:
        places = mapped(to_nodes, points)
        rounded, inside = np.rint(places), np.maximum(*np.abs(places).T) < ring + 0.5
        near = np.flatnonzero(inside & (np.maximum(*np.abs(places - rounded).T) < off))
        if len(near) < max(5, _SHARE * inside.sum()):
            break  # something else begins: another plate, a background
        if not fit_homography(points[near], rounded[near], 6 if ring == 1 else 8, to_nodes):
            break
        nodes, members = rounded[near], near
        if inside.all():
            break
    if len(members) < max(9, _PART * len(points)) or not abs(np.linalg.det(to_nodes)) > 1e-30:
        return None
    return Lattice(nodes.astype(np.int64), floats(np.linalg.inv(to_nodes)), members)


# Lattices onto themselves, but for shifts; of all shears those by one step. Plain ones come first.
_TURNS = np.array(
    sorted(
        ([[a, b], [c, d]] for a, b, c, d in itertools.product((-1, 0, 1), repeat=4) if abs(a * d - b * c) == 1),
        key=lambda turn: int(np.abs(turn).sum()),
    )
)
_PLAIN = 0.8  # of the nodes: what a plain turn meets where there is no shear
_SHIFTS = 4  # of each, at most


def ways(some: Ints, others: Ints) -> tuple[Ints, Ints]:
    """Of all (m, 3, 3) that take nodes (n, 2) to others (k, 2) those that meet the most, for each turn and shear; and
    how many they meet (m,)."""
    for turns in (_TURNS[:8], _TURNS):
        shifts = np.empty((len(turns), _SHIFTS, 3), np.int64)
        most_met(some @ np.swapaxes(turns, 1, 2), others, shifts)
        if some is not others and shifts[..., 2].max() >= _PLAIN * min(len(some), len(others)):
            break  # no shear is needed
    maps = np.zeros((len(turns), _SHIFTS, 3, 3), np.int64)
    maps[..., :2, :2], maps[..., :2, 2], maps[..., 2, 2] = turns[:, None], shifts[..., :2], 1
    return maps.reshape(-1, 3, 3), shifts[..., 2].ravel()


@compiled
def most_met(turned: Ints, others: Ints, shifts: Ints) -> None:
    """Of nodes turned in m ways (m, n, 2) the shifts (m, _SHIFTS, 3) that take most of them to others (k, 2): x, y, and
    how many."""
    far = np.abs(turned).max() + np.abs(others).max()
    size = 2 * far + 1
    for m in range(len(turned)):
        met = np.zeros((size, size), np.int64)  # by shift; what is negative counts from the end
        for node in turned[m]:
            for other in others:
                met[other[0] - node[0], other[1] - node[1]] += 1
        for k in range(_SHIFTS):
            x, y = divmod(met.argmax(), size)
            shifts[m, k, 0], shifts[m, k, 1] = (x + far) % size - far, (y + far) % size - far
            shifts[m, k, 2], met[x, y] = met[x, y], -1


# ------------------------------------------------------------------------------------------------------------------
# Ways to lay a target onto itself so that many dots cover dots: what an identification may be mistaken for.

_TOLERANCE = 0.25  # of the radius
_REGULAR = 0.03  # of a step: how far a dot may be off the grid


class SelfMaps(NamedTuple):
    """Affine maps S, other than the identity, best first.

    matrix (m, 3, 3); image (m, n): the dot that S lays dot i on, or -1; mirrored (m,); exact (m,) whether S lays all
    dots onto dots
    places (m, n, 2) mm: what S lays on dot i, S^-1 of its place: where the dots are if the target is mistaken so
    """

    matrix: Floats
    image: Ints
    mirrored: Bools
    exact: Bools
    places: Floats


@lru_cache(maxsize=8)
def grid_of(target: Target) -> Lattice | None:
    """The lattice of a target's regular part, if it has one."""
    return max(lattices(target.dots, _REGULAR), key=lambda found: len(found.nodes), default=None)


@lru_cache(maxsize=8)
def self_maps(target: Target) -> SelfMaps:
    """The maps of its lattice onto itself that lay at least half of the dots onto dots."""
    dots, grid = target.dots, grid_of(target)
    assert grid is not None  # nothing was identified without one
    maps, counts = ways(grid.nodes, grid.nodes)
    matrix = grid.homography @ maps[counts >= 0.4 * len(grid.nodes)] @ np.linalg.inv(grid.homography)
    matrix /= matrix[:, 2:, 2:]
    away, nearest = cKDTree(dots).query(mapped(matrix, dots), distance_upper_bound=_TOLERANCE * target.radius)
    image = np.where(np.isfinite(away), nearest, -1)
    share, identity = (image >= 0).mean(axis=1), (image == np.arange(len(dots))).mean(axis=1) > 0.5
    keep = np.flatnonzero((share >= _SHARE) & ~identity)
    keep = keep[np.argsort(-share[keep], kind="stable")]
    matrix, image = matrix[keep], image[keep]
    mirrored, exact = (np.asarray(test) for test in (np.linalg.det(matrix) < 0.0, (image >= 0).all(axis=1)))
    return SelfMaps(matrix, image, mirrored, exact, mapped(np.linalg.inv(matrix), dots))


# ------------------------------------------------------------------------------------------------------------------
# From a lattice to a homography that explains the dots, and what rivals it has.

_NEARLY_ALL = 0.9  # of the dots: a homography that needs no more growing
_STRAYED = 0.3  # of the spacing: how far dots may be from where the image before has them
_BEYOND = 8  # dots that make a hypothesis and so do not speak for it
_LATTICES = 6  # of the found dots, at most
_LAID, _COMPARED, _FOLLOWED = 16, 4, 2  # ways to lay the target that meet the most nodes; the most dots; and the best
_ROUGH = 0.1  # of the spacing: how far dots may be off for that
TRIED = _LATTICES * len(_TURNS) * 1000  # hypotheses, at most: for what chance alone would explain


class Hypothesis(NamedTuple):
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


def hypotheses(view: View, target: Target) -> Iterator[Hypothesis]:
    """Of each lattice of the found dots the way to lay the target onto it that makes the fewest errors; where a target
    is its own mirror image the one that a camera can see."""
    grid = grid_of(target)
    if grid is None:
        return
    for seen in itertools.islice(lattices(view.points), _LATTICES):
        maps, counts = ways(grid.nodes, seen.nodes)
        best = np.argsort(-counts, kind="stable")[:_LAID]
        homographies = seen.homography @ maps[best] @ np.linalg.inv(grid.homography)
        radius, rough = _radius(homographies[0], target), replace(view, reach=_ROUGH * view.spacing)
        laid = mapped(homographies, target.dots)
        most = np.argsort(-(nearest(rough, laid, rough.reach) >= 0).sum(axis=1), kind="stable")[:_COMPARED]
        homographies, errors = homographies[most], _compared(rough, laid[most], radius)[2]
        order = np.lexsort((_mirrored(homographies, target), errors))[:_FOLLOWED]
        fits: list[Hypothesis] = []
        for k in order:
            if fits and fits[0].errors + MARGIN <= errors[k]:
                break  # the other is no rival
            fits += [fit] if (fit := _grown(view, target, homographies[k])) is not None else []
        if fits:
            yield min(fits, key=lambda fit: (fit.errors, fit.mirrored))


def followed(view: View, target: Target, homography: Floats) -> Hypothesis | None:
    """The fit that a homography near the true one begins, where it leaves no choice: nearly all dots are where the
    target has them, and none lies between there and the next. None otherwise."""
    fit = _grown(view, target, homography, _STRAYED * view.spacing)
    if fit is None or len(fit.found) < _NEARLY_ALL * max(len(view.points), 1):
        return None
    wider = pairs(view, mapped(fit.homography, target.dots), _STRAYED * view.spacing)[1]
    return fit if np.array_equal(wider, fit.numbers) else None


def _grown(view: View, target: Target, homography: Floats, reach: float = 0.0) -> Hypothesis | None:
    """A homography grown over all dots that it predicts."""
    for least in (max(reach, 0.2 * view.spacing), 0.2 * view.spacing, view.reach):
        found, numbers = pairs(view, mapped(homography, target.dots), max(least, view.reach))
        if len(found) < _BEYOND:
            return None
        homography = fitted(target.dots[numbers], view.points[found])
        if len(found) > _NEARLY_ALL * min(len(target.dots), len(view.points)):
            break
    found, in_view, errors = _compared(view, mapped(homography, target.dots)[None], _radius(homography, target))
    numbers, mirrored = np.flatnonzero(found[0] >= 0), bool(_mirrored(homography, target))
    return Hypothesis(homography, found[0, numbers], numbers, in_view[0], int(errors[0]), mirrored)


def _mirrored(homography: Floats, target: Target) -> Bools:
    """Whether no camera sees it so: y points down in the view, and on OpenCV's boards, but up on other targets."""
    depth = homography[..., 2, :2] @ target.dots.mean(axis=0) + homography[..., 2, 2]
    return np.asarray((np.linalg.det(homography) * depth > 0.0) != bool(target.board))


def _compared(view: View, predicted: Floats, radius: Floats) -> tuple[Ints, Bools, Ints]:
    """Which found dots are those of the target (m, n, 2), -1 where none is; which should be in view, and the errors
    (m,)."""
    found = nearest(view, predicted, view.reach)
    in_view = view.in_view(predicted, radius) | (found >= 0)
    return found, in_view, in_view.sum(axis=1) + len(view.points) - 2 * (found >= 0).sum(axis=1)


def _radius(homography: Floats, target: Target) -> Floats:
    """(n,) the radius of the dots, where they are laid."""
    depth = target.dots @ homography[2, :2] + homography[2, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(target.radius * np.sqrt(np.abs(np.linalg.det(homography) / depth**3)))


def accidents(view: View, hypothesis: Hypothesis) -> float:
    """Expected number of hypotheses that explain as many dots if the dots were strewn at random."""
    area = float(np.prod(np.ptp(view.points, axis=0)))
    chance = min(1.0, len(view.points) * np.pi * view.reach**2 / max(area, 1e-300))
    hits, trials = len(hypothesis.found) - _BEYOND, int(hypothesis.in_view.sum()) - _BEYOND
    return float(TRIED * bdtrc(hits - 1, trials, chance)) if hits > 0 else float(TRIED)


def best_rival(view: View, target: Target, fit: Hypothesis, margin: int, *, mirrored: bool = True) -> tuple[int, bool]:
    """How many errors more than `fit` the best near-symmetric hypothesis makes, and whether it is mirrored to it; with
    `mirrored` False of those that are not. Maps that cannot come within the margin are not laid: what they make at
    least is told of them."""
    maps = self_maps(target)
    rival = ~maps.exact & (mirrored | ~maps.mirrored)
    seen = np.zeros(len(target.dots), bool)
    seen[fit.numbers] = True
    false = len(view.points) - len(fit.found)
    unexplained = (seen & (maps.image < 0)).sum(axis=1) - false  # at least: false dots may become true ones
    close = np.flatnonzero(rival & (unexplained < fit.errors + margin))
    passed = np.delete(unexplained, close)[np.delete(rival, close)] - fit.errors
    least = int(passed.min()) if len(passed) else len(target.dots)
    if not len(close):
        return least, False
    radius = _radius(fit.homography, target)
    errors = _compared(view, mapped(fit.homography, maps.places[close]), radius)[2]
    best = int(errors.argmin())
    return min(int(errors[best]) - fit.errors, least), bool(maps.mirrored[close[best]])


def apart(view: View, target: Target, fit: Hypothesis) -> int:
    """How many errors, `_APART` at most, the best near-symmetry that a camera could see (none of the mirrored) makes on
    dots that are all where `fit` has them, and in view."""
    shown = np.flatnonzero(fit.in_view)
    points = mapped(fit.homography, target.dots[shown])
    rising = np.argsort(points[:, 0])
    perfect, points = fit._replace(found=rising, numbers=shown[rising], errors=0), points[rising]
    return min(_APART, best_rival(replace(view, points=points), target, perfect, _APART, mirrored=False)[0])


# ------------------------------------------------------------------------------------------------------------------
# The answer.

_ACCIDENTS = 1e-9  # expected number of hypotheses as good by chance
MARGIN = 4  # errors by which every rival must be worse
FEWEST = 12  # dots
_ANOTHER = 20  # dots that are not the target's and so may be another one's
_MIRRORED = "the dots show the target's mirror image"
_NEARLY = 0.1  # errors per dot with which no better guess of the distortion is looked for
SIDES = {"top": (0.0, -1.0), "bottom": (0.0, 1.0), "left": (-1.0, 0.0), "right": (1.0, 0.0)}
_AIMED = 0.77  # cosine between where the first row is said to be and where it is: within 40 degrees
_APART = 2 * 10 - MARGIN + 1  # errors between two ways to lay the target, so that no ten errors exchange them


class Unidentified(CpcalError):
    """The found dots are not, or not certainly, those of the target. Its text is the reason, "" when that is not worth
    telling; `final`: no other hypothesis could change it; `errors` that the refused one makes."""

    def __init__(self, reason: str, final: bool = False, errors: int = 0) -> None:
        super().__init__(reason)
        self.final, self.errors = final, errors


@dataclass(frozen=True, eq=False)
class Identification:
    """Pairs of found dots and dots of the target.

    found       (m,) which of the given centres
    numbers     (m,) which dots of the target they are
    false       found dots that are none of the target's
    missing     dots of the target that should be in view and were not found
    margin      how many errors more every rival has at least
    """

    found: Ints
    numbers: Ints
    false: Ints
    missing: Ints
    margin: int


def identify(
    centers: ArrayLike,
    target: Target,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    near: Floats | None = None,
) -> Identification:
    """Which of the centres (n, 2), pixels, is which dot of the target; of a target that is its own image when it is
    turned in any of these ways.

    With a camera its distortion is taken away first. Without one an ordinary lens is allowed for: radial distortion of
    one parameter is searched for, about the middle of an image of `size` (width, height),
    left out: that holds the dots.
    `near` (3, 3) is a homography from the target's plane (mm) to the camera's directions that may be near the true one,
    as that of the image before: it saves the search where it leaves no choice, and what it leads to passes the same
    tests.

    Raises Unidentified with the reason. Centres that are not finite count as false dots.
    """
    pixels = floats(centers).reshape(-1, 2)
    usable = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    _check_count(len(usable), target)
    best, reason = None, "no grid of the target was recognised among the dots"
    size = size or tuple((2.0 + pixels[usable].max(axis=0)).astype(int).tolist())
    for seen_by in _guesses(size) if camera is None else [camera]:
        view = view_of(seen_by, pixels[usable], _GUESSED if camera is None else _EXACT)
        if camera is not None:
            _check_count(len(view.points), target)
        if not view.spacing > 0.0:
            raise Unidentified("most dots lie on one another")
        fit = None if near is None else followed(view, target, near)
        answer = None if fit is None else _tested(view, target, fit)
        if not isinstance(answer, Identification):
            answer = _in_view(view, target)
        if isinstance(answer, Identification):
            if camera is not None and len(answer.false) >= _ANOTHER:  # which one is meant?
                other = _in_view(replace(view, points=view.points[answer.false]), target)
                if isinstance(other, Identification):
                    raise Unidentified("ambiguous: the target is in sight twice")
                if str(other) == _MIRRORED:
                    raise Unidentified("ambiguous: the target and its mirror image are in sight")
            if best is None or len(answer.found) > len(best.found):
                best = replace(answer, found=usable[view.members[answer.found]])
            if len(answer.missing) + len(answer.false) <= _NEARLY * len(view.points):
                break
        else:
            reason = str(answer) or reason
            if answer.final and (camera is not None or answer.errors <= _NEARLY * len(view.points)):
                break
    if best is None:
        raise Unidentified(reason)
    return replace(best, false=np.delete(np.arange(len(pixels)), best.found))


def turned(
    found: Identification, centers: Floats, target: Target, first_row: str | Pose, camera: Camera | None
) -> Identification:
    """Of a target that is its own image when it is turned the way that a hint tells: on which side (one of SIDES) the
    image shows the row where y is least, or a pose near the true one. "" where there is none, or none is needed.

    Raises Unidentified where a hint is needed, or does not tell.
    """
    if target.printed:
        maps = Board.parsed(target.board).turns()
    else:
        known = self_maps(target)
        maps = list(known.image[known.exact & ~known.mirrored])
    if not maps:
        return found
    if not first_row:
        raise Unidentified("ambiguous: the target looks the same when it is turned; say where its first row is")
    places, seen = target.dots[found.numbers], centers[found.found]
    if isinstance(first_row, Pose):
        assert camera is not None
        aim = -_growth(places, camera.project(transformed(first_row, target.points[found.numbers])))
    else:
        aim = np.array(SIDES[first_row])
    all_ways = [found.numbers, *(image[found.numbers] for image in maps)]
    slopes = np.array([-_growth(target.dots[way], seen) for way in all_ways])
    cosines = slopes @ aim / norms(slopes) / norms(aim)
    best = int(np.argmax(cosines))
    if cosines[best] < _AIMED:
        raise Unidentified("ambiguous: the first row of the target is not clearly where the hint says")
    return replace(found, numbers=all_ways[best])


def _growth(places: Floats, seen: Floats) -> Floats:
    """(2,) how pixels (n, 2) move as y of the places (n, 2) grows."""
    return np.asarray(np.linalg.lstsq(places - places.mean(axis=0), seen, rcond=None)[0][1])


def _check_count(count: int, target: Target) -> None:
    if count < FEWEST:
        raise Unidentified(f"{count} dots are too few: at least {FEWEST} are needed")
    if count > len(target.dots) / _SHARE:
        raise Unidentified(f"{count} dots are too many: the target has {len(target.dots)}")


def _in_view(view: View, target: Target) -> Identification | Unidentified:
    refusal = Unidentified("")
    for hypothesis in hypotheses(view, target):
        answer = _tested(view, target, hypothesis)
        if isinstance(answer, Identification) or answer.final:
            return answer
        refusal = answer if str(answer) else refusal
    return refusal


def _tested(view: View, target: Target, fit: Hypothesis) -> Identification | Unidentified:
    """The five tests of a hypothesis, but whether the target is alone."""
    in_view = int(fit.in_view.sum())
    by_chance = accidents(view, fit)
    if by_chance > _ACCIDENTS or len(fit.found) < FEWEST:
        return Unidentified("")
    if len(fit.found) < _SHARE * in_view:
        return Unidentified(
            f"only {len(fit.found)} of the {in_view} dots of the target that should be in view were found"
        )
    if len(fit.found) < _SHARE * len(view.points):
        return Unidentified(f"only {len(fit.found)} of the {len(view.points)} dots found would be the target's")
    margin, reflected = best_rival(view, target, fit, MARGIN)
    if fit.mirrored:
        return Unidentified(_MIRRORED if margin >= MARGIN else "", margin >= MARGIN, fit.errors)
    if margin < MARGIN:
        other = "the target's mirror image fits" if reflected else "another assignment fits"
        final = margin > -MARGIN  # else it is to be found
        return Unidentified(f"ambiguous: {other} as well or nearly so", final, fit.errors)
    maps = self_maps(target)
    in_all = 2 * (maps.image[~maps.mirrored & ~maps.exact] < 0).sum(axis=1).min(initial=_APART)  # missing, and too many
    if not fit.in_view.all() and apart(view, target, fit) < min(_APART, int(in_all)):
        return Unidentified("ambiguous: too few of the dots that tell the target's turns apart are in view")
    false, unseen = np.delete(np.arange(len(view.points)), fit.found), fit.in_view.copy()
    unseen[fit.numbers] = False
    missing = np.flatnonzero(unseen)
    return Identification(fit.found, fit.numbers, false, missing, margin)
