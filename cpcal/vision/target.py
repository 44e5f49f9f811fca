"""The target: dots on a plate, two of whose rows tell where its axes are, whatever it is seen from."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import InputError, Problem, shown, unusable
from cpcal.common.values import Floats, Value, fill, frozen_array

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
        lines = tuple(tuple(int(i) for i in line) for line in self.lines)
        fill(self, dots=frozen_array(self.dots), lines=lines)
        if self.dots.ndim != 2 or self.dots.shape[1] != 2 or not np.isfinite(self.dots).all():
            raise unusable("target dots", "are not rows of two finite numbers", "give x and y in mm")
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
        distances = np.linalg.norm(dots[:, None] - dots, axis=2) if len(dots) else np.zeros((0, 0))
        for i, j in np.argwhere(np.triu(distances <= 2.0 * radius, 1))[:_TOLD].tolist():
            apart = float(distances[i, j])
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


def resized(target: Target, factor: float) -> Target:
    """So many times as large: cross-ratios do not know sizes, so rows are told apart at so many times the errors."""
    across = factor * float(np.ptp(target.dots, axis=0).max())
    name = f"asymmetric dots, {across:.4g} mm across"
    return replace(target, name=name, dots=factor * target.dots, radius=factor * target.radius)


# The places of the rows' dots are those of a random search. A row is recognised by the cross-ratio of its first or its
# last four dots (a signature). Dots found with errors of deviation sigma (mm) give log c the deviation
# sigma |grad log c|, so that two fours are told apart at |log c_1 - log c_2| / (sigma sqrt(|grad|^2 + |grad|^2))
# deviations. For this target that number times sigma is 2.0 mm at least, between a signature and every other four
# neighbours, or nearly so, of a row or of a line of the grid.
DELTALAB_TARGET = two_diagonals(
    "asymmetric dots 300 mm",
    (-187.0, -96.0, -75.0, -27.0, 43.0, 132.0, 152.0),
    (-165.0, -118.0, -37.0, 10.0, 28.0, 153.0),
    side=280.0,
    pitch=25.0,
    radius=6.0,
)
