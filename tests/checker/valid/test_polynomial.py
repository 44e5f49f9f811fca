"""Polynomials of the checker up to degree 4, and stated constraints, against direct evaluation."""

import random
from fractions import Fraction as F

import pytest

from cpcal.checker.certificate import polynomial
from cpcal.checker.polynomial import FIELD, Polynomial, combined, constant, least, signed, substituted
from cpcal.checker.readers import Refused
from cpcal.checker.rule import SIDES, Box, Problem, Unknowns
from cpcal.solver.certificate.exact_network import Stated, free
from cpcal.solver.certificate.float_rows import failing, holding
from tests.checker.valid.exact_legs import value

UNKNOWNS = 4
Given = dict[tuple[int, ...], F]


def some(rng: random.Random, degree: int = 4) -> Given:
    p: Given = {(): fraction(rng)} if rng.random() < 0.8 else {}
    for _ in range(rng.randint(0, 9)):
        p[tuple(sorted(rng.choices(range(UNKNOWNS), k=rng.randint(1, degree))))] = fraction(rng)
    return p


def fraction(rng: random.Random, size: int = 9) -> F:
    return F(rng.randint(-1024 * size, 1024 * size), 1024)


def box_of(rng: random.Random) -> Box:
    centers = [rng.choice([F(0), fraction(rng)]) for _ in range(UNKNOWNS)]
    radii = [rng.choice([F(0), F(1), abs(fraction(rng))]) for _ in range(UNKNOWNS)]
    lo, hi = (tuple(c + s * r for c, r in zip(centers, radii, strict=True)) for s in (-1, 1))
    return Box(lo, hi)


def direct(p: Given, x: list[F]) -> F:
    total = F(0)
    for monomial, c in p.items():
        term = F(c)
        for i in monomial:
            term *= x[i]
        total += term
    return total


def unit(rng: random.Random) -> list[F]:
    return [rng.choice([F(-1), F(0), F(1), F(rng.randint(-8, 8), 8)]) for _ in range(UNKNOWNS)]


def inside(x: Unknowns, u: list[F]) -> list[F]:
    return [x.center(i) + x.radius(i) * v for i, v in enumerate(u)]


@pytest.mark.parametrize("seed", range(40))
def test_values_substitutions_sums_products_and_bounds(seed: int) -> None:
    rng = random.Random(seed)
    p, q, x = some(rng), some(rng), Unknowns(box_of(rng), free)
    one, two = (substituted(polynomial(tuple(given.items()), free), x.images) for given in (p, q))
    total, product = combined([(3, one), (-2, two), (0, two)], free), one * two
    for u in [unit(rng) for _ in range(12)]:
        at = inside(x, u)
        here, there = direct(p, at), direct(q, at)
        assert value(one, u) == here
        assert value(total, u) == 3 * here - 2 * there
        assert value(product, u) == here * there
        assert value(one + two, u) == here + there
        assert value(one - two, u) == here - there
        assert value(one.times(-3, 5), u) == -96 * here
        assert least(one, signed(UNKNOWNS)) <= here
    assert one.constant == direct(p, inside(x, [F(0)] * UNKNOWNS))


def test_a_reading_at_an_end_is_never_negative() -> None:
    """One at the centre may be."""
    y = Polynomial({1: 2, 1 << FIELD: -3}, 0, free)
    assert least(y, signed(0, "+-")) == -3
    assert least(y, signed(0, "0-")) == -5


def test_degrees_do_not_run_into_each_other() -> None:
    """Of the highest degree that a row can have: a bound of degree 8, squared."""
    x = Unknowns(Box((F(-3),), (F(5),)), free)
    p = substituted(polynomial((((0,) * 8, F(1)),), free), x.images)
    assert value(p * p, [F(1)]) == 5**16
    assert value(p * p, [F(-1)]) == 3**16


def test_what_is_too_large_is_not_calculated() -> None:
    long = constant(F(2) ** 3000 + 1, free)
    with pytest.raises(Refused, match="bits"):
        long * long
    with pytest.raises(Refused, match="bits"):
        constant(F(1, 2**5000), free) + constant(F(1), free)
    wide = Polynomial({1 << FIELD * i: 1 for i in range(400)}, 0, free)
    with pytest.raises(Refused, match="terms"):
        wide * wide * wide
    spent: list[int] = []
    p = Polynomial(dict.fromkeys(range(50), 1), 0, spent.append)
    p * p
    assert spent == [50 + 3 * 2500]


def satisfied(c: Stated, x: list[F]) -> bool:
    """With square roots compared in the way of the definition, by bisection of nothing: squares and signs."""
    body = direct(dict(c.body), x)
    if c.root and body < 0:
        return False
    for bound, sign in ((c.at_least, 1), (c.at_most, -1)):
        if bound is None:
            continue
        b = direct(dict(bound), x)
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
    p = some(rng)
    if root and rng.random() < 0.7:
        p = {}
        for m, c in some(rng, 2).items():
            key = tuple(sorted(m + m))
            p[key] = p.get(key, F(0)) + c * c
    low, high = (None if rng.random() < 0.3 else some(rng, 1) for _ in "12")
    if high is not None and rng.random() < 0.7:
        high[()] = high.get((), F(0)) + 20
    parts = (None if given is None else tuple(given.items()) for given in (low, high))
    stated = Stated("c", root, tuple(p.items()), *parts)
    problem, x = (
        Problem(("a", "b", "c", "d"), None, 1, (0,), lambda _, at, *__: stated.constraint().on(at.images)),
        Unknowns(box_of(rng), free),
    )
    for _ in range(25):
        u = unit(rng)
        at = inside(x, u)
        good, point = satisfied(stated, at), Unknowns(Box(tuple(at), tuple(at)), free)
        assert (holding(problem, point, 0) is not None) == good
        assert (failing(problem, point, 0) is not None) != good
        if good:
            assert all(value(problem.row(x, side, 0, ""), u) <= 0 for side in SIDES)


def test_a_point_on_the_boundary_holds_and_is_not_proved_to_fail() -> None:
    """x <= 1 at 1, above it and below it."""
    item = Stated("x", False, (((0,), F(1)),), None, (((), F(1)),)).constraint()
    problem = Problem(("x",), None, 1, (0,), lambda k, x, *_: item.on(x.images))
    for value_, holds, fails in ((F(1), True, False), (F(1, 2), True, False), (1 + F(1, 1 << 60), False, True)):
        x = Unknowns(Box((value_,), (value_,)), free)
        assert (problem.unproved(x, [(0, "")]) is None) is holds
        assert problem.fails(x, "upper", 0, "") is fails
