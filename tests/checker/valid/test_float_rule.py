"""The rule in float64 against the rule itself, for weights of every size."""

import random
from fractions import Fraction as F
from typing import Any

import numpy as np
import pytest

from cpcal.checker.rule import Unknowns, Weights
from cpcal.common.values import Floats
from cpcal.solver.certificate.float_rows import FloatRule, Parts, _lowest, _swept, rows_of
from cpcal.solver.certificate.prover import brief


def some_weights(rng: random.Random, rows: int, n: int, exponents: tuple[int, int, int]) -> Weights:
    def weight() -> int:
        return rng.randrange(1 << rng.randint(1, 53))

    pairs = [(rng.randrange(n), rng.randrange(n), rng.choice([-1, 1]), rng.choice([-1, 1]), weight()) for _ in "123"]
    squares = [(rng.randrange(n), F(rng.uniform(-1, 1)), weight()) for _ in "12"]
    return Weights(tuple((rng.randrange(rows), weight()) for _ in range(6)), tuple(pairs), tuple(squares), exponents)


def given_to(fast: FloatRule, weights: Weights) -> tuple[Parts, Floats]:
    """Weights as the rule in float64 takes them."""
    kinds = zip((weights.rows, weights.products, weights.tangents), weights.exponents, strict=True)
    with np.errstate(over="ignore"):
        values = [np.ldexp(np.array([float(e[-1]) for e in kind]), exponent) for kind, exponent in kinds]
    products = [(i, j, p, q) for i, j, p, q, _ in weights.products]
    squares = [(i, float(t)) for i, t, _ in weights.tangents]
    return fast.parts([n for n, _ in weights.rows], products, squares), np.concatenate(values)[None]


@pytest.mark.parametrize("name", ["exact_proof", "uncertain_proof", "gain_proof", "network_proof"])
def test_float64_never_claims_more_than_the_rule(name: str, request: pytest.FixtureRequest) -> None:
    """And it says how much of a bound it may have given away."""
    proof, rng = request.getfixturevalue(name), random.Random(name)
    problem, (lo, hi) = proof.problem, proof.bounds()
    rule, n = proof.rule(lo, hi, []), len(problem.unknowns)
    x = Unknowns(rule.x.box, rule.x.spend)
    table = rows_of(problem, x, [(rng.choice(problem.sides), rng.randrange(problem.count)) for _ in range(8)])
    rule = proof.rule(lo, hi, table)
    fast, compared = FloatRule(rule, problem, table), 0
    for _ in range(40):
        ends = rng.randint(-90, -40), rng.randint(-70, -40), rng.randint(-70, -40)
        weights = some_weights(rng, len(table), n, ends)
        (lowest,), _ = fast.lowest(*given_to(fast, weights))
        assert not lowest > 0 or rule.excludes(weights)
        for i in range(n):
            for side, sign in (("lo", 1), ("hi", -1)):
                (bound,), (rounding,) = fast.bounds(i, side, *given_to(fast, weights))
                exact = rule.bound(i, side, weights)
                assert sign * (exact - F(bound)) >= 0
                assert abs(exact - F(bound)) <= F(rounding)
                compared += 1
    assert compared == 80 * n


def test_numbers_beyond_float64_are_left_to_exact_arithmetic(exact_proof: Any) -> None:
    lo, hi = exact_proof.bounds()
    table = [("upper", 0, "0" * 7)]
    rule = exact_proof.rule(lo, hi, table)
    heavy = Weights(((0, 1 << 52),), (), (), (999, 0, 0))
    fast = FloatRule(rule, exact_proof.problem, table)
    assert fast.lowest(*given_to(fast, heavy))[0] == -float("inf")
    assert fast.bounds(0, "lo", *given_to(fast, heavy))[0] == -float("inf")


def test_products_of_rounded_numbers_are_as_near_as_their_errors_say() -> None:
    """A chain of products, and the sum of all, of numbers that are rounded as far as they can be."""
    rng, count = np.random.default_rng(3), 12
    notes = [(count, 0, 1)] + [(count + k, count + k - 1, k + 1) for k in range(1, count - 1)]
    notes += [(2 * count - 1, count + k, count + k) for k in range(count - 1)]
    table = np.array(notes, dtype=np.intp)
    given = rng.uniform(-2.0, 2.0, (20, count))
    nothing, places = np.zeros(0, np.intp), np.arange(count, 2 * count)
    found, errors = _swept(table, given, nothing, np.zeros(0), 2 * count, places)
    for row, values, error in zip(given, found, errors, strict=True):
        exact = [F(x) * (1 + F(int(rng.choice([-1, 1])), 2**53)) for x in row] + [F(0)] * count
        for k, i, j in notes:
            exact[k] += exact[i] * exact[j]
        for value, near, most in zip(exact[count:], values, error, strict=True):
            assert abs(value - F(near)) <= F(most) <= abs(value) * F(1, 10**13) + F(1, 10**14)


@pytest.mark.parametrize("down", [True, False])
def test_a_bound_with_few_digits_is_on_its_side_and_near(down: bool) -> None:
    rng = np.random.default_rng(4)
    for value, loss in zip(rng.normal(0.0, 100.0, 200), 10.0 ** rng.uniform(-12, 0, 200), strict=True):
        for exact in (F(value) / 3, value):
            near = F(brief(exact, down, loss))
            assert 0 <= (F(exact) - near if down else near - F(exact)) <= F(loss) + F(1, 10**12)


def test_a_sum_whose_terms_cancel_is_not_below_what_float64_says() -> None:
    rng, nothing = np.random.default_rng(6), np.zeros(1)
    for _ in range(100):
        half = rng.normal(size=30)
        values = np.concatenate([half, rng.normal(size=30) * 1e-12 - half])
        weights = rng.uniform(0.5, 2.0)
        start, columns = np.array([0, 60]), np.zeros(60, np.intp)
        given = start, columns, values, nothing, np.array([[weights]]), np.zeros(1, np.bool_), 0, 0.0
        (found,), (error,) = _lowest(*given)
        assert F(found) <= F(weights) * sum(map(F, values)) <= F(found) + 2 * F(error)
