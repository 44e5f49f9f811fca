"""The camera of a pose set: which directions a pixel box shows, and how far a dot's centre and its image's are apart.

docs/certificate-format.md, "Pose sets", has the formulas and why they hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction as F
from functools import cached_property
from itertools import pairwise

from .bounds import ONE, TWO, UNIT, ZERO, Bounds, Vector, between, inner, number, total
from .refusal import Refused

CELLS, BIAS_CELLS, ROUNDS, BIAS_ROUNDS, NEAREST = 24, 24, 3, 3, 40
_STRAIGHT = (ONE, ONE, *[ZERO] * 7)  # a camera without distortion
_UNITS = tuple(tuple(ONE if i in (0, 1, j) else ZERO for i in range(9)) for j in range(4, 9))
_PAIRS = ((0, 0), (0, 1), (1, 1))
_ANY = (UNIT, UNIT, UNIT)  # normals
_DEPTHS = between(F(0), F(1, NEAREST))  # radius / Z


@dataclass(frozen=True)
class Bent:
    """On a box of directions: d, its slopes (by x, mixed, by y), and its curvatures xxx, xxy, xyy, yyy."""

    value: Vector
    slopes: Vector
    curves: Vector

    @property
    def least(self) -> Bounds:
        """No eigenvalue of a Jacobian is below the lower end."""
        along, mixed, down = self.slopes
        a, b = along - mixed.size, down - mixed.size
        return Bounds(min(a.lo, b.lo), min(a.hi, b.hi))

    def applied(self, x: Vector) -> list[Bounds]:
        """The Jacobian times x."""
        along, mixed, down = self.slopes
        return [along * x[0] + mixed * x[1], mixed * x[0] + down * x[1]]


def bent(x: Vector, numbers: Vector) -> Bent:
    k1, k2, p1, p2, k3 = numbers[4:]
    u, v = x
    uu, vv, uv = u.square, v.square, u * v
    s = uu + vv
    g = ONE + s * (k1 + s * (k2 + s * k3))
    g1 = k1 + s * (TWO * k2 + s * k3.times(3))
    g2 = TWO * k2 + s * k3.times(6)
    value = [
        u * g + TWO * p1 * uv + p2 * (s + TWO * uu),
        v * g + TWO * p2 * uv + p1 * (s + TWO * vv),
    ]
    slopes = [
        g + TWO * g1 * uu + TWO * p1 * v + p2.times(6) * u,
        TWO * g1 * uv + TWO * p1 * u + TWO * p2 * v,
        g + TWO * g1 * vv + p1.times(6) * v + TWO * p2 * u,
    ]
    curves = [
        p2.times(6) + g1.times(6) * u + g2.times(4) * uu * u,
        TWO * p1 + TWO * g1 * v + g2.times(4) * uu * v,
        TWO * p2 + TWO * g1 * u + g2.times(4) * vv * u,
        p1.times(6) + g1.times(6) * v + g2.times(4) * vv * v,
    ]
    return Bent(value, slopes, curves)


@dataclass(frozen=True)
class View:
    """A box of pixels, a ray of the field, the directions that it shows with the lens's slopes there, the lens at the
    ray."""

    pixels: Vector
    ray: Vector
    x: Vector
    slopes: Vector
    at: Bent


class Cameras:
    """Those whose nine numbers are `center + spread t`, |t| <= 1 if `ball`, else |t_j| <= 1; field: r <= radius."""

    def __init__(self, center: Vector, spread: list[Vector], ball: bool, radius: Bounds) -> None:
        self.center, self.spread, self.ball, self.radius = list(center), spread, ball, radius
        self.size = len(spread[0])
        self.reach = [self.most(row) for row in spread]
        self.numbers = [c.around(r) for c, r in zip(center, self.reach, strict=True)]
        if min(self.numbers[0].lo, self.numbers[1].lo, radius.lo) <= 0:
            raise Refused("a focal length or the field may be zero", "run", 0)

    def over(self, x: Vector, *names: str) -> Bent:
        """The lens on a box of directions, in `names` for all cameras: it is linear in its numbers."""
        at = bent(x, self.center)
        if not self.size:
            return at
        plain, units = bent(x, _STRAIGHT), [bent(x, unit) for unit in _UNITS]

        def wide(name: str) -> list[Bounds]:
            out = []
            for i, value in enumerate(getattr(at, name)):
                by = [getattr(one, name)[i] - getattr(plain, name)[i] for one in units]
                out.append(value.around(self.most(self._by_t(by))))
            return out

        return replace(at, **{name: wide(name) for name in names})

    def _by_t(self, by: Vector) -> list[Bounds]:
        """What is linear in the lens's five numbers, by t."""
        return [inner(by, [row[j] for row in self.spread[4:]]) for j in range(self.size)]

    def most(self, row: Vector) -> Bounds:
        """The largest value of row . t."""
        return total(c.square for c in row).root.most if self.ball else total(c.size for c in row)

    def _cells(self, count: int) -> list[list[Bounds]]:
        """Squares that cover the field."""
        radius, out = self.radius, []
        cuts = [radius * (number(2 * k - count) / number(count)) for k in range(count + 1)]
        sides = [Bounds(a.lo, b.hi) for a, b in pairwise(cuts)]
        for x in sides:
            out += [[x, y] for y in sides if (x.square + y.square).lo <= radius.square.hi]
        return out

    @cached_property
    def least(self) -> Bounds:
        """A number above zero that no slope in the field is below."""
        least = min(self.over(x, "slopes").least.lo for x in self._cells(CELLS))
        if least <= 0:
            raise Refused("the lens may turn back within its field", "run", 0)
        return Bounds(least, least)

    def directions(self, pixels: Vector, ray: Vector) -> list[Bounds]:
        """The directions of the field that a pixel box shows; `ray` is any of the field."""
        if (ray[0].square + ray[1].square).hi > self.radius.square.lo:
            raise Refused("a ray is outside the field", "run", 0)
        value = self.over(ray, "value").value
        away = [(pixels[k] - self.numbers[2 + k]) / self.numbers[k] - value[k] for k in range(2)]
        size, least = (away[0].size.square + away[1].size.square).root, self.least
        for _ in range(ROUNDS):
            here = self.over([x.around(size / least) for x in ray], "slopes").least
            least = Bounds(max(least.lo, here.lo), max(least.lo, here.lo))
        box = [x.around(size / least) for x in ray]
        along, mixed, down = self.over(box, "slopes").slopes
        a, b, d = along.middle, mixed.middle, down.middle
        determinant = (a * d - b * b).middle
        back = [
            [(d / determinant).middle, -(b / determinant).middle],
            [-(b / determinant).middle, (a / determinant).middle],
        ]
        slopes, out = ((along, mixed), (mixed, down)), []
        for k in range(2):
            rest = [(ONE if k == j else ZERO) - inner(back[k], [row[j] for row in slopes]) for j in range(2)]
            step = inner(back[k], away) + total(r * (x - y) for r, x, y in zip(rest, box, ray, strict=True))
            moved = ray[k] + step
            out.append(Bounds(max(moved.lo, box[k].lo), min(moved.hi, box[k].hi)))
        return out

    @cached_property
    def field_bias(self) -> Bounds:
        """The largest component of the bias of a dot that is seen anywhere, in pixels."""
        parts = [part for x in self._cells(BIAS_CELLS) for part in self.bias(x, _DEPTHS, _ANY)]
        most = max(part.size.hi for part in parts)
        return Bounds(most, most)

    def bias_anywhere(self, pixels: Vector, ray: Vector) -> list[Bounds]:
        """The bias of a dot whose image's centre is in a pixel box, whatever the pose."""
        bias = [ZERO.around(self.field_bias)] * 2
        for _ in range(BIAS_ROUNDS):
            x = self.directions([p - b for p, b in zip(pixels, bias, strict=True)], ray)
            found = self.bias(x, _DEPTHS, _ANY)
            bias = [Bounds(max(a.lo, b.lo), min(a.hi, b.hi)) for a, b in zip(found, bias, strict=True)]
        return bias

    def bias(self, x: Vector, tau: Bounds, normal: Vector) -> list[Bounds]:
        """Centroid of a dot's image less the image of its centre, in pixels: at directions x, tau = radius / Z."""
        away, spread = _ellipse(x, tau, normal)
        center = [a + b for a, b in zip(x, away, strict=True)]
        size = [spread[0].root, spread[2].root]
        around = self.over([c.around(s.most) for c, s in zip(center, size, strict=True)], "slopes", "curves")
        if around.least.lo <= 0:
            raise Refused("the lens may turn back within the image of a dot", "proof")
        share = between(F(0), F(1))
        way = self.over([a + b * share for a, b in zip(x, away, strict=True)], "slopes")
        more = _bent_center(self.over(center, "slopes"), around, spread, size)
        return [f * (a + b) for f, a, b in zip(self.numbers[:2], way.applied(away), more, strict=True)]

    def view(self, pixels: Vector, ray: Vector) -> View:
        """What the planes of a box of pixels are made of."""
        x = self.directions(pixels, ray)
        return View(pixels, ray, x, self.over(x, "slopes").slopes, bent(ray, self.center))

    def plane(self, view: View, side: int) -> tuple[list[Bounds], list[Bounds]]:
        """g and k: g . X + Z k . t <= 0 for all points X whose pixel is in the box; sides 0, 1 above, 2, 3 below."""
        k, x0, own, pixels, x, slopes, at = side % 2, view.ray, self.center, view.pixels, view.x, view.slopes, view.at
        near = [own[k] * at.slopes[k].middle, own[k] * at.slopes[k + 1].middle]
        slope = [self.numbers[k] * slopes[k], self.numbers[k] * slopes[k + 1]]
        rest = total((a - b) * (c - d) for a, b, c, d in zip(slope, near, x, x0, strict=True))
        by_numbers = _by_numbers(x0, own, k, at)
        shared = [inner(by_numbers, [row[j] for row in self.spread]) for j in range(self.size)]
        lens = self.most(self._by_t(by_numbers[4:]))
        lost = (rest.size + self.reach[k] / own[k] * lens).most
        middle = inner(near, x0) - own[2 + k] - own[k] * at.value[k]
        if side < 2:
            return [*near, -(pixels[k].most + middle + lost)], shared
        return [*(-n for n in near), pixels[k].least + middle - lost], [-s for s in shared]


def _by_numbers(x: Vector, numbers: Vector, k: int, at: Bent) -> list[Bounds]:
    """Derivatives of pixel k by the nine numbers."""
    u, v = x
    w, s, uv = x[k], u.square + v.square, u * v
    tangential = [TWO * uv, s + TWO * w.square]
    first, second = tangential if k == 0 else tangential[::-1]
    lens = [w * s, w * s.square, first, second, w * (s.square * s)]
    head = [at.value[0], ZERO, ONE, ZERO] if k == 0 else [ZERO, at.value[1], ZERO, ONE]
    return [*head, *(numbers[k] * part for part in lens)]


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


def _bent_center(at: Bent, around: Bent, spread: Vector, size: Vector) -> list[Bounds]:
    """How far the lens moves the centroid."""
    (xx, xy, yy), (xxx, xxy, xyy, yyy) = around.slopes, around.curves
    weight = xx * yy - xy.square
    weight = Bounds(max(weight.lo, around.least.least.square.lo), weight.hi)
    by = (xxx * yy + xx * xyy - TWO * xy * xxy, xxy * yy + xx * yyy - TWO * xy * xyy)
    more = weight.most / weight.least - ONE
    quarter = ONE / TWO.times(2)
    most = [quarter * size[i] * size[j] for i, j in _PAIRS]
    mean = [quarter * part for part in spread]

    def average(coefficient: Bounds, p: int) -> Bounds:
        return (coefficient.middle * mean[p]).around(coefficient.radius * most[p].most)

    a = [total(average(by[j], i + j) for j in range(2)) / weight for i in range(2)]
    out = []
    for k, moved in enumerate(at.applied(a)):
        b = ZERO
        for p in range(3):
            curve = around.curves[k + p]
            part = average(curve, p).around(curve.size * more * most[p].most)
            b = b + part.times(2 if p == 1 else 1)
        out.append(moved + b / TWO)
    return out
