"""Whether the rows of a certificate follow from what a pose set assumes."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction as F

from .bounds import TWO, Bounds, Vector, applied, between, cross, inner, number, total, transposed
from .claims import Accepted
from .exact_polynomial import Polynomial, unknown
from .lens import NEAREST, Cameras, View
from .pose_sight import Place, Sight, slope_size
from .problem import Constraint
from .refusal import Refused

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Stated:
    """A certificate's problem: its box, and its constraints as polynomials that are at most zero."""

    def __init__(self, accepted: Accepted, items: list[Constraint]) -> None:
        self.root = [between(lo, hi) for lo, hi in zip(accepted.lo, accepted.hi, strict=True)]
        self.objective = accepted.objective is not None
        self.rows: list[Polynomial] = []
        for item in items:
            if item.factor is not None:
                raise Refused("a pose set has no roots", "run")
            if item.at_most is not None:
                self.rows.append(item.body - item.at_most)
            if item.at_least is not None:
                self.rows.append(item.at_least - item.body)


def coefficients(p: Polynomial) -> dict[int, Bounds]:
    """By monomial."""
    scale = F(2) ** p.exponent
    return {monomial: number(c * scale) for monomial, c in p.terms.items()}


def implied(stated: Mapping[int, Bounds], exact: Mapping[int, Bounds], largest: Mapping[int, Bounds]) -> bool:
    """Whether a row that is stated is at most the exact one, wherever each monomial is at most `largest`.

    The exact one's coefficients are anywhere in their bounds.
    """
    off = stated.get(0, number(0)) - exact.get(0, number(0))
    for monomial in stated.keys() | exact.keys():
        if not monomial:
            continue
        if monomial not in largest:
            return False
        away = stated.get(monomial, number(0)) - exact.get(monomial, number(0))
        off = off + away.size * largest[monomial]
    return off.hi <= 0


def motion_row(sight: Sight, row: Polynomial, dot: int, side: int, view: View, root: Vector) -> bool:
    """A row in (P, r1, r2): g' . (P + x r1 + y r2) <= |g'| (|d1| + |d2| + |d3|)."""
    one = sight.dots[dot]
    off, constant = total(one.widths), number(0)
    if side == 4:
        g = [number(0), number(0), number(-1)]
        constant = number(NEAREST) * sight.radius - off
    else:
        g, shared = sight.cameras.plane(view, side)
        g[2] = g[2] - sight.cameras.most(shared)
        constant = -(slope_size([number(0).around(v.size) for v in g]) * off)
    x, y = one.at
    exact = {0: constant}
    for k in range(3):
        exact |= {unknown(k): g[k], unknown(3 + k): x * g[k], unknown(6 + k): y * g[k]}
    return implied(coefficients(row), exact, {unknown(k): root[k].size for k in range(9)})


def pose_row(sight: Sight, place: Place, row: Polynomial, dot: int, side: int, view: View, power: int) -> bool:
    """A row in (W, s, t), times 2^power: the half-space of a dot, multiplied by 1 + s.s."""
    if side == 4:
        return False
    scale = number(F(2) ** power)
    g, shared = sight.cameras.plane(view, side)
    v = applied(place.start, sight.point(dot))
    c = applied(transposed(sight.turns[0]), g)
    origin, along = inner(g, place.middle), inner(c, v)
    exact = {0: origin + along}
    swing = cross(v, c)
    for k in range(3):
        exact |= {unknown(k): c[k], unknown(3 + k): TWO * swing[k]}
    for i, j in _PAIRS:
        mixed = origin - along + TWO * c[i] * v[i] if i == j else TWO * (c[i] * v[j] + c[j] * v[i])
        exact[unknown(3 + i) + unknown(3 + j)] = mixed
    exact = {monomial: scale * value for monomial, value in exact.items()}
    stated = coefficients(row)
    largest = {unknown(k): place.size[k] for k in range(6)}
    largest |= {unknown(3 + i) + unknown(3 + j): place.size[3 + i] * place.size[3 + j] for i, j in _PAIRS}
    given = [stated.pop(unknown(6 + j), number(0)) for j in range(len(shared))]
    stated[0] = stated.get(0, number(0)) + _of_the_camera(sight.cameras, place, dot, scale, shared, given)
    return implied(stated, exact, largest)


def _of_the_camera(
    cameras: Cameras, place: Place, dot: int, scale: Bounds, shared: list[Bounds], given: list[Bounds]
) -> Bounds:
    """The largest of given . t - D scale shared . t, for D = (1 + s.s) Z of the dot.

    With any number w for D it is at most max |w - D| max (scale shared . t) + sum |given_j - w scale shared_j|.
    """
    if not shared:
        return number(0)
    depth = place.stretch * place.point(dot)[2]
    j = max(range(len(shared)), key=lambda k: shared[k].size.hi)
    by = scale * shared[j]
    w = (given[j].middle / by.middle).middle if by.middle.lo else depth.middle
    kept = [scale * k for k in shared]
    return (w - depth).size * cameras.most(kept) + total((a - w * k).size for a, k in zip(given, kept, strict=True))


def fixed_constraints(stated: Stated, rows: int, motions: bool, cameras: Cameras) -> None:
    """Whether all constraints but the rows hold anyway: unit columns at right angles, or the ball of t."""

    def sum_of(pairs: list[tuple[int, int]], constant: int) -> dict[int, F]:
        out = {unknown(i) + unknown(j): F(1) for i, j in pairs}
        return out | ({0: F(constant)} if constant else {})

    if motions:
        first, second = [(3, 3), (4, 4), (5, 5)], [(6, 6), (7, 7), (8, 8)]
        equations = [sum_of(first, -1), sum_of(second, -1), sum_of([(3, 6), (4, 7), (5, 8)], 0)]
        allowed = equations + [{m: -c for m, c in one.items()} for one in equations]
    else:
        allowed = [sum_of([(6 + k, 6 + k) for k in range(cameras.size)], -1)] if cameras.ball else []
    for p in stated.rows[rows:]:
        scale = F(2) ** p.exponent
        if {m: c * scale for m, c in p.terms.items() if c} not in allowed:
            raise Refused("a constraint follows from nothing that is assumed", "run")
