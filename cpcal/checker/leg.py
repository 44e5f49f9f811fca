"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from typing import Protocol

from .polynomial import Polynomial, total
from .problem import SIDES, Constraint, Problem, Unknowns

_AXES = (0, 1, 2)
_L = 6  # the number of the unknown l
PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", "cx", "cy", "cz", "tx", "ty", "tz"), "lateral": ("h",)}
LEG_SIDES = (*SIDES, "length")


@dataclass(frozen=True)
class Measurement:
    """One row of a campaign for one leg: exact numbers, mm; `radii` of the reading (d, s, e)."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    radii: tuple[F, ...]


@dataclass(frozen=True)
class Equation:
    """A measurement in a leg model."""

    measurement: Measurement
    model: str

    @property
    def radii(self) -> tuple[F, ...]:
        return self.measurement.radii

    def at(self, x: Unknowns, readings: Sequence[Polynomial]) -> Constraint:
        """See docs/certificate-format.md, "A leg as constraints", for every name here."""
        m, model, d, e = self.measurement, self.model, readings[:3], readings[6]
        a, b, eps = [x[i] for i in _AXES], [x[3 + i] for i in _AXES], x[len(x) - 1]
        h = _turned(readings[3:6], [x.number(c) for c in m.quaternion])
        kappa, rotation = total([c * c for c in h]), _rotation(h)
        p = [x.number(m.position[i]) + d[i] for i in _AXES]
        z = [p[i] - a[i] for i in _AXES]
        arm = [total([rotation[i][j] * b[j] for j in _AXES]) for i in _AXES]
        square = total([c * c for c in (*z, *b)])
        if model == "lateral":
            square = square - x[7]
        body = kappa * square + total([z[i] * arm[i] for i in _AXES]).times(2)
        read = x.number(m.length) + e
        length, factor = read + x[_L], kappa
        if model in ("gain", "linear"):
            length = length + x[7] * read
        if model == "linear":
            length = kappa * (length + total([x[8 + i] * p[i] for i in _AXES]))
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                length = length + (x[11 + i] * (rotation[k][j] - rotation[j][k])).times(1, -1)
            body, eps_, factor = kappa * body, kappa * eps, x.number(F(1))
        else:
            eps_ = eps
        shortest = x.number(m.length - m.radii[6]) + x[_L]
        also = (eps - shortest, eps.times(-1))
        return Constraint(body, length - eps_, length + eps_, factor, model in ("plain", "lateral"), also)


class Rows(Protocol):
    """The measurements of one leg."""

    def __len__(self) -> int: ...

    def __getitem__(self, k: int, /) -> Measurement: ...


def leg_problem(rows: Rows, model: str, chosen: tuple[int, ...] | None = None) -> Problem:
    """Measurements of a leg, all or the `chosen` ones."""
    names = (*PARAMETERS, *EXTRA[model], "eps")
    all_of = tuple(range(len(rows))) if chosen is None else chosen
    return Problem(names, len(names) - 1, len(rows), all_of, LEG_SIDES, lambda k: Equation(rows[k], model), model)


def _turned(s: Sequence[Polynomial], q: Sequence[Polynomial]) -> list[Polynomial]:
    """The quaternion (1, s) q."""
    w, x, y, z = q
    return [
        w - total([s[0] * x, s[1] * y, s[2] * z]),
        total([x, s[0] * w, s[1] * z]) - s[2] * y,
        total([y, s[1] * w, s[2] * x]) - s[0] * z,
        total([z, s[2] * w, s[0] * y]) - s[1] * x,
    ]


def _rotation(h: Sequence[Polynomial]) -> list[list[Polynomial]]:
    """|h|^2 R(h)."""
    w, x, y, z = h
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    wx, wy, wz, xy, xz, yz = ((p * q).times(2) for p, q in ((w, x), (w, y), (w, z), (x, y), (x, z), (y, z)))
    return [
        [ww + xx - (yy + zz), xy - wz, xz + wy],
        [xy + wz, ww + yy - (xx + zz), yz - wx],
        [xz - wy, yz + wx, ww + zz - (xx + yy)],
    ]
