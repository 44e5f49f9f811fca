"""Legs of one measurement in exact fractions, their equation by itself, and points and readings of them."""

import random
from collections.abc import Sequence
from fractions import Fraction as F
from typing import NamedTuple

from cpcal.checker.leg import Measurement, leg_problem
from cpcal.checker.polynomial import FIELD, READINGS, Polynomial
from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import Problem, Unknowns
from cpcal.solver.certificate.exact_network import free

Vector = list[F]
SIDES = ("upper", "lower")
REACH = {"plain": (), "gain": (0.5,), "lateral": (900.0,)}


class Exact(NamedTuple):
    """One row of a campaign for one leg in fractions, mm; `radii` of the reading (d, s, e)."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    radii: tuple[F, ...]

    def given(self) -> Measurement:
        """As the checker takes it."""
        widths = [r * (2 if 3 <= j < 6 else 1) for j, r in enumerate(self.radii)]
        return Measurement((*self.quaternion, *self.position, self.length), widths)


def in_fractions(m: Measurement) -> Exact:
    given, radii = [F(v) for v in m.given], [F(r) for r in m.radii]
    reach = [r / 2 if 3 <= j < 6 else r for j, r in enumerate(radii)]
    return Exact(tuple(given[4:7]), tuple(given[:4]), given[7], tuple(reach))


def rational(rng: random.Random, size: int) -> F:
    return F(rng.randint(-1024 * size, 1024 * size), 1024)


def hamilton(p: Vector, q: Vector) -> Vector:
    a, b, c, d = p
    e, f, g, h = q
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]


def parts(m: Exact, model: str, x: Vector, reading: Vector) -> tuple[F, F]:
    """||v||^2 - h and L + e + l + t, with v and r through products of quaternions."""
    d, s, e = reading[:3], reading[3:6], reading[6]
    q = hamilton([F(1), *s], list(m.quaternion))
    norm = sum((c * c for c in q), F(0))
    turned = hamilton(hamilton(q, [F(0), *x[3:6]]), [q[0], -q[1], -q[2], -q[3]])[1:]
    v = [m.position[i] + d[i] + turned[i] / norm - x[i] for i in range(3)]
    square, length = sum((c * c for c in v), F(0)), m.length + e + x[6]
    if model == "lateral":
        square -= x[7]
    if model == "gain":
        length += x[7] * (m.length + e)
    return square, length


def left_side(m: Exact, model: str, side: str, x: Vector, reading: Vector) -> F:
    """|q|^2 (1 + s.s) (||v||^2 - h - (L + e + l + t + eps)^2), or its counterpart."""
    square, length = parts(m, model, x, reading)
    norm = sum((c * c for c in m.quaternion), F(0))
    kappa = norm * (1 + sum((c * c for c in reading[3:6]), F(0)))
    end = length + x[-1] if side == "upper" else length - x[-1]
    return (1 if side == "upper" else -1) * kappa * (square - end**2)


def value(p: Polynomial, u: Vector, readings: Sequence[F] = (F(0),) * READINGS) -> F:
    """At a point of the box, in its coordinates, and at readings in theirs."""
    at, total = [*readings, *u], F(0)
    for monomial, c in p.terms.items():
        term = F(c)
        while monomial:
            k = ((monomial & -monomial).bit_length() - 1) // FIELD
            power = monomial >> FIELD * k & (1 << FIELD) - 1
            term *= at[k] ** power
            monomial -= power << FIELD * k
        total += term
    return total * F(2) ** p.exponent


def leg(m: Exact, model: str) -> Problem:
    """A leg of one measurement."""
    return leg_problem(lambda _: m.given(), 1, model, None)


def unknowns(box: ExactBox) -> Unknowns:
    return Unknowns(box, free)


def center(box: ExactBox) -> Vector:
    return [(a + b) / 2 for a, b in zip(box.lo, box.hi, strict=True)]


def radius(box: ExactBox) -> Vector:
    return [(b - a) / 2 for a, b in zip(box.lo, box.hi, strict=True)]


def some(rng: random.Random, factor: int, model: str = "plain") -> tuple[Exact, ExactBox]:
    """A measurement with reading sets `factor` times those of a sensor, and a box."""
    radii = [factor * F(rng.randint(0, 9), 128) for _ in range(3)]
    turns = [factor * F(rng.randint(0, 9), 1 << 13) for _ in range(3)]
    quaternion = tuple(F(rng.randint(-9, 9)) for _ in range(3))
    m = Exact(
        tuple(rational(rng, 300) for _ in range(3)),
        (F(rng.randint(1, 9)), *quaternion),
        F(rng.randint(300, 900)),
        (*radii, *(r / 2 for r in turns), factor * F(rng.randint(0, 9), 128)),
    )
    extra = [c * rng.uniform(-1, 1) for c in REACH[model]]
    middle = [*(rational(rng, 200) for _ in range(7)), *map(F, extra)]
    part = F(rng.choice([0, 1, 8, 1024]), 8)
    widths = [part] * 7 + [part * F(c) / 64 for c in REACH[model]]
    eps = F(rng.randint(0, 5))
    lo, hi = ([c + sign * w for c, w in zip(middle, widths, strict=True)] for sign in (-1, 1))
    return m, ExactBox((*lo, eps), (*hi, eps + rng.randint(0, 3)))


def within(rng: random.Random, radius: F) -> F:
    return radius * (F(rng.randint(-8, 8), 8) if rng.random() < 0.5 else rng.choice([-1, 1]))


def point_of(rng: random.Random, box: ExactBox) -> Vector:
    return [c + within(rng, r) for c, r in zip(center(box), radius(box), strict=True)]


def coordinates(box: ExactBox, x: Vector) -> Vector:
    return [(v - c) / r if r else F(0) for v, c, r in zip(x, center(box), radius(box), strict=True)]


def drawn(rng: random.Random, sign: str) -> F:
    """The coordinate of a reading."""
    y = F(rng.randint(0, 8), 8) if rng.random() < 0.5 else F(rng.choice([0, 1]))
    return y if sign != "0" else y * rng.choice([-1, 1])


def taken(radius_: F, sign: str, y: F) -> F:
    return radius_ * (y if sign == "0" else (1 - 2 * y) * (1 if sign == "+" else -1))
