"""The camera of a pose set: a pixel to the first order in direction and camera, and how far the centre of a dot's image
is from the image of its centre.

docs/certificate-format.md, "Pose sets", has the formulas and why they hold.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from itertools import pairwise
from math import isqrt

from .readers import Refused

# intervals whose ends are whole multiples of 2^-160, rounded outward -------------------------------------------------

_BITS = 160
_ONE = 1 << _BITS


class Bounds:
    """All numbers from lo to hi, both times 2^-160."""

    __slots__ = ("hi", "lo")

    def __init__(self, lo: int, hi: int) -> None:
        if lo > hi:
            raise Refused("an interval is empty that holds every solution", "proof")
        self.lo, self.hi = lo, hi

    def __add__(self, other: Bounds) -> Bounds:
        return Bounds(self.lo + other.lo, self.hi + other.hi)

    def __sub__(self, other: Bounds) -> Bounds:
        return Bounds(self.lo - other.hi, self.hi - other.lo)

    def __neg__(self) -> Bounds:
        return Bounds(-self.hi, -self.lo)

    def __mul__(self, other: Bounds) -> Bounds:
        if other.lo == other.hi:
            a, b = self.lo * other.lo, self.hi * other.lo
            return Bounds(min(a, b) >> _BITS, -(-max(a, b) >> _BITS))
        if self.lo >= 0 and other.lo >= 0:
            return Bounds(self.lo * other.lo >> _BITS, -(-self.hi * other.hi >> _BITS))
        a, b, c, d = self.lo * other.lo, self.lo * other.hi, self.hi * other.lo, self.hi * other.hi
        return Bounds(min(a, b, c, d) >> _BITS, -(-max(a, b, c, d) >> _BITS))

    def __truediv__(self, other: Bounds) -> Bounds:
        if other.lo <= 0 <= other.hi:
            raise Refused("a divisor may be zero", "proof")
        ends = [(n << _BITS, d) for n in (self.lo, self.hi) for d in (other.lo, other.hi)]
        return Bounds(min(n // d for n, d in ends), max(-(-n // d) for n, d in ends))

    def times(self, whole: int) -> Bounds:
        a, b = self.lo * whole, self.hi * whole
        return Bounds(min(a, b), max(a, b))

    @property
    def square(self) -> Bounds:
        least = 0 if self.lo <= 0 <= self.hi else min(abs(self.lo), abs(self.hi))
        most = max(abs(self.lo), abs(self.hi))
        return Bounds(least * least >> _BITS, -(-most * most >> _BITS))

    @property
    def root(self) -> Bounds:
        """Of what is not negative."""
        return Bounds(isqrt(max(self.lo, 0) << _BITS), isqrt(max(self.hi, 0) << _BITS) + 1)

    @property
    def size(self) -> Bounds:
        """The largest absolute value."""
        most = max(abs(self.lo), abs(self.hi))
        return Bounds(most, most)

    @property
    def middle(self) -> Bounds:
        half = self.lo + self.hi >> 1
        return Bounds(half, half)

    @property
    def radius(self) -> Bounds:
        """The distance from `middle` to the farther end."""
        half = self.hi - (self.lo + self.hi >> 1)
        return Bounds(half, half)

    @property
    def least(self) -> Bounds:
        return Bounds(self.lo, self.lo)

    @property
    def most(self) -> Bounds:
        return Bounds(self.hi, self.hi)

    def within(self, lo: int, hi: int) -> Bounds:
        """What of it lies between two whole numbers."""
        return Bounds(max(self.lo, lo << _BITS), min(self.hi, hi << _BITS))

    def around(self, radius: Bounds) -> Bounds:
        """All numbers at most so far from it."""
        return Bounds(self.lo - radius.hi, self.hi + radius.hi)


def number(value: F | int) -> Bounds:
    return between(F(value), F(value))


def between(lo: F, hi: F) -> Bounds:
    return Bounds((lo.numerator << _BITS) // lo.denominator, -((-hi.numerator << _BITS) // hi.denominator))


ZERO, ONE, TWO = Bounds(0, 0), Bounds(_ONE, _ONE), Bounds(2 * _ONE, 2 * _ONE)
UNIT = Bounds(-_ONE, _ONE)


def total(parts: Iterable[Bounds]) -> Bounds:
    lo = hi = 0
    for part in parts:
        lo, hi = lo + part.lo, hi + part.hi
    return Bounds(lo, hi)


def inner(x: Sequence[Bounds], y: Sequence[Bounds]) -> Bounds:
    return total(a * b for a, b in zip(x, y, strict=True))


Vector = Sequence[Bounds]
Matrix = Sequence[Vector]


def applied(matrix: Matrix, x: Vector) -> list[Bounds]:
    return [inner(row, x) for row in matrix]


def product(left: Matrix, right: Matrix) -> list[list[Bounds]]:
    columns = transposed(right)
    return [[inner(row, column) for column in columns] for row in left]


def transposed(matrix: Matrix) -> list[list[Bounds]]:
    return [list(column) for column in zip(*matrix, strict=True)]


def plus(x: Vector, y: Vector) -> list[Bounds]:
    return [a + b for a, b in zip(x, y, strict=True)]


def minus(x: Vector, y: Vector) -> list[Bounds]:
    return [a - b for a, b in zip(x, y, strict=True)]


def rotation(q: Vector) -> list[list[Bounds]]:
    """The rotation of a quaternion, scalar first, divided by its square."""
    w, x, y, z = q
    ww, xx, yy, zz = w.square, x.square, y.square, z.square
    rows = [
        [ww + xx - yy - zz, TWO * (x * y - w * z), TWO * (x * z + w * y)],
        [TWO * (x * y + w * z), ww - xx + yy - zz, TWO * (y * z - w * x)],
        [TWO * (x * z - w * y), TWO * (y * z + w * x), ww - xx - yy + zz],
    ]
    return [[(entry / (ww + xx + yy + zz)).within(-1, 1) for entry in row] for row in rows]


def half_turn(matrix: Matrix) -> list[Bounds]:
    """s with the rotation R(1, s) in the matrix. Refuses what may be a half-turn."""
    divisor = ONE + matrix[0][0] + matrix[1][1] + matrix[2][2]
    if divisor.lo <= 0:
        raise Refused("the rotation about the centre may be a half-turn", "proof")
    off = (matrix[2][1] - matrix[1][2], matrix[0][2] - matrix[2][0], matrix[1][0] - matrix[0][1])
    return [entry / divisor for entry in off]


CELLS, NEAREST = 24, 40
_NEWTON = 12
_PAIRS = ((0, 0), (0, 1), (1, 1))
_HALF, _QUARTER = between(F(1, 2), F(1, 2)), between(F(1, 4), F(1, 4))
Forms = list[tuple[Bounds, Vector]]  # of quantities that are linear in k1, k2, p1, p2, k3: constants and coefficients


def values(x: Vector) -> Forms:
    """d (2) at directions x."""
    u, v = x
    uu, vv, uv = u.square, v.square, u * v
    s = uu + vv
    s2, mixed = s.square, TWO * uv
    s3 = s2 * s
    return [
        (u, [u * s, u * s2, mixed, s + TWO * uu, u * s3]),
        (v, [v * s, v * s2, s + TWO * vv, mixed, v * s3]),
    ]


def slopes(x: Vector) -> Forms:
    """Derivatives of d: of the first component by x, by y (as of the second by x), of the second by y."""
    u, v = x
    uu, vv, uv = u.square, v.square, u * v
    s = uu + vv
    s2 = s.square
    s3, four, six = s2 * s, s.times(4), s2.times(6)
    return [
        (ONE, [s + TWO * uu, s2 + four * uu, v.times(2), u.times(6), s3 + six * uu]),
        (ZERO, [uv.times(2), four * uv, u.times(2), v.times(2), six * uv]),
        (ONE, [s + TWO * vv, s2 + four * vv, v.times(6), u.times(2), s3 + six * vv]),
    ]


def curves(x: Vector) -> Forms:
    """Second derivatives of d: xxx, xxy, xyy, yyy."""
    u, v = x
    uu, vv = u.square, v.square
    s = uu + vv
    s2 = s.square
    two, six = number(2), number(6)

    def straight(w: Bounds, ww: Bounds, p: tuple[Bounds, Bounds]) -> Vector:
        return [w.times(6), s.times(12) * w + ww.times(8) * w, *p, s2.times(18) * w + s.times(24) * ww * w]

    def across(w: Bounds, other: Bounds, p: tuple[Bounds, Bounds]) -> Vector:
        return [w.times(2), s.times(4) * w + other.times(8) * w, *p, s2.times(6) * w + s.times(24) * other * w]

    forms = (
        straight(u, uu, (ZERO, six)),
        across(v, uu, (two, ZERO)),
        across(u, vv, (ZERO, two)),
        straight(v, vv, (six, ZERO)),
    )
    return [(ZERO, form) for form in forms]


@dataclass(frozen=True)
class Linear:
    """A pixel to the first order: F = value + slope (x - x0) + by . t + e with |e| <= rest, for directions x in the
    field and cameras t for which F is in the box of pixels."""

    ray: tuple[F, F]
    value: Vector
    slope: Sequence[Vector]
    by: Sequence[Vector]
    rest: Vector
    size: Bounds  # of |x - x0|, at most


class Cameras:
    """Those whose nine numbers are `center + spread t`, |t| <= 1 if `ball`, else |t_j| <= 1; field: r <= radius."""

    def __init__(self, center: Sequence[F], spread: Sequence[Sequence[F]], ball: bool, radius: F) -> None:
        self.center, self.spread = [number(v) for v in center], [[number(v) for v in row] for row in spread]
        self.ball, self.radius, self.size = ball, number(radius), len(spread[0])
        self.reach = [self.most(row) for row in self.spread]
        self.numbers = [c.around(r) for c, r in zip(self.center, self.reach, strict=True)]
        self._floats = [float(v) for v in center]
        if min(self.numbers[0].lo, self.numbers[1].lo, self.radius.lo) <= 0:
            raise Refused("a focal length or the field may be zero", "run", 0)

    def most(self, row: Vector) -> Bounds:
        """The largest value of row . t."""
        return total(c.square for c in row).root.most if self.ball else total(c.size for c in row)

    def _by_t(self, by: Vector) -> list[Bounds]:
        """What is linear in the lens's five numbers, by t."""
        return [inner(by, [row[j] for row in self.spread[4:]]) for j in range(self.size)]

    def at_center(self, forms: Forms) -> list[Bounds]:
        return [constant + inner(by, self.center[4:]) for constant, by in forms]

    def over(self, forms: Forms) -> list[Bounds]:
        """For all cameras."""
        at = self.at_center(forms)
        return [v.around(self.most(self._by_t(by))) for v, (_, by) in zip(at, forms, strict=True)] if self.size else at

    def least_slope(self, x: Vector) -> Bounds:
        """No eigenvalue of the lens's Jacobian on a box of directions is below the lower end (Gershgorin)."""
        along, mixed, down = self.over(slopes(x))
        a, b = along - mixed.size, down - mixed.size
        return Bounds(min(a.lo, b.lo), min(a.hi, b.hi))

    def cells(self) -> list[list[Bounds]]:
        """Squares that cover the field."""
        radius, out = self.radius, []
        cuts = [radius * (number(2 * k - CELLS) / number(CELLS)) for k in range(CELLS + 1)]
        sides = [Bounds(a.lo, b.hi) for a, b in pairwise(cuts)]
        for x in sides:
            out += [[x, y] for y in sides if (x.square + y.square).lo <= radius.square.hi]
        return out

    @cached_property
    def least(self) -> Bounds:
        """A number above zero that no slope in the field is below."""
        least = min(self.least_slope(x).lo for x in self.cells())
        if least <= 0:
            raise Refused("the lens may turn back within its field", "run", 0)
        return Bounds(least, least)

    def ray(self, pixels: Vector) -> tuple[F, F]:
        """A direction near the one that the centre of the cameras shows in the middle of a box of pixels."""
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = self._floats
        a, b = (F(p.middle.lo, 1 << 160) for p in pixels)
        du, dv = (float(a) - cx) / fx, (float(b) - cy) / fy
        u, v = du, dv
        for _ in range(_NEWTON):
            s = u * u + v * v
            g, g1 = 1.0 + s * (k1 + s * (k2 + s * k3)), k1 + s * (2.0 * k2 + s * 3.0 * k3)
            off = (
                u * g + 2.0 * p1 * u * v + p2 * (s + 2.0 * u * u) - du,
                v * g + 2.0 * p2 * u * v + p1 * (s + 2.0 * v * v) - dv,
            )
            along, mixed = g + 2.0 * g1 * u * u + 2.0 * p1 * v + 6.0 * p2 * u, 2.0 * (g1 * u * v + p1 * u + p2 * v)
            down = g + 2.0 * g1 * v * v + 6.0 * p1 * v + 2.0 * p2 * u
            det = along * down - mixed * mixed
            if not 1e-6 < abs(det) < 1e6:
                break
            u, v = u - (down * off[0] - mixed * off[1]) / det, v - (along * off[1] - mixed * off[0]) / det
        try:
            found = F(u), F(v)
        except (ValueError, OverflowError):
            found = F(0), F(0)
        if found[0] ** 2 + found[1] ** 2 > self.field**2:
            raise Refused("a box of pixels shows nothing of the camera's field", "run", 0)
        return found

    @cached_property
    def field(self) -> F:
        return F(self.radius.lo, 1 << 160)

    def linear(self, pixels: Vector) -> Linear:
        """About the middle of a box of pixels.

        With |F(x, t) - F(x0, t)| <= a there, |x - x0| <= a / (f m) = rho, m the lens's least slope in the field, and
        then that within rho of x0: the field and a disc are convex.
        """
        ray = self.ray(pixels)
        x0 = [number(v) for v in ray]
        form, slope_form = values(x0), slopes(x0)
        d, (along, mixed, down) = self.at_center(form), self.at_center(slope_form)
        focal, wide = self.center[:2], self.numbers[:2]
        value = [c + f * v for c, f, v in zip(self.center[2:4], focal, d, strict=True)]
        by, second = [], []
        for k in range(2):
            head = [d[0] if k == 0 else ZERO, d[1] if k else ZERO, ONE if k == 0 else ZERO, ONE if k else ZERO]
            numbers = [*head, *(focal[k] * v for v in form[k][1])]
            by.append([inner(numbers, [row[j] for row in self.spread]) for j in range(self.size)])
            second.append(self.reach[k] * self.most(self._by_t(form[k][1])) if self.size else ZERO)
        away = [
            ((p - v).size + self.most(b) + e) / f.least
            for p, v, b, e, f in zip(pixels, value, by, second, wide, strict=True)
        ]
        size = total(a.square for a in away).root.most
        rho = size / self.least
        near = self.least_slope([x.around(rho) for x in x0])
        rho = (size / Bounds(max(near.lo, self.least.lo), max(near.lo, self.least.lo))).most
        box = [x.around(rho) for x in x0]
        rows = [[along, mixed], [mixed, down]]
        slope = [[focal[k] * part for part in rows[k]] for k in range(2)]
        anywhere = self.over(slope_form)
        curved = [c.size for c in self.over(curves(box))]
        rest = []
        for k in range(2):
            changed = total((wide[k] * anywhere[k + i] - slope[k][i]).size for i in range(2)) if self.size else ZERO
            bent = curved[k] + TWO * curved[k + 1] + curved[k + 2]
            rest.append((second[k] + changed * rho + _HALF * wide[k].size * bent * rho.square).most)
        return Linear(ray, value, slope, by, rest, rho)

    @cached_property
    def field_bias(self) -> list[Bounds]:
        """A bound of the bias of a dot that is seen anywhere, whatever its pose."""
        depths, anyhow = between(F(0), F(1, NEAREST)), (UNIT, UNIT, UNIT)
        parts = [part for x in self.cells() for part in self.bias(x, depths, anyhow)]
        return [ZERO.around(Bounds(0, max(part.size.hi for part in parts)))] * 2

    def bias(self, x: Vector, tau: Bounds, normal: Vector) -> list[Bounds]:
        """Centroid of a dot's image less the image of its centre, in pixels: at directions x, tau = radius / Z."""
        away, spread = _ellipse(x, tau, normal)
        center = [a + b for a, b in zip(x, away, strict=True)]
        size = [spread[0].root, spread[2].root]
        box = [c.around(s.most) for c, s in zip(center, size, strict=True)]
        least = self.least_slope(box)
        if least.lo <= 0:
            raise Refused("the lens may turn back within the image of a dot", "proof")
        share = between(F(0), F(1))
        way = self.over(slopes([a + b * share for a, b in zip(x, away, strict=True)]))
        around = self.over(slopes(box)), self.over(curves(box))
        more = _bent_center(self.over(slopes(center)), *around, least, spread, size)
        return [f * (a + b) for f, a, b in zip(self.numbers[:2], _applied(way, away), more, strict=True)]


def _applied(slope: Vector, x: Vector) -> list[Bounds]:
    along, mixed, down = slope
    return [along * x[0] + mixed * x[1], mixed * x[0] + down * x[1]]


def _ellipse(x: Vector, tau: Bounds, normal: Vector) -> tuple[list[Bounds], list[Bounds]]:
    """Its centre less x, and S: xx, xy, yy."""
    square, nz = tau.square, normal[2]
    lean = (ONE - nz.square).within(0, 1)
    q = ONE - square * lean
    first, second = square / q, square / q.square
    away = [first * (normal[k] * nz + x[k] * lean) for k in range(2)]
    spread = []
    for i, j in _PAIRS:
        nn, xx = (normal[i].square, x[i].square) if i == j else (normal[i] * normal[j], x[i] * x[j])
        rest = lean * xx + nz * (x[i] * normal[j] + x[j] * normal[i]) + square * nz.square * nn
        whole = first * ((ONE if i == j else ZERO) - nn) + second * rest
        spread.append(Bounds(max(whole.lo, 0), max(whole.hi, 0)) if i == j else whole)
    return away, spread


def _bent_center(
    at: Vector, around: Vector, curved: Vector, least: Bounds, spread: Vector, size: Vector
) -> list[Bounds]:
    """How far the lens moves the centroid: slopes at its centre, slopes and curvatures over the ellipse's box."""
    (xx, xy, yy), (xxx, xxy, xyy, yyy) = around, curved
    weight = xx * yy - xy.square
    weight = Bounds(max(weight.lo, least.least.square.lo), weight.hi)
    by = (xxx * yy + xx * xyy - TWO * xy * xxy, xxy * yy + xx * yyy - TWO * xy * xyy)
    more = weight.most / weight.least - ONE
    most = [_QUARTER * size[i] * size[j] for i, j in _PAIRS]
    mean = [_QUARTER * part for part in spread]

    def average(coefficient: Bounds, p: int) -> Bounds:
        return (coefficient.middle * mean[p]).around(coefficient.radius * most[p].most)

    a = [total(average(by[j], i + j) for j in range(2)) / weight for i in range(2)]
    out = []
    for k, moved in enumerate(_applied(at, a)):
        b = ZERO
        for p in range(3):
            curve = curved[k + p]
            part = average(curve, p).around(curve.size * more * most[p].most)
            b = b + part.times(2 if p == 1 else 1)
        out.append(moved + _HALF * b)
    return out
