"""The camera of a pose set: a pixel to the first order in direction and camera, and how far the centre of a dot's image
is from the image of its centre. And the lenses of hand-eye studies.

docs/certificate-format.md, "Pose sets" and "Hand-eye", has the formulas and why they hold.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from itertools import product
from math import inf

from .bounds import ONE, UNIT, ZERO, Bounds, Vector, between, dot, longest, number, numbers, sizes, total
from .polynomial import plus, transposed
from .readers import Refused

CELLS, NEAREST = 24, 40
_PAIRS = ((0, 0), (0, 1), (1, 1))
_HALF, _QUARTER = number(F(1, 2)), number(F(1, 4))
_TANGENTIAL = (ZERO, 6 * ONE), (2 * ONE, ZERO), (ZERO, 2 * ONE), (6 * ONE, ZERO)
Forms = list[tuple[Bounds, Vector]]  # of quantities that are linear in k1, k2, p1, p2, k3: constants and coefficients


def values(x: Vector) -> Forms:
    """d (2) at directions x."""
    u, v = x
    uu, vv, uv = u.square, v.square, u * v
    s = uu + vv
    s2 = s.square
    s3 = s2 * s
    return [(u, [u * s, u * s2, 2 * uv, s + 2 * uu, u * s3]), (v, [v * s, v * s2, s + 2 * vv, 2 * uv, v * s3])]


def slopes(x: Vector) -> Forms:
    """Derivatives of d: of the first component by x, by y (as of the second by x), of the second by y."""
    u, v = x
    uu, vv, uv = u.square, v.square, u * v
    s = uu + vv
    s2 = s.square
    s3, four, six, two_u, two_v = s2 * s, 4 * s, 6 * s2, 2 * u, 2 * v
    return [
        (ONE, [s + 2 * uu, s2 + four * uu, two_v, 6 * u, s3 + six * uu]),
        (ZERO, [2 * uv, four * uv, two_u, two_v, six * uv]),
        (ONE, [s + 2 * vv, s2 + four * vv, 6 * v, two_u, s3 + six * vv]),
    ]


def curves(x: Vector) -> Forms:
    """Second derivatives of d: xxx, xxy, xyy, yyy."""
    u, v = x
    uu, vv = u.square, v.square
    s = uu + vv
    s2, four = s.square, 4 * s

    def radially(k: int, w: Bounds, square: Bounds) -> Vector:
        return [2 * k * w, 4 * ((k * s + 2 * square) * w), 6 * ((k * s2 + four * square) * w)]

    radial = radially(3, u, uu), radially(1, v, uu), radially(1, u, vv), radially(3, v, vv)
    return [(ZERO, [k1, k2, *p, k3]) for (k1, k2, k3), p in zip(radial, _TANGENTIAL, strict=True)]


@dataclass(frozen=True)
class Linear:
    """A pixel to the first order: F = value + slope (x - x0) + by . t + e with |e| <= rest, for directions x in the
    field and cameras t for which F is in the box of pixels."""

    value: Vector
    slope: Sequence[Vector]
    by: Sequence[Vector]
    rest: Vector
    size: Bounds  # of |x - x0|, at most


class Cameras:
    """Those whose nine numbers are `center + spread t`, |t| <= 1; field: r <= radius."""

    def __init__(self, center: Sequence[F], spread: Sequence[Sequence[F]], radius: F) -> None:
        self.center, by_number = numbers(center), list(map(numbers, spread))
        self.radius, self.size = number(radius), len(spread[0])
        self.reach, self.spread = list(map(longest, by_number)), transposed(by_number)  # by t
        self.numbers = [c.around(r) for c, r in zip(self.center, self.reach, strict=True)]
        if min(self.numbers[0].lo, self.numbers[1].lo, self.radius.lo) <= 0:
            raise Refused("a focal length or the field may be zero", "run", 0)

    def by_t(self, row: Vector, first: int = 0) -> list[Bounds]:
        """What is linear in the camera's numbers, from one on, by t."""
        return [dot(row, by[first:]) for by in self.spread]

    def at_center(self, forms: Forms) -> list[Bounds]:
        return [constant + dot(by, self.center[4:]) for constant, by in forms]

    def over(self, forms: Forms) -> list[Bounds]:
        """For all cameras."""
        at = zip(self.at_center(forms), forms, strict=True)
        return [v.around(longest(self.by_t(by, 4))) for v, (_, by) in at]

    def largest(self, bound: Callable[[Vector], int]) -> int:
        """No less than a bound anywhere in the field: taken over 24 x 24 squares that cover it, or over four of them at
        once where that is no more than elsewhere."""

        def squares(places: Iterable[Sequence[int]], wide: int) -> Iterator[tuple[Vector, int, int]]:
            for i, j in places:
                x, y = (Bounds(cuts[k].lo, cuts[k + wide].hi) for k in (i, j))
                if (x.square + y.square).lo <= self.radius.square.hi:
                    yield (x, y), i, j

        def of_four(square: Vector) -> float:
            try:
                return bound(square)
            except Refused:  # each of the four may still be proved
                return inf

        cuts = [self.radius * number(F(2 * k - CELLS, CELLS)) for k in range(CELLS + 1)]
        fours = squares(product(range(0, CELLS, 2), repeat=2), 2)
        most = bound((ZERO, ZERO))
        for together, i, j in sorted(((of_four(square), i, j) for square, i, j in fours), reverse=True):
            if together > most:
                each = squares(product((i, i + 1), (j, j + 1)), 1)
                most = max([most, *(bound(square) for square, _, _ in each)])
        return most

    @cached_property
    def least(self) -> Bounds:
        """A number above zero that no slope in the field is below."""
        least = -self.largest(lambda x: -least_slope(self.over(slopes(x))).lo)
        if least <= 0:
            raise Refused("the lens may turn back within its field", "run", 0)
        return Bounds(least, least)

    def linear(self, pixels: Vector, ray: tuple[F, F]) -> Linear:
        """Of a box of pixels, about a direction x0 that should be near its middle's.

        With |F(x, t) - F(x0, t)| <= a there, |x - x0| <= a / (f m) = rho, m the lens's least slope in the field, and
        then that within rho of x0: the field and a disc are convex.
        """
        if ray[0] ** 2 + ray[1] ** 2 > self.radius.ends[0] ** 2:
            raise Refused("a direction of a dot is beside the camera's field", "run", 0)
        x0 = numbers(ray)
        form, slope_form = values(x0), slopes(x0)
        d, (along, mixed, down) = self.at_center(form), self.at_center(slope_form)
        focal, wide = self.center[:2], self.numbers[:2]
        value = [c + f * v for c, f, v in zip(self.center[2:4], focal, d, strict=True)]
        by, second = [], []
        for k, (_, lens) in enumerate(form):
            own = [ZERO] * 4
            own[k], own[2 + k] = d[k], ONE
            by.append(self.by_t([*own, *(focal[k] * v for v in lens)]))
            second.append(self.reach[k] * longest(self.by_t(lens, 4)))
        away = [
            ((p - v).size + longest(b) + e) / f.least
            for p, v, b, e, f in zip(pixels, value, by, second, wide, strict=True)
        ]
        size = longest(away)
        near = least_slope(self.over(slopes([x.around(size / self.least) for x in x0])))
        rho = (size / max(near, self.least, key=lambda one: one.lo).least).most
        rows = [[along, mixed], [mixed, down]]
        slope = [[focal[k] * part for part in rows[k]] for k in range(2)]
        curved = sizes(self.over(curves([x.around(rho) for x in x0])))
        anywhere, rest = self.over(slope_form) if self.size else [], []
        for k in range(2):
            changed = total((wide[k] * anywhere[k + i] - slope[k][i]).size for i in range(2)) if self.size else ZERO
            bent = curved[k] + 2 * curved[k + 1] + curved[k + 2]
            rest.append((second[k] + changed * rho + _HALF * wide[k].size * bent * rho.square).most)
        return Linear(value, slope, by, rest, rho)

    @cached_property
    def field_bias(self) -> list[Bounds]:
        """A bound of the bias of a dot that is seen anywhere, whatever its pose."""
        depths, anyhow = between(F(0), F(1, NEAREST)), (UNIT, UNIT, UNIT)
        most = self.largest(lambda x: max(part.size.hi for part in self.bias(x, depths, anyhow)))
        return [Bounds(-most, most)] * 2

    def bias(self, x: Vector, tau: Bounds, normal: Vector) -> list[Bounds]:
        """Centroid of a dot's image less the image of its centre, in pixels: at directions x, tau = radius / Z."""
        away, spread = _ellipse(x, tau, normal)
        center = plus(x, away)
        size = [spread[0].root, spread[2].root]
        box = [c.around(s.most) for c, s in zip(center, size, strict=True)]
        slope = self.over(slopes(box))
        least = least_slope(slope)
        if least.lo <= 0:
            raise Refused("the lens may turn back within the image of a dot", "proof")
        share = between(F(0), F(1))
        way = self.over(slopes([a + b * share for a, b in zip(x, away, strict=True)]))
        around = slope, self.over(curves(box))
        more = _bent_center(self.over(slopes(center)), *around, least, spread, size)
        return [f * part for f, part in zip(self.numbers[:2], plus(_turned(way, away), more), strict=True)]


def least_slope(slope: Vector) -> Bounds:
    """No eigenvalue of the lens's Jacobian with these entries is below the lower end (Gershgorin)."""
    along, mixed, down = slope
    a, b = along - mixed.size, down - mixed.size
    return Bounds(min(a.lo, b.lo), min(a.hi, b.hi))


def _turned(slope: Vector, x: Vector) -> list[Bounds]:
    """By the symmetric matrix of slopes xx, xy, yy."""
    return [dot(slope[:2], x), dot(slope[1:], x)]


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
    by = (xxx * yy + xx * xyy - 2 * xy * xxy, xxy * yy + xx * yyy - 2 * xy * xyy)
    more = weight.most / weight.least - ONE
    mean = [_QUARTER * v for v in spread]
    most = [(_QUARTER * size[i] * size[j]).most for i, j in _PAIRS]
    beyond = [more * v for v in most]

    def average(coefficient: Bounds, p: int) -> Bounds:
        middle = coefficient.middle
        return (middle * mean[p]).around((coefficient - middle).size * most[p])

    a = [total(average(by[j], i + j) for j in range(2)) / weight for i in range(2)]
    out = []
    for k, moved in enumerate(_turned(at, a)):
        parts = [average(c, p).around(c.size * beyond[p]) for p, c in enumerate(curved[k : k + 3])]
        out.append(moved + _HALF * (parts[0] + 2 * parts[1] + parts[2]))
    return out


# lenses of hand-eye studies -----------------------------------------------------------------------------------------

LENSES = {"brown": 5, "rational": 8, "fisheye": 4}  # how many numbers each has
_HALVINGS = 12


def distorted(model: str, given: Sequence[F], rays: Sequence[Vector]) -> list[list[Bounds]]:
    """Where a lens moves directions. Refuses one that may move two to one place, both as near as the farthest of these.

    It moves x to (h n(t) / m(t) + 2 q . x) x + q r^2 with q = (p2, p1), t = r^2 and h = 1; a fisheye, whose q is zero,
    with t = (atan r)^2 and h = atan(r) / r.
    """
    squares, k = [x.square + y.square for x, y in rays], numbers(given)
    if model == "fisheye":
        n, m, q, turns = [ONE, *k], [ONE], [ZERO, ZERO], [_turn_of(s) for s in squares]
    else:
        n, m, q, turns = [ONE, *k[:2], k[4]], [ONE, *k[5:]], [k[3], k[2]], [(ONE, s) for s in squares]
    everywhere = Bounds(0, max(t.hi for _, t in turns))
    _check_slopes(n, m, 6 * longest(q) * everywhere.root, everywhere)
    out = []
    for x, s, (h, t) in zip(rays, squares, turns, strict=True):
        factor = h * _polynomial(n, t)[0] / _polynomial(m, t)[0] + 2 * dot(q, x)
        out.append([factor * v + p * s for v, p in zip(x, q, strict=True)])
    return out


def _turn_of(s: Bounds) -> tuple[Bounds, Bounds]:
    """atan(r) / r and atan(r)^2 of s = r^2: by tan(a / 2) = r / (1 + sqrt(1 + r^2)), and then between two sums of the
    series."""
    share, rest = ONE, s
    for _ in range(_HALVINGS):
        half = ONE + (ONE + rest).root
        share, rest = 2 * share / half, rest / half.square
    least = ONE - rest * number(F(1, 3))
    share *= Bounds(least.lo, (least + rest.square * number(F(1, 5))).hi)
    return share, s * share.square


def _polynomial(coefficients: Vector, t: Bounds) -> tuple[Bounds, Bounds]:
    """Its value and its derivative, by Horner's rule."""
    value, slope = ZERO, ZERO
    for c in reversed(coefficients):
        value, slope = c + t * value, value + t * slope
    return value, slope


def _check_slopes(n: Vector, m: Vector, tangential: Bounds, t: Bounds, halvings: int = _HALVINGS) -> None:
    """The lens's symmetric Jacobian is positive definite for all t: in a disk of directions it moves no two to one
    place.

    Its radial part g = h n / m has the eigenvalues g and d(r g) / dr; g is a mean of those nearer to the axis. The
    latter is n m + 2 t (n' m - n m') over m^2, for a fisheye over 1 + r^2. The eigenvalues of the tangential part are
    at least -6 |q| r.
    """
    (a, a1), (b, b1) = _polynomial(n, t), _polynomial(m, t)
    slope = a * b + 2 * (t * (a1 * b - a * b1)) - tangential * b.square
    if min(b.lo, slope.lo) > 0:
        return
    if not halvings:
        raise Refused("has a lens that may turn back before its farthest point", "proof")
    middle = t.middle.lo
    for half in (Bounds(t.lo, middle), Bounds(middle, t.hi)):
        _check_slopes(n, m, tangential, half, halvings - 1)
