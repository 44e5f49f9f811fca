"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction as F
from typing import NamedTuple

from .exact_polynomial import FIELD, READINGS, Kept, Polynomial, constant, total, unknown
from .problem import SIDES, Constraint, Problem

_AXES = (0, 1, 2)
PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", "cx", "cy", "cz", "tx", "ty", "tz"), "lateral": ("h",)}
Quaternion = list[Polynomial]


class Measurement(NamedTuple):
    """One row of a campaign for one leg: exact numbers, mm; `radii` of the reading (d, s, e)."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    radii: tuple[F, ...]


def leg_problem(rows: Callable[[int], Measurement], count: int, model: str, only: tuple[int, ...] | None) -> Problem:
    """`count` measurements of a leg, or `only` those."""
    names = (*PARAMETERS, *EXTRA[model], "eps")
    chosen = tuple(range(count)) if only is None else only
    return Problem(
        names, len(names) - 1, count, chosen,
        lambda k, images: _constraint(rows(k), model, images), lambda k: rows(k).radii, (*SIDES, "length"), model,
    )  # fmt: skip


def _constraint(m: Measurement, model: str, images: Kept) -> Constraint:
    """See docs/certificate-format.md, "A leg as constraints", for every name here."""

    def number(value: F) -> Polynomial:
        return constant(value, images[0].spend)

    x = [images[unknown(i)] for i in range(8 + len(EXTRA[model]))]
    readings = [images[1 << FIELD * j] for j in range(READINGS)]
    a, b, offset, eps = x[:3], x[3:6], x[6], x[-1]
    h = _product([number(F(1)), *readings[3:6]], [number(c) for c in m.quaternion])
    kappa, rotation = total([c * c for c in h]), _rotation(h)
    arm = [total([rotation[i][j] * b[j] for j in _AXES]) for i in _AXES]
    p = [number(m.position[i]) + readings[i] for i in _AXES]
    z = [p[i] - a[i] for i in _AXES]
    square = total([c * c for c in (*z, *b)])
    if model == "lateral":
        square = square - x[7]
    body = kappa * square + total([z[i] * arm[i] for i in _AXES]).times(2)
    read, factor, wide = number(m.length) + readings[6], kappa, eps
    length = read + offset
    if model in ("gain", "linear"):
        length = length + x[7] * read
    if model == "linear":
        of_position = total([x[8 + i] * p[i] for i in _AXES])
        of_rotation = total([x[11 + i] * h[0] * h[1 + i] for i in _AXES]).times(2)
        length = kappa * (length + of_position) + of_rotation
        body, wide, factor = kappa * body, kappa * eps, number(F(1))
    also = {"length": eps - offset - number(m.length - m.radii[6]), "eps": eps.times(-1)}
    return Constraint(body, length - wide, length + wide, factor, model in ("plain", "lateral"), also)


def _product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton's."""
    a, b, c, d = p
    e, f, g, h = q
    return [
        a * e - total([b * f, c * g, d * h]),
        total([a * f, b * e, c * h]) - d * g,
        total([a * g, c * e, d * f]) - b * h,
        total([a * h, b * g, d * e]) - c * f,
    ]


def _rotation(h: Quaternion) -> list[list[Polynomial]]:
    """|h|^2 R(h)."""
    w, x, y, z = h
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    wx, wy, wz, xy, xz, yz = ((p * q).times(2) for p, q in ((w, x), (w, y), (w, z), (x, y), (x, z), (y, z)))
    return [
        [ww + xx - (yy + zz), xy - wz, xz + wy],
        [xy + wz, ww + yy - (xx + zz), yz - wx],
        [xz - wy, yz + wx, ww + zz - (xx + yy)],
    ]
