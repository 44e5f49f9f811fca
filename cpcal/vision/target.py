"""The target: dots on a plate, two of whose rows tell where its axes are, whatever it is seen from."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem, shown
from cpcal.common.values import Floats, Indices, Value, frozen_array

MOST_DOTS = 500  # what identification takes grows with the square, and with symmetries faster
MOST_LINES = 20  # identifying rows
LARGEST = 1e6  # mm: of coordinates and radii
SMALLEST = 1e-6  # mm: of radii
MOST_SCALE_SIGMA = 0.1  # a plate less known than so is no target

_TOLD = 10  # overlapping pairs, in a message
_OFF_LINE = 0.1  # of the radius: a measured plate's dots lie on a line as well as it was printed


@dataclass(frozen=True, eq=False)
class Target(Value):
    """Equal round dots in the plane z = 0 of the target frame.

    dots    (n, 2) mm, their centres
    radius  mm
    lines   for each identifying row the numbers of its dots in order; the cross-ratios of its first four and its last
            four dots differ, so that a row is recognised together with its direction (the paper, section 2.3.1)
    bright  whether the dots are brighter than the plate
    scale_sigma  standard deviation of the plate's true size over the stated one: how well the scale was measured
    dot_sigma    mm, standard deviation of a dot's x and of its y on the plate about the stated ones

    Raises InputError when the values make no target.
    """

    name: str
    dots: Floats
    radius: float
    lines: tuple[tuple[int, ...], ...]
    bright: bool = True
    scale_sigma: float = 0.0
    dot_sigma: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "dots", frozen_array(self.dots))
        object.__setattr__(self, "lines", tuple(tuple(int(i) for i in line) for line in self.lines))
        if self.dots.ndim != 2 or self.dots.shape[1] != 2 or not np.isfinite(self.dots).all():
            raise InputError([Problem("target dots", "are not rows of two finite numbers", "give x and y in mm")])
        problems = self.problems_of(self.dots, self.radius, self.lines)
        problems += wrong_deviations(self.scale_sigma, self.dot_sigma, self.radius)
        if problems:
            raise InputError(problems)

    @staticmethod
    def problems_of(dots: Floats, radius: float, lines: tuple[tuple[int, ...], ...]) -> list[Problem]:
        """What keeps finite dots (n, 2) from being a target."""
        out: list[Problem] = []
        if not SMALLEST <= radius <= LARGEST:
            return [Problem("target radius", f"is {radius:g}", f"give mm, from {SMALLEST:g} to {LARGEST:g}")]
        if not (np.abs(dots) <= LARGEST).all():
            k = int(np.argmax((np.abs(dots) > LARGEST).any(axis=1)))
            what = "place dot {} at ({:g}, {:g}): no plate is so large".format(k, *dots[k])
            return [Problem("target dots", what, f"give mm, at most {LARGEST:g}")]
        if len(dots) > MOST_DOTS:
            return [Problem("target dots", f"are {len(dots):,}", f"give at most {MOST_DOTS}")]
        for i, j in itertools.islice(_overlapping(dots, radius), _TOLD):
            apart = float(np.linalg.norm(dots[i] - dots[j]))
            what = f"{i} and {j} are {apart:g} mm apart and overlap" if apart else f"{i} and {j} are in the same place"
            out.append(Problem("target dots", what, "give each dot once, farther apart than its diameter"))
        if len(lines) > MOST_LINES:
            out.append(Problem("target lines", f"are {len(lines):,}", f"give at most {MOST_LINES}"))
        for line in lines[:MOST_LINES]:
            if len(line) < 4 or len(set(line)) < len(line) or not all(0 <= i < len(dots) for i in line):
                out.append(
                    Problem("target lines", f"{shown(line)} are not four or more of the dots", "number dots from 0")
                )
            elif not off_line(dots[list(line)]) <= _OFF_LINE * radius:
                out.append(
                    Problem("target lines", f"the dots {shown(line)} are not collinear", "correct their centres")
                )
        return out

    @property
    def points(self) -> Floats:
        """The centres (n, 3) mm in the target frame."""
        return np.concatenate([self.dots, np.zeros((len(self.dots), 1))], axis=1)


def wrong_deviations(scale_sigma: float, dot_sigma: float, radius: float) -> list[Problem]:
    """What keeps two numbers from being deviations of a plate with dots of that radius (mm)."""
    out = []
    if not 0.0 <= scale_sigma <= MOST_SCALE_SIGMA:
        remedy = f"give a share from 0 to {MOST_SCALE_SIGMA:g}: 0.0001 is 0.03 mm of 300"
        out.append(Problem("target scale_sigma", f"is {scale_sigma:g}", remedy))
    if not 0.0 <= dot_sigma <= radius:
        out.append(Problem("target dot_sigma", f"is {dot_sigma:g}", "give mm, from 0 to the radius"))
    return out


def _overlapping(dots: Floats, radius: float) -> Iterator[tuple[int, int]]:
    """Pairs of dots that are not farther apart than a diameter."""
    for i, dot in enumerate(dots[:-1]):
        near = np.linalg.norm(dots[i + 1 :] - dot, axis=1) <= 2.0 * radius
        yield from ((i, int(j)) for j in i + 1 + np.flatnonzero(near))


def off_line(points: Floats) -> float:
    """The largest distance of points (n, 2) to the line through the first and the last."""
    along = points[-1] - points[0]
    length = float(np.linalg.norm(along))
    if not length > 0.0:
        return np.inf
    return float(np.abs((points - points[0]) @ np.array([-along[1], along[0]])).max()) / length


def two_diagonals(
    name: str,
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    side: float,
    pitch: float,
    radius: float,
    bright: bool = True,
) -> Target:
    """Dots at signed distances (mm) from the middle along the diagonals y = x and y = -x, and on a square grid
    (`pitch`, up to side / 2 from the middle) wherever no diagonal is nearer than 0.6 of the pitch."""
    turn = np.sqrt(0.5)
    up, down = np.asarray(first, dtype=np.float64) * turn, np.asarray(second, dtype=np.float64) * turn
    steps = int(side // pitch) + 1
    ticks = (np.arange(steps) - 0.5 * (steps - 1)) * pitch
    grid = [(x, y) for y, x in itertools.product(ticks, ticks) if min(abs(x - y), abs(x + y)) * turn >= 0.6 * pitch]
    dots = np.concatenate([np.stack([up, up], axis=1), np.stack([down, -down], axis=1), np.reshape(grid, (-1, 2))])
    rows = (tuple(range(len(up))), tuple(range(len(up), len(up) + len(down))))
    return Target(name, dots, radius, tuple(row for row in rows if row), bright)


DELTALAB_TARGET = two_diagonals(  # the places are those of design_target(): a separation of 2.0 mm
    "asymmetric dots 300 mm",
    (-187.0, -96.0, -75.0, -27.0, 43.0, 132.0, 152.0),
    (-165.0, -118.0, -37.0, 10.0, 28.0, 153.0),
    side=280.0,
    pitch=25.0,
    radius=6.0,
)


# ------------------------------------------------------------------------------------------------------------------
# Where the dots of a target's two identifying rows go: their cross-ratios as far apart as a plate allows.
#
# The criterion. A row is recognised by the cross-ratio of its first or its last four dots (a *signature*: four of
# them in
# two rows). Dots found with errors of standard deviation sigma (mm on the plate, one coordinate) give a logarithm of
# the
# cross-ratio with the standard deviation sigma |grad log c|, so that two sequences of four dots are told apart at
# |log c_1 - log c_2| / (sigma sqrt(|grad log c_1|^2 + |grad log c_2|^2)) standard deviations. That number times
# sigma, in
# mm, is their *separation*: the error of a dot at which they are confused. The criterion is the least separation of a
# signature from
#
# - the other signatures,
# - every other four neighbours of a row, and every four with one dot missing between them,
# - every four neighbours of a line of the grid (along a side or a diagonal), and every four with one dot missing.
#
# A cross-ratio does not change when its four dots are read backwards, so directions need no cases of their own.

_ROWS = (7, 6)  # dots
_CHAINS = 200  # searches side by side, each from a start of its own
_GENERATIONS = 4_000
_LONGEST_STEP = 60.0  # mm


@dataclass(frozen=True)
class RowSeparation:
    """How well a target's rows are recognised, see the module: `least` of all, mm, and that of each signature (2k,)."""

    least: float
    signatures: Floats


def separation(target: Target) -> RowSeparation:
    """The criterion for any target with identifying rows; its other dots count as the grid.

    Raises InputError where the target has no rows.
    """
    if not target.lines:
        raise InputError([Problem(f"target {target.name!r}", "has no identifying rows", "give its lines")])
    rows = [_along(target.dots[list(line)]) for line in target.lines]
    grid = np.delete(target.dots, sorted({i for line in target.lines for i in line}), axis=0)
    criterion = _Criterion(tuple(len(row) for row in rows), _grid_sequences(grid))
    of_signatures = criterion(np.concatenate(rows)[None])[0]
    return RowSeparation(float(of_signatures.min()), of_signatures)


def design_target(
    name: str = "asymmetric dots",
    *,
    side: float = 280.0,
    pitch: float = 25.0,
    radius: float = 6.0,
    least_gap: float = 5.6,
    off_rows: float = 4.0,
    bright: bool = True,
    step: float = 1.0,
    seed: int = 1,
) -> Target:
    """A grid of dots with a 7-dot and a 6-dot diagonal whose separation is as large as a random search finds it.

    side       of the square that holds the dots' centres, mm
    pitch      of the grid, radius of the dots, mm
    least_gap  between the edges of any two dots, mm
    off_rows   how far the diagonals' dots stay from the grid's rows and columns, mm: a dot next to one of them would
               look like one of its dots in a distorted image
    step       the diagonals' dots sit at multiples of it from the middle, mm
    seed       of the search; the same arguments give the same target

    Raises InputError where the plate has no room.
    """
    lengths = {"side": side, "pitch": pitch, "radius": radius, "step": step}
    problems = [
        Problem(f"target {key}", f"is {value}", "give a positive number of mm")
        for key, value in lengths.items()
        if not 0.0 < value < np.inf
    ]
    problems += [
        Problem(f"target {key}", f"is {value}", "give mm, from 0")
        for key, value in {"least_gap": least_gap, "off_rows": off_rows}.items()
        if not 0.0 <= value < np.inf
    ]
    if problems:
        raise InputError(problems)
    plain = two_diagonals(name, (), (), side, pitch, radius, bright)
    places = _places(plain.dots, side, step, 2.0 * radius + least_gap, off_rows)
    criterion = _Criterion(_ROWS, _grid_sequences(plain.dots))
    search = _Search(criterion, places, 2.0 * radius + least_gap, np.random.default_rng(seed))
    best = search.best()
    return two_diagonals(name, best[: _ROWS[0]], best[_ROWS[0] :], side, pitch, radius, bright)


class _Criterion:
    """The least separation of each signature of rows (chains, dots), whose places are given one row after the other."""

    def __init__(self, rows: tuple[int, ...], grid: Floats) -> None:
        """`grid`: the coordinates (g, 4) of sequences of grid dots."""
        signatures: list[list[int]] = []
        others: list[list[int]] = []
        start = 0
        for count in rows:
            for four in _fours(count):
                ends = four in ((0, 1, 2, 3), tuple(range(count - 4, count)))
                (signatures if ends else others).append([start + i for i in four])
            start += count
        self.signatures = len(signatures)
        self.fours: Indices = np.array(signatures + others, dtype=np.intp)
        self.grid = _log_cross_ratio(grid)

    def __call__(self, places: Floats) -> Floats:
        """(chains, dots) mm -> (chains, signatures) mm."""
        value, variance = _log_cross_ratio(places[:, self.fours])
        chains = len(places)
        value = np.concatenate([value, np.broadcast_to(self.grid[0], (chains, len(self.grid[0])))], axis=1)
        variance = np.concatenate([variance, np.broadcast_to(self.grid[1], (chains, len(self.grid[1])))], axis=1)
        k = self.signatures
        apart = np.abs(value[:, :k, None] - value[:, None, :])
        apart /= np.sqrt(variance[:, :k, None] + variance[:, None, :])
        apart[:, np.arange(k), np.arange(k)] = np.inf
        return np.asarray(apart.min(axis=2))


class _Search:
    """Chains of places that move when that does not make their criterion worse."""

    def __init__(self, criterion: _Criterion, places: Floats, distance: float, rng: np.random.Generator) -> None:
        self.criterion, self.places, self.distance, self.rng = criterion, places, distance, rng

    def best(self) -> Floats:
        """(dots,) mm, each row from its first dot to its last."""
        at = self.start()
        score = self.score(at)
        for generation in range(_GENERATIONS):
            longest = max(_LONGEST_STEP * 0.5 ** (8.0 * generation / _GENERATIONS), 1.5)
            new = self.moved(at, longest)
            new_score = self.score(new)
            better = new_score >= score
            at[better], score[better] = new[better], new_score[better]
        found: Floats = at[score.argmax()]
        return found

    def start(self) -> Floats:
        """A feasible start for each chain."""
        found: list[Floats] = []
        for _ in range(200):
            drawn = self.sorted(self.rng.choice(self.places, (20 * _CHAINS, sum(_ROWS))))
            found += list(drawn[self.allowed(drawn)])
            if len(found) >= _CHAINS:
                return np.array(found[:_CHAINS])
        what = f"has no room for rows of {_ROWS[0]} and {_ROWS[1]} dots"
        raise InputError([Problem("target", what, "give a larger side or a smaller radius")])

    def moved(self, at: Floats, longest: float) -> Floats:
        """Some dots of each chain shifted, to the nearest places there are."""
        step = self.rng.normal(size=at.shape) * longest * self.rng.random((len(at), 1)) ** 2
        share = self.rng.choice([1.0, 2.0, 4.0, 13.0], (len(at), 1)) / at.shape[1]
        new = at + np.where(self.rng.random(at.shape) < share, step, 0.0)
        right = np.clip(np.searchsorted(self.places, new), 1, len(self.places) - 1)
        low, high = self.places[right - 1], self.places[right]
        return self.sorted(np.where(new - low < high - new, low, high))

    def sorted(self, at: Floats) -> Floats:
        return np.concatenate([np.sort(at[:, : _ROWS[0]]), np.sort(at[:, _ROWS[0] :])], axis=1)

    def score(self, at: Floats) -> Floats:
        """The criterion (chains,), -1 where dots are too near each other."""
        allowed = self.allowed(at)
        out = np.full(len(at), -1.0)
        out[allowed] = self.criterion(at[allowed]).min(axis=1)
        return out

    def allowed(self, at: Floats) -> npt.NDArray[np.bool_]:
        first, second = at[:, : _ROWS[0]], at[:, _ROWS[0] :]
        near = np.minimum(np.diff(first).min(axis=1), np.diff(second).min(axis=1))
        across = np.sqrt(np.min(first**2, axis=1) + np.min(second**2, axis=1))  # the diagonals meet at a right angle
        return np.asarray(np.minimum(near, across) >= self.distance - 1e-9)


def _places(grid: Floats, side: float, step: float, distance: float, off_rows: float) -> Floats:
    """Multiples of `step` along a diagonal inside the square, far enough from the grid's dots and rows."""
    count = int(0.5 * side * np.sqrt(2.0) / step)
    places = np.arange(-count, count + 1) * step
    out = np.ones(len(places), dtype=bool)
    if len(grid):
        ticks = np.unique(grid)
        gaps = np.diff(ticks)
        out &= np.abs(places[:, None] * np.sqrt(0.5) - ticks).min(axis=1) >= off_rows - 1e-9
        for sign in (1.0, -1.0):
            dots = places[:, None] * np.array([1.0, sign]) * np.sqrt(0.5)
            out &= np.linalg.norm(dots[:, None] - grid, axis=2).min(axis=1) >= distance - 1e-9
        out &= bool((gaps[gaps > 1e-9] >= distance - 1e-9).all())
    if out.sum() < max(_ROWS):
        what = "has no room for the diagonals' dots"
        raise InputError([Problem("target", what, "give a larger side or pitch, or a smaller radius")])
    return np.asarray(places[out])


def _grid_sequences(grid: Floats) -> Floats:
    """The coordinates (g, 4) of fours of neighbours, or nearly so, on the grid's lines; each pattern of gaps once."""
    lines = []
    for direction in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)):
        along, across = np.array(direction), np.array([-direction[1], direction[0]])
        offset = np.round(grid @ across, 6)
        length = float(np.linalg.norm(along))
        lines += [np.sort(grid[offset == value] @ along) / length for value in np.unique(offset)]
    patterns = {tuple(np.round(np.diff(line[list(four)]), 6)) for line in lines for four in _fours(len(line))}
    return np.array([np.cumsum((0.0, *gaps)) for gaps in sorted(patterns)]).reshape(-1, 4)


def _fours(count: int) -> list[tuple[int, ...]]:
    """Four neighbours of `count` dots in a row, or four of five neighbours that keep their ends."""
    neighbours = [tuple(range(i, i + 4)) for i in range(count - 3)]
    return neighbours + [
        tuple(i + k for k in range(5) if k != missing) for i, missing in itertools.product(range(count - 4), (1, 2, 3))
    ]


def _along(points: Floats) -> Floats:
    """The coordinates (n,) of collinear points (n, 2) from the first one towards the last."""
    direction = points[-1] - points[0]
    return np.asarray((points - points[0]) @ (direction / np.linalg.norm(direction)))


def _log_cross_ratio(places: Floats) -> tuple[Floats, Floats]:
    """log of the cross-ratio of rising coordinates (..., 4), and the squared length of its gradient, (...) each."""
    a, b, c, d = np.moveaxis(places, -1, 0)
    ac, bd, bc, ad = 1.0 / (c - a), 1.0 / (d - b), 1.0 / (c - b), 1.0 / (d - a)
    value = np.log(bc * ad / (ac * bd))
    return np.asarray(value), (ad - ac) ** 2 + (bc - bd) ** 2 + (ac - bc) ** 2 + (bd - ad) ** 2
