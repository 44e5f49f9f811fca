"""Polynomials of the checker up to degree 4, and constraints, against direct evaluation."""

from __future__ import annotations

import random
from fractions import Fraction as F
from typing import Any

import flint
import pytest

from cpcal.checker.constraints import Constraint, Constraints
from cpcal.checker.polynomial import ExactBox, Polynomial, combined, least, shifted, span, square, value

UNKNOWNS = 4


def some(rng: random.Random, degree: int = 4) -> Polynomial:
    p: Polynomial = {(): fraction(rng)} if rng.random() < 0.8 else {}
    for _ in range(rng.randint(0, 9)):
        p[tuple(sorted(rng.choices(range(UNKNOWNS), k=rng.randint(1, degree))))] = fraction(rng)
    return p


def fraction(rng: random.Random, size: int = 9) -> F:
    return F(rng.randint(-1000 * size, 1000 * size), 1000)


def box_of(rng: random.Random) -> ExactBox:
    centers = [rng.choice([F(0), fraction(rng)]) for _ in range(UNKNOWNS)]
    radii = [rng.choice([F(0), F(1), abs(fraction(rng))]) for _ in range(UNKNOWNS)]
    lo, hi = (tuple(c + s * r for c, r in zip(centers, radii, strict=True)) for s in (-1, 1))
    return ExactBox(lo, hi)


def direct(p: Polynomial, x: list[F]) -> F:
    total = F(0)
    for monomial, c in p.items():
        term = F(c)
        for i in monomial:
            term *= x[i]
        total += term
    return total


def unit(rng: random.Random) -> list[F]:
    return [rng.choice([F(-1), F(0), F(1), F(rng.randint(-8, 8), 8)]) for _ in range(UNKNOWNS)]


def inside(box: ExactBox, u: list[F]) -> list[F]:
    return [c + r * t for c, r, t in zip(box.center, box.radius, u, strict=True)]


@pytest.mark.parametrize("seed", range(40))
def test_values_shifts_sums_squares_and_bounds(seed: int) -> None:
    rng = random.Random(seed)
    p, q, box = some(rng), some(rng), box_of(rng)
    moved, total, squared = shifted(p, box), combined((3, p), (-2, q), (0, q)), square(p)
    middle, radius = span(moved)
    corners = [unit(rng) for _ in range(12)]
    for u in corners:
        x = inside(box, u)
        here = direct(p, x)
        assert value(p, x) == here
        assert value(moved, u) == here
        assert value(total, x) == 3 * here - 2 * direct(q, x)
        assert value(squared, x) == here * here
        assert least(moved) <= here
        assert abs(here - middle) <= radius
    assert all(m == tuple(sorted(m)) for each in (moved, total, squared) for m in each)


def test_least_is_attained_where_monomials_do_not_compete() -> None:
    assert least({(): F(5), (0, 0): F(2), (1, 1): F(-3), (2,): F(1), (0, 1): F(0)}) == 5 - 3 - 1
    assert least({(0, 0, 1, 1): F(-2)}) == -2
    assert least({(0, 0, 1, 1): F(2)}) == 0
    assert least({(0, 0, 0): F(2)}) == -2  # a cube can be negative
    assert least({(0, 0, 0, 1): F(2)}) == -2
    assert least({(0, 0, 0, 0): F(2)}) == 0
    assert least({}) == 0


@pytest.mark.parametrize("seed", range(5))
def test_the_same_with_other_numbers(seed: int) -> None:
    rng = random.Random(seed)
    p, box, u = some(rng), box_of(rng), unit(rng)

    def other(v: F) -> Any:
        return flint.fmpq(v.numerator, v.denominator)

    q: Polynomial = {m: other(c) for m, c in p.items()}
    same = ExactBox(tuple(map(other, box.lo)), tuple(map(other, box.hi)))
    for ours, theirs in (
        (value(p, u), value(q, list(map(other, u)))),
        (least(shifted(p, box)), least(shifted(q, same))),
        (direct(square(p), u), direct(square({m: F(str(c)) for m, c in q.items()}), u)),
    ):
        assert F(str(theirs)) == ours


def satisfied(c: Constraint, x: list[F]) -> bool:
    """With square roots compared in the way of the definition, by bisection of nothing: squares and signs."""
    body = direct(c.body, x)
    if c.root and body < 0:
        return False
    for bound, sign in ((c.at_least, 1), (c.at_most, -1)):
        if bound is None:
            continue
        b = direct(bound, x)
        if not c.root:
            if sign * (body - b) < 0:
                return False
            continue
        root_is_larger = b < 0 or body > b * b
        if (sign == 1 and not root_is_larger and body != b * b) or (sign == -1 and root_is_larger):
            return False
    return True


@pytest.mark.parametrize("root", [False, True])
@pytest.mark.parametrize("seed", range(25))
def test_rows_are_not_positive_at_solutions(seed: int, root: bool) -> None:
    rng = random.Random(f"{seed}{root}")
    p = square(some(rng, 2)) if root and rng.random() < 0.7 else some(rng)
    low, high = (None if rng.random() < 0.3 else some(rng, 1) for _ in "12")
    if high is not None and rng.random() < 0.7:
        high[()] = high.get((), F(0)) + 20
    c = Constraint("c", root, p, low, high)
    problem, box = Constraints(("a", "b", "c", "d"), None, (c,)), box_of(rng)
    for _ in range(25):
        x = inside(box, unit(rng))
        good = satisfied(c, x)
        assert problem.holds(0, tuple(x)) == good
        assert problem.fails(0, tuple(x)) != good
        if good:
            assert all(direct(problem.row(side, 0, box), x) <= 0 for side in problem.sides)
        elif not root:
            assert any(direct(problem.row(side, 0, box), x) > 0 for side in problem.sides)
