"""The target: round dots, or the points of a printed board, with places in mm; a short text names the usual boards."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from cpcal.common.errors import refuse, unusable
from cpcal.common.values import ArrayLike, Floats, Ints, Numbers, Value, floats, freeze, norms

MOST_DOTS = 500  # what identification takes grows with the square, and with symmetries faster
LARGEST = 1e6  # mm: of coordinates and radii
SMALLEST = 1e-6  # mm: of radii
MOST_SCALE_SIGMA, MOST_DOT_SIGMA = 0.1, 10.0  # (mm) a plate less known than so is no target
POINT = 1e-3  # mm: the radius of a corner, as good as none

_TOLD = 10  # overlapping pairs, in a message


@dataclass(frozen=True, eq=False)
class Target(Value):
    """Equal round dots, or corners, in the plane z = 0 of the target frame.

    dots    (n, 2) mm, their centres; a part of them is a regular grid, and the others tell its turns apart
    radius  mm; of corners `POINT`
    bright  whether the dots are brighter than the plate; None: that is found out
    board   "" or what OpenCV's boards are called (`target_from`): their x goes right as they are printed, their y down,
            z into the board; y of other targets goes up, z out of the plate
    scale_sigma  standard deviation of the plate's true size over the stated one: how well the scale was measured
    dot_sigma    mm, standard deviation of a dot's x and of its y on the plate about the stated ones

    Raises InputError when the values make no target.
    """

    name: str
    dots: Floats
    radius: float
    bright: bool | None = True
    scale_sigma: float = 0.0
    dot_sigma: float = 0.0
    board: str = ""

    def __post_init__(self) -> None:
        freeze(self, "dots")
        if self.dots.ndim != 2 or self.dots.shape[1] != 2 or not np.isfinite(self.dots).all():
            raise unusable("target dots", "are not rows of two finite numbers", "give x and y in mm")
        if not SMALLEST <= self.radius <= LARGEST:
            raise unusable("target radius", f"is {self.radius:g}", f"give mm, from {SMALLEST:g} to {LARGEST:g}")
        if not (far := np.abs(self.dots).max(axis=1, initial=0.0) <= LARGEST).all():
            k = int(np.argmin(far))
            what = "place dot {} at ({:g}, {:g}): no plate is so large".format(k, *self.dots[k])
            raise unusable("target dots", what, f"give mm, at most {LARGEST:g}")
        if len(self.dots) > MOST_DOTS:
            raise unusable("target dots", f"are {len(self.dots):,}", f"give at most {MOST_DOTS}")
        if self.board and len(Board.parsed(self.board).dots) != len(self.dots):
            raise unusable("target board", f"{self.board} has not {len(self.dots)} dots", "give the board's, in order")
        wrong, distances = [], norms(self.dots[:, None] - self.dots)
        for i, j in np.argwhere(np.triu(distances <= 2.0 * self.radius, 1))[:_TOLD].tolist():
            apart = f"{distances[i, j]:g} mm apart and overlap" if distances[i, j] else "in the same place"
            remedy = "give each dot once, farther apart than its diameter"
            wrong.append((True, "target dots", f"{i} and {j} are {apart}", remedy))
        share = f"give a share from 0 to {MOST_SCALE_SIGMA:g}: 0.0001 is 0.03 mm of 300"
        size = f"give mm, from 0 to {MOST_DOT_SIGMA:g}"
        refuse(
            *wrong,
            (not 0.0 <= self.scale_sigma <= MOST_SCALE_SIGMA, "target scale_sigma", f"is {self.scale_sigma:g}", share),
            (not 0.0 <= self.dot_sigma <= MOST_DOT_SIGMA, "target dot_sigma", f"is {self.dot_sigma:g}", size),
        )

    @property
    def printed(self) -> bool:
        """Whether its points are corners of a board, not round dots."""
        return self.board.startswith(("chessboard", "charuco", "grid"))

    @property
    def points(self) -> Floats:
        """The centres (n, 3) mm in the target frame."""
        return np.concatenate([self.dots, np.zeros((len(self.dots), 1))], axis=1)


def two_diagonals(
    name: str,
    first: ArrayLike,
    second: ArrayLike,
    side: float,
    pitch: float,
    radius: float,
) -> Target:
    """Dots at signed distances (mm) from the middle along the diagonals y = x and y = -x, and on a square grid
    (`pitch`, up to side / 2 from the middle) wherever no diagonal is nearer than 0.6 of the pitch."""
    turn = np.sqrt(0.5)
    up, down = floats(first) * turn, floats(second) * turn
    steps = int(side // pitch) + 1
    ticks = (np.arange(steps) - 0.5 * (steps - 1)) * pitch
    grid = [(x, y) for y, x in itertools.product(ticks, ticks) if min(abs(x - y), abs(x + y)) * turn >= 0.6 * pitch]
    dots = np.concatenate([np.stack([up, up], axis=1), np.stack([down, -down], axis=1), np.reshape(grid, (-1, 2))])
    return Target(name, dots, radius)


def resized(target: Target, factor: float) -> Target:
    """So many times as large."""
    across = factor * float(np.ptp(target.dots, axis=0).max())
    name = f"asymmetric dots, {across:.4g} mm across"
    return replace(target, name=name, dots=factor * target.dots, radius=factor * target.radius)


DELTALAB_TARGET = two_diagonals(
    "asymmetric dots 300 mm",
    (-187.0, -96.0, -75.0, -27.0, 43.0, 132.0, 152.0),
    (-165.0, -118.0, -37.0, 10.0, 28.0, 153.0),
    side=280.0,
    pitch=25.0,
    radius=6.0,
)


# ------------------------------------------------------------------------------------------------------------------
# The boards that people have, as OpenCV numbers their points: row by row, left to right, from the upper left corner.

TEXTS = (
    "acircles:COLUMNSxROWS:PITCH:DIAMETER (asymmetric; PITCH of the rows), circles:COLUMNSxROWS:PITCH:DIAMETER"
    ", chessboard:COLUMNSxROWS:PITCH (inner corners), charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY (squares), "
    "grid:COLUMNSxROWS:MARKER:GAP:DICTIONARY (ArUco or AprilTag); dictionaries such as 4X4_50, APRILTAG_36h11"
)
_LENGTHS = {"acircles": 2, "circles": 2, "chessboard": 1, "charuco": 2, "grid": 2}


@dataclass(frozen=True)
class Board:
    """What a short text says. `lengths` in mm: pitch and diameter; pitch; square and marker; or marker and gap."""

    kind: str
    columns: int
    rows: int
    lengths: Numbers
    dictionary: str

    @classmethod
    def parsed(cls, text: str) -> "Board":
        """Raises InputError."""
        kind, _, rest = text.partition(":")
        try:
            size, *more = rest.split(":")
            columns, rows = (int(part) for part in size.lower().split("x"))
            lengths = tuple(float(part) for part in more[: _LENGTHS[kind]])
            (dictionary,) = more[_LENGTHS[kind] :] or [""]
        except (ValueError, KeyError):
            raise unusable("target", f"is {text!r:.80}", f"give a target.toml or {TEXTS}") from None
        named = bool(dictionary) == (kind in ("charuco", "grid"))
        good = len(lengths) == _LENGTHS[kind] and all(0.0 < length <= LARGEST for length in lengths)
        if not (named and good and min(columns, rows) >= 2 and columns * rows <= MOST_DOTS):
            raise unusable("target", f"is {text!r:.80}", f"give mm and at most {MOST_DOTS} points: {TEXTS}")
        return cls(kind, columns, rows, lengths, dictionary)

    def nodes(self, columns: int, rows: int) -> Floats:
        """Column and row (n, 2) of every place, row by row."""
        return np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64)

    @property
    def dots(self) -> Floats:
        """(n, 2) mm; of a grid four corners of each marker, clockwise from its upper left one."""
        nodes, first = self.nodes(self.columns, self.rows), self.lengths[0]
        if self.kind == "acircles":
            nodes[:, 0] = 2.0 * nodes[:, 0] + nodes[:, 1] % 2.0
        elif self.kind == "charuco":
            nodes = self.nodes(self.columns - 1, self.rows - 1) + 1.0
        elif self.kind == "grid":
            corners = first * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
            return (sum(self.lengths) * nodes[:, None] + corners).reshape(-1, 2)
        return first * nodes

    def turns(self) -> list[Ints]:
        """The numbers (n,) of the points of a printed board that stand in the places of its points when it is turned
        and looks the same: of a chessboard, since markers never do."""
        if self.kind != "chessboard" or (self.columns + self.rows) % 2:
            return []
        quarters = (1, 2, 3) if self.columns == self.rows and self.columns % 2 == 0 else (2,)
        numbers = np.arange(self.columns * self.rows).reshape(self.rows, self.columns)
        return [np.rot90(numbers, count).ravel() for count in quarters]


def target_from(text: str) -> Target:
    """The board of a short text, `TEXTS`. Raises InputError."""
    board = Board.parsed(text)
    round_dots = board.kind in ("acircles", "circles")
    return Target(text, board.dots, 0.5 * board.lengths[1] if round_dots else POINT, None, board=text)
