"""One leg of a campaign as constraints with readings, in the leg models of the format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction as F
from functools import lru_cache
from typing import NamedTuple

from .exact_polynomial import FIELD, READINGS, Polynomial, constant, shortened, unknown
from .problem import SIDES, Problem, Unknowns, beyond, end_of
from .program import Degree, Program, Traced

_AXES = (0, 1, 2)
PARAMETERS = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
EXTRA = {"plain": (), "gain": ("s",), "linear": ("s", "cx", "cy", "cz", "tx", "ty", "tz"), "lateral": ("h",)}
_SURE = ("plain", "lateral")
_KEPT = 4096  # measurements
Quaternion = list[Traced]
Formed = tuple[dict[int, int], Degree]  # places of the coefficients


class Measurement(NamedTuple):
    """One row of a campaign for one leg: exact numbers, mm; `radii` of the reading (d, s, e)."""

    position: tuple[F, ...]
    quaternion: tuple[F, ...]
    length: F
    radii: tuple[F, ...]


def leg_problem(rows: Callable[[int], Measurement], count: int, model: str, only: tuple[int, ...] | None) -> Problem:
    """`count` measurements of a leg, or `only` those."""
    names, known = (*PARAMETERS, *EXTRA[model], "eps"), lru_cache(_KEPT)(rows)
    chosen = tuple(range(count)) if only is None else only
    return Problem(
        names, len(names) - 1, count, chosen,
        lambda k, x, signs, way: LegConstraint(known(k), model, x, signs, way), lambda k: known(k).radii,
        (*SIDES, "length"), (*SIDES, "length", "eps"), model,
    )  # fmt: skip


@dataclass(frozen=True)
class LegConstraint:
    """The constraint of a measurement on a box."""

    m: Measurement
    model: str
    x: Unknowns
    signs: str
    way: int

    def row(self, side: str, mask: int) -> Polynomial:
        """At most zero at every solution, in u and y."""
        if side != "lower" or self.sure:
            return self.parts(side)[0]
        row, low, factor = self.parts("lower", "at_least", "factor")
        return row - constant(beyond(low, factor, mask), self.x.spend)

    def parts(self, *names: str) -> list[Polynomial]:
        """Rows by their sides, or what they are made of by its name in `_Constraint`, in u and y."""
        program, found = leg_program(self.model, any(self.x.radii), self._reads, names)
        v, units = program.run(self.numbers(), self.x.spend)
        return [
            shortened({m: v[k] for m, k in places.items()}, -(units[0] * p + units[1] * q), self.x.spend)
            for places, (p, q) in found
        ]

    @property
    def _reads(self) -> int:
        return any(self.m.radii) * (1 if self.way else 2)

    @property
    def sure(self) -> bool:
        """Whether at_least is not negative at any solution."""
        return self.model in _SURE

    def numbers(self) -> list[F]:
        """What its program takes."""
        position, quaternion, length, radii = self.m
        found = [*quaternion, *position, length, length - radii[6], *self.x.centers]
        found += self.x.radii if any(self.x.radii) else ()
        if self._reads:
            ends = [end_of(sign, r, self.way) for sign, r in zip(self.signs, radii, strict=True)]
            found += [at for at, _ in ends] + [slope for _, slope in ends if not self.way]
        return found


@lru_cache(maxsize=256)
def leg_program(model: str, moves: bool, reads: int, names: tuple[str, ...]) -> tuple[Program, list[Formed]]:
    """Of polynomials in u if the box `moves`, that is, has a width; `reads`: 0 exactly, 1 one reading, 2 sets, in y."""
    n = 8 + len(EXTRA[model])
    program = Program([0] * 4 + [1] * (5 + n * (1 + moves) + READINGS * reads))
    given = iter(program.given())
    quaternion, position, (length, shortest), centers = ([next(given) for _ in range(k)] for k in (4, 3, 2, n))
    x = [c + next(given).moved(unknown(i)) for i, c in enumerate(centers)] if moves else centers
    nothing = Traced(program, {}, (0, 0))
    reading = [next(given) for _ in range(READINGS)] if reads else [nothing] * READINGS
    if reads == 2:
        reading = [at + next(given).moved(1 << FIELD * j) for j, at in enumerate(reading)]
    found = _constraint(model, program.one(), (position, quaternion, length, shortest), x, reading)
    parts = [found.part(name) for name in names]
    program.highest = max(p.degree[0] for p in parts), max(p.degree[1] for p in parts)
    return program, [(part.places(), part.degree) for part in parts]


class _Constraint(NamedTuple):
    """`at_least <= sqrt(under_root / factor) <= at_most`, and what else is at most zero."""

    under_root: Traced
    factor: Traced
    at_least: Traced
    at_most: Traced
    length: Traced
    eps: Traced

    def part(self, name: str) -> Traced:
        """A row, or one of the fields."""
        body, factor, low, high = self[:4]
        if name == "upper":
            return body - factor * (high * high)
        if name == "lower":
            return factor * (low * low) - body
        if name == "sign":
            return high.times(-1)
        found: Traced = body.times(-1) if name == "body" else getattr(self, name)
        return found


def _constraint(
    model: str, one: Traced, m: tuple[Quaternion, Quaternion, Traced, Traced], x: Sequence[Traced], y: Sequence[Traced]
) -> _Constraint:
    """See docs/certificate-format.md, "A leg as constraints", for every name here."""
    position, quaternion, reading, shortest = m
    a, b, offset, eps = x[:3], x[3:6], x[6], x[-1]
    s, fixed = y[3:6], _rotation(quaternion)
    turned, norm = _total([c * c for c in s]), _total([c * c for c in quaternion])
    kappa = norm * (one + turned)
    p = [position[i] + y[i] for i in _AXES]
    z = [p[i] - a[i] for i in _AXES]
    w = [_total([fixed[i][j] * b[j] for j in _AXES]) for i in _AXES]
    along = (one - turned) * _dot(z, w) + (_dot(s, z) * _dot(s, w) + _dot(s, _cross(w, z))).times(2)
    square = _total([c * c for c in (*z, *b)])
    if model == "lateral":
        square = square - x[7]
    body = kappa * square + along.times(2)
    read, factor, wide = reading + y[6], kappa, eps
    length = read + offset
    if model in ("gain", "linear"):
        length = length + x[7] * read
    if model == "linear":
        of_position = _total([x[8 + i] * p[i] for i in _AXES])
        scalar = quaternion[0] - _dot(s, quaternion[1:])
        moved = _cross(s, quaternion[1:])
        vector = [quaternion[1 + i] + s[i] * quaternion[0] + moved[i] for i in _AXES]
        of_rotation = (scalar * _dot(x[11:14], vector)).times(2)
        length = kappa * (length + of_position) + of_rotation
        body, wide, factor = kappa * body, kappa * eps, one
    return _Constraint(body, factor, length - wide, length + wide, eps - offset - shortest, eps.times(-1))


def _total(parts: Sequence[Traced]) -> Traced:
    return sum(parts[1:], start=parts[0])


def _dot(p: Sequence[Traced], q: Sequence[Traced]) -> Traced:
    return _total([c * d for c, d in zip(p, q, strict=True)])


def _cross(p: Sequence[Traced], q: Sequence[Traced]) -> list[Traced]:
    return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in _AXES]


def _rotation(h: Quaternion) -> list[list[Traced]]:
    """|h|^2 R(h)."""
    w, x, y, z = h
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    wx, wy, wz, xy, xz, yz = ((p * q).times(2) for p, q in ((w, x), (w, y), (w, z), (x, y), (x, z), (y, z)))
    return [
        [ww + xx - (yy + zz), xy - wz, xz + wy],
        [xy + wz, ww + yy - (xx + zz), yz - wx],
        [xz - wy, yz + wx, ww + zz - (xx + yy)],
    ]
