"""Hand-eye studies: the rows of frames, of single images, and of what links them, derived from the study's numbers.

    x = R_X' (H (R_F p + f) + h - w) + e        a point of the board before the camera, for a pose (H, h)
    t_X = w - R_X e,   t_F = f - R_F c          p: from the board's centre c; e, f: where w and c are

X is the camera in the hand (or base), F the board in the base (or hand), H the motion between them. A pixel u seen to
within eps gives, times the depth, `+-(f (x_a) - (u_a - c_a) x_3) - (eps + half-width) x_3 <= 0`. Every row is exact: it
is multiplied by the square of its pose's quaternion, whose rotation is a rational matrix only divided by that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from itertools import product
from typing import Any

from .polynomial import Polynomial, Spend, dyadics, rotation_rows, unknown
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
Interval = tuple[F, F]


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

    def motion(self, k: int) -> tuple[list[list[int]], int]:
        """H of an image times the square of its quaternion, and that square: whole numbers."""
        rows, norm = rotation(self.poses[k][1])
        return ([list(row) for row in zip(*rows, strict=True)] if self.in_hand else rows), norm


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
    the poses of images that are known."""

    def __init__(
        self, study: Study, stage: str, images: Sequence[int], eps: F, hand: Vector, board: Vector,
        sets: Mapping[int, tuple[Vector, Vector]], frames: Box | None,
    ) -> None:  # fmt: skip
        if stage == "frames" and study.uncertain:
            raise Refused("the pixels of all images are tied by exact poses only")
        self.study, self.stage, self.images, self.sets = study, stage, tuple(images), sets
        mm = [*hand, *board, *(v for p, _ in study.poses for v in p), *(v for p in study.points for v in p)]
        numbers = dyadics(mm)
        self._mm = numbers.power
        values = iter(zip(*[iter(numbers.values)] * 3, strict=True))
        self._hand, self._board = next(values), next(values)
        self._places = [next(values) for _ in study.poses]
        self._points = [tuple(v - c for v, c in zip(next(values), self._board, strict=True)) for _ in study.points]
        each = [eps + width for width in study.half_width]
        off = [ray[a] - study.center[a] for ray in study.rays for a in (0, 1)]
        numbers = dyadics([*study.focal, *each, *off])
        self._px, self._focal = numbers.power, numbers.values[:2]
        count = len(each)
        self._width, self._off = numbers.values[2 : 2 + count], numbers.values[2 + count :]
        self._motions: dict[int, tuple[list[list[int]], int, list[int]]] = {}
        self._frames = frames
        self.wide = bool(study.uncertain)
        own = 18 if self.wide else 12
        first = 0 if stage == "image" else SIZE
        self.first = {} if stage == "frames" else {k: first + own * n for n, k in enumerate(self.images)}
        self.size = first + (0 if stage == "frames" else (12 if stage == "image" else own) * len(self.images))

    @cached_property
    def unknowns(self) -> tuple[str, ...]:
        names = [*(f"R{a}{b}" for a in "123" for b in "123"), "tx", "ty", "tz", "wx", "wy", "wz", "dx", "dy", "dz"]
        if self.stage == "image":
            return tuple(names[:12])
        return (*FRAMES, *(f"{k}.{name}" for k in self.first for name in names[: 18 if self.wide else 12]))

    def motion(self, k: int) -> tuple[list[list[int]], int, list[int]]:
        """H and n = |q|^2 of an image, and n (h - w)."""
        if k not in self._motions:
            turn, norm = self.study.motion(k)
            place = self._places[k]
            shift = [-dot(row, place) for row in turn] if self.study.in_hand else [norm * v for v in place]
            self._motions[k] = turn, norm, [s - norm * w for s, w in zip(shift, self._hand, strict=True)]
        return self._motions[k]

    def tags(self) -> Iterator[tuple[str, int]]:
        """All rows, by side and number."""
        chosen = set(self.images)
        for n, image in enumerate(self.study.image):
            if image in chosen:
                yield from ((side, n) for side in SIDES[:4])
        parts = [2 + k for k in self.images] if self.stage != "frames" else []
        for part in parts if self.stage == "image" else [0, 1, *parts]:
            yield from product(SIDES[4:6], range(EQUATIONS * part, EQUATIONS * (part + 1)))
        if self.stage == "image":
            return
        yield from product(SIDES[6:8], range(6))
        if self.stage == "links":
            yield from product(SIDES[8:10], (12 * k + j for k in self.images for j in range(12)))
        else:
            yield from product(SIDES[10:], (12 * k + j for k in self.sets for j in range(12)))

    @property
    def count(self) -> int:
        """Numbers of rows are below this."""
        return max(len(self.study.image), (EQUATIONS + 12) * (2 + len(self.study.images)))

    def row(self, side: str, k: int) -> Terms:
        """At most zero at every solution, times some number above zero. Raises Refused for one that is none."""
        kind, sign = side[:-1], 1 if side[-1] == "+" else -1
        limit: F | int = 0
        if kind in "uv":
            if k >= len(self.study.image) or self.study.image[k] not in self.images:
                raise Refused(f"there is no row {side} {k}")
            found = self._pixel(k, "uv".index(kind), sign)
            return {m: c for m, c in found.items() if c}
        if kind == "turn":
            found = turn_equation(self._part(k // EQUATIONS), k % EQUATIONS)
        elif kind == "tie" and k < 6 and self.stage != "image":
            found = self._tie(*divmod(k, 3))
        elif kind == "link" and self.stage == "links" and k // 12 in self.images:
            found, limit = self._link(*divmod(k, 12))
        elif kind == "pose" and self.stage == "frames" and k // 12 in self.sets:
            return self._pose(*divmod(k, 12), sign)
        else:
            raise Refused(f"there is no row {side} {k}")
        found = {m: sign * c for m, c in found.items() if c}
        if limit:
            found = {m: c << _FINE for m, c in found.items()}
            found[()] = found.get((), 0) - (limit * (1 << _FINE)).__ceil__()
        return found

    def _part(self, part: int) -> range:
        if part < 2 and self.stage != "image":
            return (R_X, R_F)[part]
        if part - 2 in self.first:
            start = self.first[part - 2]
            return range(start, start + 9)
        raise Refused(f"there is no rotation {part}")

    def _pixel(self, n: int, axis: int, sign: int) -> Terms:
        image, p = self.study.image[n], self._points[n]
        factors = {axis: sign * self._focal[axis], 2: -sign * self._off[2 * n + axis] - self._width[n]}
        found: Terms = {}
        if self.stage != "frames":
            start = self.first[image]
            for a, factor in factors.items():
                found |= {(start + 3 * a + d,): factor * p[d] for d in AXES}
                found[(start + 9 + a,)] = factor << self._mm
            return found
        for a, factor in factors.items():
            found |= {m: factor * c for m, c in self._seen(image, a, p).items()}
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

    def _pose(self, image: int, j: int, sign: int) -> Terms:
        """n times an entry of the board's pose in an image, within what its own certificate proves."""
        turn, norm, _ = self.motion(image)
        value = self.sets[image][sign > 0][j]
        above, below = value.as_integer_ratio()
        if j < 9:
            a, d = divmod(j, 3)
            found: Terms = {(R_X[3 * b + a], R_F[3 * c + d]): turn[b][c] for b in AXES for c in AXES}
            unit = 0
        else:
            found, unit = self._seen(image, j - 9, (0, 0, 0)), self._mm
        found = {m: sign * below * c for m, c in found.items() if c}
        return found | {(): -sign * (norm * above << unit)}

    def _link(self, image: int, j: int) -> tuple[Terms, F | int]:
        """One of the 12 equations R_X (A, t) + t_X = T F for the reading T of a pose, and what it may be off.

        R(1, s) = I + [w]x + V with w = 2 s / (1 + s's), so |w_j| is at most the half-width, and each |V_ij| at most
        half of their squares' sum. With the camera in the hand the equation is turned back by R(1, s)'.
        """
        study, (turn, norm, _), start = self.study, self.motion(image), self.first[image]
        base = [list(row) for row in zip(*turn, strict=True)] if study.in_hand else turn  # n R(q)
        one = [[norm * (a == b) for b in AXES] for a in AXES]
        left, right = (base, one) if study.in_hand else (one, base)
        a, place = (j - 9, self._places[image]) if j >= 9 else (j // 3, (0, 0, 0))
        unit = self._mm if j >= 9 else 0
        sign = -1 if study.in_hand else 1

        def target(row: int) -> Terms:
            """Of n times F's column, or of n (f - P - d) or n R f: what a reading turns."""
            if j < 9:
                return {(R_F[3 * c + j % 3],): right[row][c] for c in AXES}
            found: Terms = {(F_[c],): right[row][c] << unit for c in AXES}
            if study.in_hand:
                found |= {(): -norm * place[row]} | ({(start + 15 + row,): -norm << unit} if self.wide else {})
            return found

        found = {m: -c for m, c in target(a).items()}
        if not study.in_hand and j >= 9:
            found[()] = -norm * place[a]
            if self.wide:
                found[(start + 15 + a,)] = -norm << unit
        for c, d in product(AXES, AXES):
            entry = start + 3 * d + j % 3 if j < 9 else start + 9 + d
            found[R_X[3 * c + d], entry] = left[a][c] << unit
        if j >= 9:
            found |= {(T_X[c],): left[a][c] << unit for c in AXES}
        if not self.wide:
            return found, 0
        b, c = (a + 1) % 3, (a + 2) % 3  # ([w]x z)_a = w_b z_c - w_c z_b
        for w, row, way in ((b, c, sign), (c, b, -sign)):
            for m, value in target(row).items():
                key = tuple(sorted((*m, start + 12 + w)))
                found[key] = found.get(key, 0) - way * value
        return found, self._beyond(image, [target(row) for row in AXES])

    def _beyond(self, image: int, targets: Iterable[Terms]) -> F:
        """v times the largest sum of the sizes of three polynomials on the box of the frames."""
        assert self._frames is not None
        widths = self.study.widths[image]
        v = sum((w * w for w in widths[3:]), F(0)) / 2
        start = self.first[image]
        size: dict[tuple[int, ...], Interval] = {(): (F(1), F(1))}
        size |= {(start + 15 + a,): (-widths[a], widths[a]) for a in AXES}
        total = F(0)
        for terms in targets:
            low = high = F(0)
            for m, c in terms.items():
                if m in size:
                    lo, hi = size[m]
                else:
                    lo, hi = self._frames.lo[m[0]], self._frames.hi[m[0]]
                low, high = low + min(c * lo, c * hi), high + max(c * lo, c * hi)
            total += max(-low, high)
        return v * total

    def problem(self, spend: Spend) -> Problem:
        """For the kernel: its rows are polynomials in x."""
        return Problem.of_rows(self.unknowns, self.count, SIDES, lambda side, k: polynomial(self.row(side, k), spend))

    def root(self, frames: Box | None) -> Box:
        """Where a stage begins: the frames' box, or all poses of an image that frames in it allow."""
        study, lo, hi = self.study, list[F](), list[F]()
        if self.stage != "image":
            assert frames is not None
            lo, hi = list(frames.lo[:SIZE]), list(frames.hi[:SIZE])
        for k in self.first:
            if k in self.sets:
                lo += self.sets[k][0]
                hi += self.sets[k][1]
            else:
                assert frames is not None
                far = sum((max(-frames.lo[i], frames.hi[i]) for i in (*T_X, *F_)), F(0))
                far = F((far + sum(map(abs, study.poses[k][0])) + sum(study.widths[k][:3])).__ceil__())
                hi += [F(1)] * 9 + [far] * 3
                lo += [-v for v in hi[-12:]]
            if self.wide and self.stage == "links":
                widths = [*study.widths[k][3:], *study.widths[k][:3]]
                lo += [-v for v in widths]
                hi += widths
        return Box(tuple(lo), tuple(hi))


def polynomial(terms: Terms, spend: Spend) -> Polynomial:
    """With a largest coefficient of about one: a row may be divided by what is above zero."""
    spend(500 + 20 * len(terms))
    bits = max((c.bit_length() for c in terms.values()), default=0)
    return Polynomial({sum(map(unknown, m)): c for m, c in terms.items()}, -bits, spend)


def dot(row: Iterable[Any], vector: Iterable[Any]) -> Any:
    return sum(a * b for a, b in zip(row, vector, strict=True))


# the box that was asked for -----------------------------------------------------------------------------------------

_PI_ABOVE = F(314159265358979323847, 10**20)
_OUTWARD = 1 << 40


def asked_box(center: Vector, reach: F, angle: F | None, hand: Vector, board: Vector) -> Box:
    """Of frames whose positions are within `reach` (mm) of a center's, and rotations within `angle` (degrees).

    `center` (14): position and quaternion of X, then of F. Entries of rotations that differ by an angle differ by at
    most 2 sin(angle / 2).
    """
    span = F(2) if angle is None else 2 * _sine_above(angle * _PI_ABOVE / 360)
    ends: list[Interval] = []
    for k in (0, 7):
        rows, norm = rotation(center[k + 3 : k + 7])
        for value in (F(v, norm) for row in rows for v in row):
            ends.append((max(value - span, F(-1)), min(value + span, F(1))))
        ends += [(v - reach, v + reach) for v in center[k : k + 3]]
    for a in AXES:  # e = R_X' (w - t_X)
        away = [(hand[b] - ends[T_X[b]][1], hand[b] - ends[T_X[b]][0]) for b in AXES]
        ends.append(_sum(_times(ends[R_X[3 * b + a]], away[b]) for b in AXES))
    for a in AXES:  # f = t_F + R_F c
        ends.append(_sum([ends[T_F[a]], *(_times(ends[R_F[3 * a + d]], (board[d],) * 2) for d in AXES)]))
    lo = tuple(F((low * _OUTWARD).__floor__(), _OUTWARD) for low, _ in ends)
    return Box(lo, tuple(F((high * _OUTWARD).__ceil__(), _OUTWARD) for _, high in ends))


def holds(placed: Vector, center: Vector, reach: F, angle: F | None) -> bool:
    """Whether frames (14 numbers) are in the box about others."""
    origin = (F(0),) * 3
    box = asked_box(center, reach, angle, origin, origin)
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


def _times(one: Interval, other: Interval) -> Interval:
    corners = [p * q for p in one for q in other]
    return min(corners), max(corners)


def _sum(ends: Iterable[Interval]) -> Interval:
    low, high = zip(*ends, strict=True)
    return sum(low, F(0)), sum(high, F(0))
