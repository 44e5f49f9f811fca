"""The camera of a pose set: a pixel to the first order in direction and camera, and how far the centre of a dot's image
is from the image of its centre.

docs/certificate-format.md, "Pose sets", has the formulas and why they hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import cached_property
from itertools import pairwise

from .bounds import ONE, UNIT, ZERO, Bounds, Vector, between, norm, number, numbers, sizes, total
from .polynomial import inner, plus
from .readers import Refused

CELLS, NEAREST = 24, 40
_PAIRS = ((0, 0), (0, 1), (1, 1))
_HALF, _QUARTER = number(F(1, 2)), number(F(1, 4))
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
    s3, four, six = s2 * s, 4 * s, 6 * s2
    return [
        (ONE, [s + 2 * uu, s2 + four * uu, 2 * v, 6 * u, s3 + six * uu]),
        (ZERO, [2 * uv, four * uv, 2 * u, 2 * v, six * uv]),
        (ONE, [s + 2 * vv, s2 + four * vv, 6 * v, 2 * u, s3 + six * vv]),
    ]


def curves(x: Vector) -> Forms:
    """Second derivatives of d: xxx, xxy, xyy, yyy."""
    u, v = x
    uu, vv = u.square, v.square
    s = uu + vv
    s2, two, six = s.square, 2 * ONE, 6 * ONE

    def radially(k: int, w: Bounds, square: Bounds) -> Vector:
        return [2 * k * w, 4 * k * s * w + 8 * square * w, 6 * k * s2 * w + 24 * s * square * w]

    radial = radially(3, u, uu), radially(1, v, uu), radially(1, u, vv), radially(3, v, vv)
    tangential = (ZERO, six), (two, ZERO), (ZERO, two), (six, ZERO)
    return [(ZERO, [k1, k2, *p, k3]) for (k1, k2, k3), p in zip(radial, tangential, strict=True)]


@dataclass(frozen=True)
class Linear:
    """A pixel to the first order: F = value + slope (x - x0) + by . t + e with |e| <= rest, for directions x in the
    field and cameras t for which F is in the box of pixels."""

    value: Vector
    slope: Sequence[Vector]
    by: Sequence[Vector]
    rest: Vector
    size: Bounds  # of |x - x0|, at most


def longest(row: Vector) -> Bounds:
    """The largest value of row . t, for |t| <= 1."""
    return norm(row).most


class Cameras:
    """Those whose nine numbers are `center + spread t`, |t| <= 1; field: r <= radius."""

    def __init__(self, center: Sequence[F], spread: Sequence[Sequence[F]], radius: F) -> None:
        self.center, self.spread = numbers(center), list(map(numbers, spread))
        self.radius, self.size = number(radius), len(spread[0])
        self.reach = list(map(longest, self.spread))
        self.numbers = [c.around(r) for c, r in zip(self.center, self.reach, strict=True)]
        if min(self.numbers[0].lo, self.numbers[1].lo, self.radius.lo) <= 0:
            raise Refused("a focal length or the field may be zero", "run", 0)

    def by_t(self, row: Vector, first: int = 0) -> list[Bounds]:
        """What is linear in the camera's numbers, from one on, by t."""
        return [inner(row, [spread[j] for spread in self.spread[first:]]) for j in range(self.size)]

    def at_center(self, forms: Forms) -> list[Bounds]:
        return [constant + inner(by, self.center[4:]) for constant, by in forms]

    def over(self, forms: Forms) -> list[Bounds]:
        """For all cameras."""
        at = zip(self.at_center(forms), forms, strict=True)
        return [v.around(longest(self.by_t(by, 4))) for v, (_, by) in at]

    def least_slope(self, x: Vector) -> Bounds:
        """No eigenvalue of the lens's Jacobian on a box of directions is below the lower end (Gershgorin)."""
        along, mixed, down = self.over(slopes(x))
        a, b = along - mixed.size, down - mixed.size
        return Bounds(min(a.lo, b.lo), min(a.hi, b.hi))

    @cached_property
    def cells(self) -> list[list[Bounds]]:
        """Squares that cover the field."""
        cuts = [self.radius * number(F(2 * k - CELLS, CELLS)) for k in range(CELLS + 1)]
        sides = [Bounds(a.lo, b.hi) for a, b in pairwise(cuts)]
        return [[x, y] for x in sides for y in sides if (x.square + y.square).lo <= self.radius.square.hi]

    @cached_property
    def least(self) -> Bounds:
        """A number above zero that no slope in the field is below."""
        least = min(self.least_slope(x).lo for x in self.cells)
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
        size = norm(away).most
        near = self.least_slope([x.around(size / self.least) for x in x0])
        rho = (size / max(near, self.least, key=lambda one: one.lo).least).most
        rows = [[along, mixed], [mixed, down]]
        slope = [[focal[k] * part for part in rows[k]] for k in range(2)]
        anywhere = self.over(slope_form)
        curved = sizes(self.over(curves([x.around(rho) for x in x0])))
        rest = []
        for k in range(2):
            changed = total((wide[k] * anywhere[k + i] - slope[k][i]).size for i in range(2)) if self.size else ZERO
            bent = curved[k] + 2 * curved[k + 1] + curved[k + 2]
            rest.append((second[k] + changed * rho + _HALF * wide[k].size * bent * rho.square).most)
        return Linear(value, slope, by, rest, rho)

    @cached_property
    def field_bias(self) -> list[Bounds]:
        """A bound of the bias of a dot that is seen anywhere, whatever its pose."""
        depths, anyhow = between(F(0), F(1, NEAREST)), (UNIT, UNIT, UNIT)
        parts = [part for x in self.cells for part in self.bias(x, depths, anyhow)]
        return [ZERO.around(max(sizes(parts), key=lambda one: one.hi))] * 2

    def bias(self, x: Vector, tau: Bounds, normal: Vector) -> list[Bounds]:
        """Centroid of a dot's image less the image of its centre, in pixels: at directions x, tau = radius / Z."""
        away, spread = _ellipse(x, tau, normal)
        center = plus(x, away)
        size = [spread[0].root, spread[2].root]
        box = [c.around(s.most) for c, s in zip(center, size, strict=True)]
        least = self.least_slope(box)
        if least.lo <= 0:
            raise Refused("the lens may turn back within the image of a dot", "proof")
        share = between(F(0), F(1))
        way = self.over(slopes([a + b * share for a, b in zip(x, away, strict=True)]))
        around = self.over(slopes(box)), self.over(curves(box))
        more = _bent_center(self.over(slopes(center)), *around, least, spread, size)
        return [f * part for f, part in zip(self.numbers[:2], plus(_turned(way, away), more), strict=True)]


def _turned(slope: Vector, x: Vector) -> list[Bounds]:
    """By the symmetric matrix of slopes xx, xy, yy."""
    return [inner(slope[:2], x), inner(slope[1:], x)]


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
    most = [_QUARTER * size[i] * size[j] for i, j in _PAIRS]

    def average(coefficient: Bounds, p: int) -> Bounds:
        middle = coefficient.middle
        return (middle * (_QUARTER * spread[p])).around((coefficient - middle).size * most[p].most)

    a = [total(average(by[j], i + j) for j in range(2)) / weight for i in range(2)]
    out = []
    for k, moved in enumerate(_turned(at, a)):
        parts = [average(c, p).around(c.size * more * most[p].most) for p, c in enumerate(curved[k : k + 3])]
        out.append(moved + _HALF * (parts[0] + 2 * parts[1] + parts[2]))
    return out
