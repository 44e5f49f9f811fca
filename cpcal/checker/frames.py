"""Hand-eye studies: the rows of frames, of single images, and of what links them, derived from the study's numbers.

    x = R_X' (H (R_F p + f) + h - w) + e        a point of the board before the camera, for a pose (H, h)
    t_X = w - R_X e,   t_F = f - R_F c          p: from the board's centre c; e, f: where w and c are

X is the camera in the hand (or base), F the board in the base (or hand), H the motion between them. A pixel u seen to
within eps gives, times the depth, `+-(f (x_a) - (u_a - c_a) x_3) - (eps + half-width) x_3 <= 0`. Every row is exact: it
is multiplied by the square of its pose's quaternion, whose rotation is a rational matrix only divided by that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from itertools import product

from .bounds import Bounds, box_of, matrix, number, numbers
from .bounds import rotation as enclosed_rotation
from .polynomial import Polynomial, Spend, applied, dyadics, minus, plus, rotation_rows, transposed, unknown
from .readers import Refused
from .rule import Box, Problem

AXES = range(3)
R_X, T_X, R_F, T_F, E_, F_ = range(9), range(9, 12), range(12, 21), range(21, 24), range(24, 27), range(27, 30)
SIZE = 30  # unknowns of frames; those of an image follow: its board's turn (9) and place (3), and 6 of its reading
FRAMES = tuple(
    [f"{frame}.{name}" for frame in "XF" for name in (*(f"R{a}{b}" for a in "123" for b in "123"), "tx", "ty", "tz")]
    + [f"{name}.{axis}" for name in "ef" for axis in "xyz"]
)
EQUATIONS = 21  # of a rotation
SIDES = ("u+", "u-", "v+", "v-", "turn+", "turn-", "tie+", "tie-", "link+", "link-", "pose+", "pose-")
STAGES = ("image", "links", "frames")
_FINE = 64  # bits of what a link may be off
Terms = dict[tuple[int, ...], int]
Vector = Sequence[F]


@dataclass(frozen=True)
class Study:
    """Numbers of a study. A pose is a position and a quaternion, a point its image, undistorted pixel, place on the
    board and half-width; `widths`: of the readings of each pose."""

    in_hand: bool  # the camera is on the hand
    focal: Vector
    center: Vector
    images: tuple[str, ...]
    poses: tuple[tuple[Vector, Vector], ...]
    widths: tuple[Vector, ...]
    image: tuple[int, ...]
    names: tuple[str, ...]
    rays: tuple[Vector, ...]
    points: tuple[Vector, ...]
    half_width: Vector

    @cached_property
    def uncertain(self) -> bool:
        return any(map(any, self.widths))

    def motion(self, k: int) -> tuple[Sequence[Sequence[int]], int]:
        """H of an image times the square of its quaternion, and that square: whole numbers."""
        rows, norm = rotation(self.poses[k][1])
        return (transposed(rows) if self.in_hand else rows), norm


def rotation(q: Sequence[F | int]) -> tuple[list[list[int]], int]:
    """R(q) |q|^2 and |q|^2, of a quaternion times some power of two."""
    whole = dyadics(q).values
    return rotation_rows(whole), sum(c * c for c in whole)


def turn_equation(part: Sequence[int], k: int) -> Terms:
    """One of 21 polynomials that vanish at a rotation: R R' = I, R' R = I, R = cof R."""
    if k < 12:
        lines = [[part[3 * a + b] if k < 6 else part[3 * b + a] for b in AXES] for a in AXES]
        a, b = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))[k % 6]
        found: Terms = {(min(i, j), max(i, j)): 1 for i, j in zip(lines[a], lines[b], strict=True)}
        return found | {(): -1} if a == b else found
    a, b = divmod(k - 12, 3)
    p, q, s, t = (a + 1) % 3, (a + 2) % 3, (b + 1) % 3, (b + 2) % 3
    first, second = (part[3 * p + s], part[3 * q + t]), (part[3 * p + t], part[3 * q + s])
    return {(part[3 * a + b],): 1, (min(first), max(first)): -1, (min(second), max(second)): 1}


class Rows:
    """The rows of a stage for some images of a study, at a tolerance eps; `hand`: w, `board`: c, `sets`: boxes (12) of
    the poses of images that are known, `frames`: the box where it begins."""

    def __init__(
        self, study: Study, stage: str, images: Sequence[int], eps: F, hand: Vector, board: Vector,
        sets: Mapping[int, tuple[Vector, Vector]], frames: Box,
    ) -> None:  # fmt: skip
        if stage == "frames" and study.uncertain:
            raise Refused("the pixels of all images are tied by exact poses only")
        self.study, self.stage, self.sets, self._frames, self.wide = study, stage, sets, frames, study.uncertain
        places = dyadics(v for place in (hand, board, *(p for p, _ in study.poses), *study.points) for v in place)
        self._mm, values = places.power, zip(*[iter(places.values)] * 3, strict=True)
        self._hand, self._board, *others = values
        count = len(study.poses)
        self._places, self._points = others[:count], [minus(p, self._board) for p in others[count:]]
        off = (ray[a] - study.center[a] for ray in study.rays for a in (0, 1))
        values_px = dyadics([*study.focal, *(eps + width for width in study.half_width), *off]).values
        count = 2 + len(study.points)
        self._focal, self._width, self._off = values_px[:2], values_px[2:count], values_px[count:]
        self._motions: dict[int, tuple[Sequence[Sequence[int]], int, list[int]]] = {}
        names = [*(f"R{a}{b}" for a in "123" for b in "123"), "tx", "ty", "tz", "wx", "wy", "wz", "dx", "dy", "dz"]
        alone, own = stage == "image", [] if stage == "frames" else images
        each = 18 if self.wide and not alone else 12
        before = () if alone else FRAMES
        self.first = {k: len(before) + each * n for n, k in enumerate(own)}
        self.unknowns = (*before, *([*names[:12]] if alone else (f"{k}.{name}" for k in own for name in names[:each])))
        self.count = max(len(study.image), (EQUATIONS + 12) * (2 + len(study.images)))  # numbers of rows are below
        seen, parts = frozenset(images), [*(() if alone else (0, 1)), *(2 + k for k in own)]
        self.tags = [(side, n) for n, image in enumerate(study.image) if image in seen for side in SIDES[:4]]
        self.tags += product(SIDES[4:6], (EQUATIONS * part + k for part in parts for k in range(EQUATIONS)))
        if not alone:
            tied = (SIDES[8:10], images) if stage == "links" else (SIDES[10:], sets)
            self.tags += [
                *product(SIDES[6:8], range(6)),
                *product(tied[0], (12 * k + j for k in tied[1] for j in range(12))),
            ]
        self._known = frozenset(self.tags)

    def motion(self, k: int) -> tuple[Sequence[Sequence[int]], int, list[int]]:
        """H and n = |q|^2 of an image, and n (h - w)."""
        if k not in self._motions:
            turn, norm = self.study.motion(k)
            place = self._places[k]
            shift = [-v for v in applied(turn, place)] if self.study.in_hand else [norm * v for v in place]
            self._motions[k] = turn, norm, [s - norm * w for s, w in zip(shift, self._hand, strict=True)]
        return self._motions[k]

    def row(self, side: str, k: int) -> Terms:
        """At most zero at every solution, times some number above zero. Raises Refused for one that is none."""
        if (side, k) not in self._known:
            raise Refused(f"there is no row {side} {k}")
        kind, sign, limit = side[:-1], 1 if side[-1] == "+" else -1, F(0)
        if kind in "uv":
            return {m: c for m, c in self._pixel(k, "uv".index(kind), sign).items() if c}
        if kind == "turn":
            part, k = divmod(k, EQUATIONS)
            first = self.first[part - 2] if part > 1 else (R_X, R_F)[part][0]
            found = turn_equation(range(first, first + 9), k)
        elif kind == "tie":
            found = self._tie(*divmod(k, 3))
        elif kind == "link":
            found, limit = self._link(*divmod(k, 12))
        else:
            found = self._pose(*divmod(k, 12), sign > 0)
        found = {m: sign * c for m, c in found.items() if c}
        if limit:
            found = {m: c << _FINE for m, c in found.items()}
            found[()] = found.get((), 0) - (limit * (1 << _FINE)).__ceil__()
        return found

    def _pixel(self, n: int, axis: int, sign: int) -> Terms:
        image, p = self.study.image[n], self._points[n]
        found: Terms = {}
        for a, factor in ((axis, sign * self._focal[axis]), (2, -sign * self._off[2 * n + axis] - self._width[n])):
            if self.stage == "frames":
                found |= {m: factor * c for m, c in self._seen(image, a, p).items()}
            else:
                start = self.first[image]
                found |= {(start + 3 * a + d,): factor * p[d] for d in AXES}
                found[(start + 9 + a,)] = factor << self._mm
        return found

    def _seen(self, image: int, a: int, p: Sequence[int]) -> Terms:
        """n x_a of a point of the board, in units of mm."""
        turn, norm, shift = self.motion(image)
        found: Terms = {(E_[a],): norm << self._mm}
        for b in AXES:
            x = R_X[3 * b + a]
            found[(x,)] = shift[b]
            for c in AXES:
                found[x, F_[c]] = turn[b][c] << self._mm
                found |= {(x, R_F[3 * c + d]): turn[b][c] * p[d] for d in AXES if p[d]}
        return found

    def _tie(self, which: int, a: int) -> Terms:
        one = 1 << self._mm
        if which:  # f - t_F - R_F c
            return {(F_[a],): one, (T_F[a],): -one} | {(R_F[3 * a + d],): -self._board[d] for d in AXES}
        found: Terms = {(R_X[3 * a + b], E_[b]): one for b in AXES}  # R_X e + t_X - w
        return found | {(T_X[a],): one, (): -self._hand[a]}

    def _pose(self, image: int, j: int, upper: bool) -> Terms:
        """n times an entry of the board's pose in an image, less an end of what its own certificate proves."""
        turn, norm, _ = self.motion(image)
        above, below = self.sets[image][upper][j].as_integer_ratio()
        if j < 9:
            a, d = divmod(j, 3)
            found: Terms = {(R_X[3 * b + a], R_F[3 * c + d]): turn[b][c] for b in AXES for c in AXES}
        else:
            found = self._seen(image, j - 9, (0, 0, 0))
            above <<= self._mm
        return {m: below * c for m, c in found.items()} | {(): -norm * above}

    def _link(self, image: int, j: int) -> tuple[Terms, F]:
        """One of the 12 equations R_X (A, t) + t_X = T F for the reading T of a pose, and what it may be off.

        R(1, s) = I + [w]x + V with w = 2 s / (1 + s's), so |w_j| is at most the half-width, and each |V_ij| at most
        half of their squares' sum. With the camera in the hand the equation is turned back by R(1, s)'.
        """
        in_hand, (turn, norm, _), start = self.study.in_hand, self.motion(image), self.first[image]
        one = [[norm * (a == b) for b in AXES] for a in AXES]
        left, right = (transposed(turn), one) if in_hand else (one, turn)
        a, place = (j - 9, self._places[image]) if j >= 9 else (j // 3, (0, 0, 0))
        unit = self._mm if j >= 9 else 0

        def position(row: int) -> Terms:
            """n (P + d)"""
            return {(): -norm * place[row]} | ({(start + 15 + row,): -norm << unit} if self.wide else {})

        def target(row: int) -> Terms:
            """Of n times F's column, or of n (f - P - d) or n R f: what a reading turns."""
            if j < 9:
                return {(R_F[3 * c + j % 3],): right[row][c] for c in AXES}
            found: Terms = {(F_[c],): right[row][c] << unit for c in AXES}
            return found | position(row) if in_hand else found

        found = {m: -c for m, c in target(a).items()}
        if j >= 9:
            found |= {} if in_hand else position(a)
            found |= {(T_X[c],): left[a][c] << unit for c in AXES}
        for c, d in product(AXES, AXES):
            entry = start + 3 * d + j % 3 if j < 9 else start + 9 + d
            found[R_X[3 * c + d], entry] = left[a][c] << unit
        if not self.wide:
            return found, F(0)
        b, c = (a + 1) % 3, (a + 2) % 3  # ([w]x z)_a = w_b z_c - w_c z_b
        for w, row, way in ((b, c, 1), (c, b, -1)):
            for m, value in target(row).items():
                key = tuple(sorted((*m, start + 12 + w)))
                found[key] = found.get(key, 0) + (way if in_hand else -way) * value
        return found, self._beyond(image, [target(row) for row in AXES])

    def _beyond(self, image: int, targets: Iterable[Terms]) -> F:
        """v times the largest sum of the sizes of three polynomials on the box of the frames."""
        widths, start, frames = self.study.widths[image], self.first[image], self._frames
        ends: dict[tuple[int, ...], tuple[F, F]] = {(): (F(1), F(1))}
        ends |= {(i,): end for i, end in enumerate(zip(frames.lo, frames.hi, strict=True))}
        ends |= {(start + 15 + a,): (-widths[a], widths[a]) for a in AXES}
        total = F(0)
        for terms in targets:
            sums = zip(*(sorted((c * ends[m][0], c * ends[m][1])) for m, c in terms.items()), strict=True)
            total += max(abs(sum(side)) for side in sums)
        return sum((w * w for w in widths[3:]), F(0)) / 2 * total

    def problem(self, spend: Spend) -> Problem:
        """For the kernel: its rows are polynomials in x."""
        return Problem.of_rows(self.unknowns, self.count, SIDES, lambda side, k: polynomial(self.row(side, k), spend))

    @property
    def root(self) -> Box:
        """Where a stage begins: the frames' box, or all poses of an image that frames in it allow."""
        study, frames = self.study, self._frames
        lo, hi = ([], []) if self.stage == "image" else (list(frames.lo), list(frames.hi))
        for k in self.first:
            if k in self.sets:
                lo += self.sets[k][0]
                hi += self.sets[k][1]
            else:
                far = sum((max(-frames.lo[i], frames.hi[i]) for i in (*T_X, *F_)), F(0))
                far = F((far + sum(map(abs, study.poses[k][0])) + sum(study.widths[k][:3])).__ceil__())
                hi += [F(1)] * 9 + [far] * 3
                lo += [-v for v in hi[-12:]]
            if self.wide and self.stage == "links":
                hi += [*study.widths[k][3:], *study.widths[k][:3]]
                lo += [-v for v in hi[-6:]]
        return Box(tuple(lo), tuple(hi))


def polynomial(terms: Terms, spend: Spend) -> Polynomial:
    """With a largest coefficient of about one: a row may be divided by what is above zero."""
    spend(500 + 20 * len(terms))
    bits = max((c.bit_length() for c in terms.values()), default=0)
    return Polynomial({sum(map(unknown, m)): c for m, c in terms.items()}, -bits, spend)


# the box that was asked for -----------------------------------------------------------------------------------------

_PI_ABOVE = F(314159265358979323847, 10**20)
_OUTWARD = 40  # bits behind the point


def asked_box(center: Vector, reach: F, angle: F | None, hand: Vector, board: Vector) -> Box:
    """Of frames whose positions are within `reach` (mm) of a center's, and rotations within `angle` (degrees).

    `center` (14): position and quaternion of X, then of F. Entries of rotations that differ by an angle differ by at
    most 2 sin(angle / 2).
    """
    span, way = number(2 if angle is None else 2 * _sine_above(angle * _PI_ABOVE / 360)), number(reach)
    ends: list[Bounds] = []
    for k in (0, 7):
        turn = enclosed_rotation(numbers(center[k + 3 : k + 7]))
        ends += [value.around(span).within(-1, 1) for row in turn for value in row]
        ends += [value.around(way) for value in numbers(center[k : k + 3])]
    x, t_x, f, t_f = ends[:9], ends[9:12], ends[12:21], ends[21:]
    ends += applied(transposed(matrix(x)), minus(numbers(hand), t_x))  # e = R_X' (w - t_X)
    ends += plus(t_f, applied(matrix(f), numbers(board)))  # f = t_F + R_F c
    return box_of(ends, _OUTWARD)


def holds(placed: Vector, center: Vector, reach: F, angle: F | None) -> bool:
    """Whether frames (14 numbers) are in the box about others."""
    box = asked_box(center, reach, angle, (F(0),) * 3, (F(0),) * 3)
    at: list[F] = []
    for k in (0, 7):
        rows, norm = rotation(placed[k + 3 : k + 7])
        at += [*(F(v, norm) for row in rows for v in row), *placed[k : k + 3]]
    return all(lo <= v <= hi for lo, v, hi in zip(box.lo, at, box.hi, strict=False))


def _sine_above(angle: F) -> F:
    """An upper bound of the sine of an angle from 0: its series, which alternates, to x^17 / 17!."""
    term = total = angle
    for k in range(1, 9):
        term *= -angle * angle / (2 * k * (2 * k + 1))
        total += term
    return min(total, F(1))
