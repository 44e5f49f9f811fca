"""Hand-eye studies: the rows of frames, of single images, and of what links them, derived from the study's numbers.

    x = R_X' (H (R_F p + f) + h - w) + e        a point of the board before the camera, for a pose (H, h)
    t_X = w - R_X e,   t_F = f - R_F c          p: from the board's centre c; e, f: where w and c are

X is the camera in the hand (or base), F the board in the base (or hand), H the motion between them. A pixel u seen to
within eps gives, times the depth, `+-(f (x_a) - (u_a - c_a) x_3) - (eps + half-width) x_3 <= 0`. Every row is exact: it
is multiplied by the square of its pose's quaternion, whose rotation is a rational matrix only divided by that.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property, lru_cache
from itertools import product as pairs
from typing import Any

from .bounds import Bounds, between, box_of, matrix, number, numbers
from .bounds import rotation as enclosed_rotation
from .polynomial import Form, applied, cross, dyadics, forms, inner, minus, plus, product, rotation_rows, transposed
from .readers import Names, Places, Refused
from .rule import Box, ModelRows

AXES = range(3)
R_X, T_X, R_F, T_F, E_, F_ = range(9), range(9, 12), range(12, 21), range(21, 24), range(24, 27), range(27, 30)
GIVEN = {f"camera.{what}": i for what, i in zip(("x", "y", "z", "tilt"), (*T_X, R_X[-1]), strict=True)}
GIVEN |= {f"target.{what}": i for what, i in zip(("x", "y", "z", "tilt"), (*T_F, R_F[-1]), strict=True)}
SIZE = 30  # unknowns of frames; those of an image follow: its board's turn (9) and place (3), and 6 of its reading
EQUATIONS = 21  # of a rotation
SIDES = ("u+", "u-", "v+", "v-", "turn+", "turn-", "tie+", "tie-", "link+", "link-", "pose+", "pose-")
STAGES = ("image", "links", "frames")
_FINE = 64  # bits of what a link may be off
Matrix = Sequence[Sequence[Any]]
Vector = Sequence[F]
Known = Sequence[tuple[str, F, F]]  # what a user knows: a name of GIVEN, least and greatest value in its unit


@dataclass(frozen=True)
class Study:
    """Numbers of a study. A pose is a position and a quaternion, a point its image, undistorted pixel, place on the
    board and half-width; `widths`: of the readings of each pose."""

    in_hand: bool  # the camera is on the hand
    focal: Vector
    center: Vector
    images: Names
    poses: tuple[tuple[Vector, Vector], ...]
    widths: tuple[Vector, ...]
    image: Places
    names: Names
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


@lru_cache(maxsize=256)
def turn_equations(first: int) -> list[Form]:
    """21 polynomials that vanish at a rotation, whose entries begin there: R R' = I, R' R = I, R = cof R."""
    turn = matrix(forms(range(first, first + 9)))
    found = [inner(x[a], x[b]) - int(a == b) for x in (turn, transposed(turn)) for a in AXES for b in AXES if a <= b]
    return found + [v for a in AXES for v in minus(turn[a], cross(turn[a - 2], turn[a - 1]))]


def before_camera(
    x_turn: Matrix, e: Sequence[Any], f_turn: Matrix, f: Sequence[Any], turn: Matrix, shift: Sequence[Any]
) -> tuple[Matrix, Sequence[Any]]:
    """Turn and place of the board, R_X' (H (R_F p + f) + shift) + e."""
    back = transposed(x_turn)
    return product(back, product(turn, f_turn)), plus(applied(back, plus(applied(turn, f), shift)), e)


class Rows(ModelRows):
    """The rows of a stage for some images of a study, at a tolerance eps; `hand`: w, `board`: c, `sets`: boxes (12) of
    the poses of images that are known, `frames`: the box where it begins."""

    sides = SIDES

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
        self._x_turn, self._f_turn = matrix(forms(R_X)), matrix(forms(R_F))
        self._t_x, t_f, self._e, self._f = map(self._mms, (T_X, T_F, E_, F_))
        self._ties = [
            *minus(plus(applied(self._x_turn, self._e), self._t_x), self._hand),
            *minus(minus(self._f, t_f), applied(self._f_turn, self._board)),
        ]
        self._poses: dict[int, list[Form]] = {}
        self._links: dict[int, list[tuple[Form, F]]] = {}
        alone, own = stage == "image", [] if stage == "frames" else images
        first, each = 0 if alone else SIZE, 18 if self.wide and not alone else 12
        self.first = {k: first + each * n for n, k in enumerate(own)}
        self.size = first + each * len(own)
        self.count = max(len(study.image), (EQUATIONS + 12) * (2 + len(study.images)))  # numbers of rows are below
        seen, parts = frozenset(images), [*(() if alone else (0, 1)), *(2 + k for k in own)]
        tags = [(side, n) for n, image in enumerate(study.image) if image in seen for side in SIDES[:4]]
        tags += pairs(SIDES[4:6], (EQUATIONS * part + k for part in parts for k in range(EQUATIONS)))
        if not alone:
            tied = (SIDES[8:10], images) if stage == "links" else (SIDES[10:], sets)
            tags += pairs(SIDES[6:8], range(6))
            tags += pairs(tied[0], (12 * k + j for k in tied[1] for j in range(12)))
        self.tags = dict.fromkeys(tags)

    def form(self, side: str, k: int) -> Form:
        kind, sign, limit = side[:-1], 1 if side[-1] == "+" else -1, F(0)
        if kind in "uv":
            axis, pose, p = "uv".index(kind), self.pose(self.study.image[k]), self._points[k]
            x, z = (inner(pose[3 * a : 3 * a + 3], p) + pose[9 + a] for a in (axis, 2))
            pixel: Form = x * (sign * self._focal[axis]) - z * (sign * self._off[2 * k + axis] + self._width[k])
            return pixel
        if kind == "turn":
            part, k = divmod(k, EQUATIONS)
            found = turn_equations(self.first[part - 2] if part > 1 else (R_X, R_F)[part][0])[k]
        elif kind == "tie":
            found = self._ties[k]
        elif kind == "link":
            found, limit = self.links(k // 12)[k % 12]
        else:
            image, j = divmod(k, 12)
            above, below = self.sets[image][sign > 0][j].as_integer_ratio()
            scale = self.study.motion(image)[1] if self.stage == "frames" else 1  # of the pose, but for its units
            found = below * self.pose(image)[j] - (scale << (self._mm if j >= 9 else 0)) * above
        found = found * sign
        if limit:
            found = found * (1 << _FINE) - (limit * (1 << _FINE)).__ceil__()
        return found

    def pose(self, image: int) -> list[Form]:
        """The board's turn (9) and place (3) before the camera: unknowns, or by the frames and times n; in units."""
        if image not in self._poses:
            if self.stage == "frames":
                (turn, n), place = self.study.motion(image), self._places[image]
                shift = [-v for v in applied(turn, place)] if self.study.in_hand else [n * v for v in place]
                shift, e = minus(shift, [n * v for v in self._hand]), [n * v for v in self._e]
                rows, at = before_camera(self._x_turn, e, self._f_turn, self._f, turn, shift)
                self._poses[image] = [*(v for row in rows for v in row), *at]
            else:
                first = self.first[image]
                self._poses[image] = [*forms(range(first, first + 9)), *self._mms(range(first + 9, first + 12))]
        return self._poses[image]

    def _mms(self, unknowns: Iterable[int]) -> list[Form]:
        """In units of 2^-mm."""
        return [v * (1 << self._mm) for v in forms(unknowns)]

    def links(self, image: int) -> list[tuple[Form, F]]:
        """The 12 equations R_X (A, t) + t_X = T F for the reading T of a pose, and what they may be off.

        R(1, s) = I + [w]x + V with w = 2 s / (1 + s's), so |w_j| is at most the half-width, and each |V_ij| at most
        half of their squares' sum. With the camera in the hand the equation is turned back by R(1, s)'.
        """
        if image in self._links:
            return self._links[image]
        in_hand, (turn, n), first = self.study.in_hand, self.study.motion(image), self.first[image]
        one = [[n * (a == b) for b in AXES] for a in AXES]
        left, right = (transposed(turn), one) if in_hand else (one, turn)
        off = self._mms(range(first + 15, first + 18)) if self.wide else [Form({})] * 3
        position = [n * (d + p) for d, p in zip(off, self._places[image], strict=True)]  # n (P + d)
        columns: list[list[tuple[Form, F]]] = []
        for column, target in (
            *zip(transposed(matrix(self.pose(image)[:9])), transposed(self._f_turn), strict=True),
            (self.pose(image)[9:], self._f),
        ):
            target, reached = applied(right, target), applied(self._x_turn, column)
            if len(columns) == 3:
                reached = plus(reached, self._t_x)
                target = minus(target, position) if in_hand else target
            row, limit = minus(applied(left, reached), target), F(0)
            if len(columns) == 3 and not in_hand:
                row = minus(row, position)
            if self.wide:
                row = (plus if in_hand else minus)(row, cross(forms(range(first + 12, first + 15)), target))
                limit = self._beyond(image, target)
            columns.append([(v, limit) for v in row])
        self._links[image] = [columns[b][a] for a in AXES for b in AXES] + columns[3]
        return self._links[image]

    def _beyond(self, image: int, targets: Iterable[Form]) -> F:
        """v times the largest sum of the sizes of three polynomials on the box of the frames."""
        widths, start, frames = self.study.widths[image], self.first[image], self._frames
        ends: dict[tuple[int, ...], tuple[F, F]] = {(): (F(1), F(1))}
        ends |= {(i,): end for i, end in enumerate(zip(frames.lo, frames.hi, strict=True))}
        ends |= {(start + 15 + a,): (-widths[a], widths[a]) for a in AXES}
        total = F(0)
        for form in targets:
            sums = zip(*(sorted((c * ends[m][0], c * ends[m][1])) for m, c in form.terms.items()), strict=True)
            total += max(abs(sum(side)) for side in sums)
        return sum((w * w for w in widths[3:]), F(0)) / 2 * total

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


# the box that was asked for -----------------------------------------------------------------------------------------

_PI_ABOVE = F(314159265358979323847, 10**20)
_OUTWARD = 40  # bits behind the point


def asked_box(center: Vector, reach: F, angle: F | None, known: Known, hand: Vector, board: Vector) -> Box:
    """Of frames whose positions are within `reach` (mm) of a center's, or where they are known, and rotations within
    `angle` (degrees), whose z axes are tilted as is known.

    `center` (14): position and quaternion of X, then of F. Entries of rotations that differ by an angle differ by at
    most 2 sin(angle / 2). A tilt t, from 0 to 180 degrees, has the last entry cos t = 1 - 2 sin(t / 2)^2 = 2 sin(90 -
    t / 2)^2 - 1.
    """
    span, way = number(2 if angle is None else 2 * _half_sine_above(angle)), number(reach)
    ends: list[Bounds] = []
    for k in (0, 7):
        turn = enclosed_rotation(numbers(center[k + 3 : k + 7]))
        ends += [value.around(span).within(-1, 1) for row in turn for value in row]
        ends += [value.around(way) for value in numbers(center[k : k + 3])]
    for name, low, high in known:
        if low > high or [one for one, *_ in known].count(name) > 1:
            raise Refused(f"{name} is given twice, or its least value is above its greatest")
        if unit(name) == "degrees":
            if low < 0 or high > 180:
                raise Refused(f"{name} is not from 0 to 180 degrees")
            low, high = 1 - 2 * _half_sine_above(high) ** 2, 2 * _half_sine_above(180 - low) ** 2 - 1
        ends[GIVEN[name]] = between(low, high)
    x, t_x, f, t_f = ends[:9], ends[9:12], ends[12:21], ends[21:]
    ends += applied(transposed(matrix(x)), minus(numbers(hand), t_x))  # e = R_X' (w - t_X)
    ends += plus(t_f, applied(matrix(f), numbers(board)))  # f = t_F + R_F c
    return box_of(ends, _OUTWARD)


def holds(placed: Vector, center: Vector, reach: F, angle: F | None, known: Known = ()) -> bool:
    """Whether frames (14 numbers) are in the box about others."""
    box = asked_box(center, reach, angle, known, (F(0),) * 3, (F(0),) * 3)
    at: list[F] = []
    for k in (0, 7):
        rows, norm = rotation(placed[k + 3 : k + 7])
        at += [*(F(v, norm) for row in rows for v in row), *placed[k : k + 3]]
    return all(lo <= v <= hi for lo, v, hi in zip(box.lo, at, box.hi, strict=False))


def unit(name: str) -> str:
    """Of what a user knows."""
    return "degrees" if name.endswith("tilt") else "mm"


def _half_sine_above(degrees: F) -> F:
    """An upper bound of the sine of half an angle up to 180 degrees: its series, which alternates, to x^17 / 17!."""
    term = total = angle = degrees * _PI_ABOVE / 360
    for k in range(1, 9):
        term *= -angle * angle / (2 * k * (2 * k + 1))
        total += term
    return min(total, F(1))
