"""The mathematics of the checker against an independent statement, in fractions at random points and readings."""

import math
import os
import random
from fractions import Fraction as F
from itertools import product
from operator import mul

import pytest
from hypothesis import assume, given, seed, settings
from hypothesis import strategies as st

from cpcal.checker.leg import EXTRA, LegConstraint, formed, leg_formula
from cpcal.checker.polynomial import FIELD, READINGS, Polynomial, constant, signed
from cpcal.checker.rule import Box as ExactBox
from cpcal.checker.rule import Problem, Unknowns, Weights, beyond
from cpcal.solver.certificate.exact_network import free
from cpcal.solver.certificate.float_rows import failing, holding, rows_of, stretchings
from tests.checker.proofs import all_readings
from tests.checker.valid.exact_legs import (
    REACH,
    SIDES,
    Exact,
    Vector,
    center,
    coordinates,
    drawn,
    left_side,
    leg,
    parts,
    point_of,
    radius,
    rational,
    some,
    taken,
    unknowns,
    value,
    within,
)

EXAMPLES = int(os.environ.get("CPCAL_EXAMPLES", "25"))  # of a model, in each property


def unsettled(one: LegConstraint, side: str) -> Polynomial:
    """The row with its readings, from what its trace computes."""
    names = (side,) if side == "upper" or one.sure else (side, "at_least", "factor")
    formula = leg_formula(one.model, one.m.uncertain, names)
    ((numbers, unit, _),) = formed([one], formula)
    row, *others = (
        Polynomial({m: next(iter(numbers[k])) for m, k in places.items()}, -unit * degree, free)
        for places, degree in formula.parts
    )
    mask = signed(len(one.x), one.signs)
    return row - constant(beyond(others[0], others[1], mask), free) if others else row


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("factor", [1, 100])
@pytest.mark.parametrize("model", EXTRA)
def test_rows_are_the_formula_and_penalties_cover_the_set(model: str, side: str, factor: int) -> None:
    """Before the readings are settled a row is the inequality itself, whatever the reference; after it, never more."""
    rng = random.Random(f"{side}{factor}")
    for _ in range(3):
        m, box = some(rng, factor, model)
        problem, x = leg(m, model), unknowns(box)
        ends = "".join(rng.choice("-0+") for _ in range(7))
        for signs in (rows_of(problem, x, [(side, 0)])[0][2], ends, "0" * 7):
            row = unsettled(LegConstraint(m.given(), model, x, signs), side)
            settled = problem.row(x, side, 0, signs)
            assert all(monomial >> FIELD * READINGS or not monomial for monomial in settled.terms)
            for _ in range(3):
                point, y = point_of(rng, box), [drawn(rng, sign) for sign in signs]
                reading = [taken(r, sign, v) for r, sign, v in zip(m.radii, signs, y, strict=True)]
                assert all(abs(c) <= r for c, r in zip(reading, m.radii, strict=True))
                u = coordinates(box, point)
                here = left_side(m, model, side, point, reading)
                slack = here - value(row, u, y)  # of a length that may be negative
                assert slack == 0 if side == "upper" or model in ("plain", "lateral") else slack >= 0
                assert value(row, u, y) >= value(settled, u)


def root(square: F) -> F:
    """Nearly the square root."""
    return F(math.isqrt(int(square * 2**64)), 2**32)


def dyadic(value_: F) -> F:
    return F(round(value_ * 2**32), 2**32)


@st.composite
def solutions(draw: st.DrawFn, model: str) -> tuple[Exact, ExactBox, Vector, Vector]:
    """A measurement, a box, a point of it and a reading of the set with which the point is a solution, just about."""
    rng, factor = draw(st.randoms(use_true_random=False)), draw(st.sampled_from([0, 1, 10, 100]))
    m, box = some(rng, factor, model)
    x, reading = point_of(rng, box), [within(rng, r) for r in m.radii]
    square, length = parts(m, model, x, reading)
    assume(square > 0)
    off = rational(rng, 3)
    scale = 1 + (x[7] if model == "gain" else 0)
    assume(scale > F(1, 10))
    m = m._replace(length=m.length + dyadic((root(square) + off - length) / scale))
    square, length = parts(m, model, x, reading)
    least, most = abs(root(square) - length) + F(1, 1 << 30), m.length - m.radii[6] + x[6]
    assume(least <= most)
    part = draw(st.sampled_from([F(0), F(0), F(1, 1024), F(1, 2), F(1)]))
    x[-1] = F(math.ceil((least + part * (most - least)) * 2**31), 2**31)
    assume(x[-1] <= most)
    wide = draw(st.sampled_from([F(0), F(1), F(100)]))
    lo, hi = max(F(0), x[-1] - wide * F(rng.random())), x[-1] + wide * F(rng.random())
    return m, ExactBox((*box.lo[:-1], lo), (*box.hi[:-1], hi)), x, reading


@pytest.mark.parametrize("model", EXTRA)
def test_every_row_is_at_most_zero_at_every_solution(model: str) -> None:
    @given(solutions(model))
    @settings(max_examples=EXAMPLES // 2)
    def check(found: tuple[Exact, ExactBox, Vector, Vector]) -> None:
        m, box, x, reading = found
        square, length = parts(m, model, x, reading)
        assert max(F(0), length - x[-1]) ** 2 <= square <= (length + x[-1]) ** 2
        problem, over = leg(m, model), unknowns(box)
        rng = random.Random(str(x[0]))
        for side in problem.sides:
            for signs in (rows_of(problem, over, [(side, 0)])[0][2], "".join(rng.choice("-0+") for _ in range(7))):
                assert value(problem.row(over, side, 0, signs), coordinates(box, x)) <= 0
        assert failing(problem, unknowns(ExactBox(tuple(x), tuple(x))), 0) is None

    check()


@pytest.mark.parametrize("model", EXTRA)
def test_a_point_that_holds_has_a_reading(model: str) -> None:
    """Which is found between two ends of the set, by the formula of the model."""
    outcomes: set[bool] = set()

    @given(solutions(model), st.sampled_from([F(0), F(1, 128), F(-1, 128), F(-1)]))
    @settings(max_examples=EXAMPLES, database=None)
    def check(found: tuple[Exact, ExactBox, Vector, Vector], more: F) -> None:
        m, _, x, reading = found
        x[-1] = x[-1] + more if more > -1 else F(0)
        problem, at = leg(m, model), unknowns(ExactBox(tuple(x), tuple(x)))
        signs = stretchings(problem, at, [0])[0]
        holds = holding(problem, at, 0) is not None
        outcomes.add(holds)
        if not any(m.radii):
            square, length = parts(m, model, x, reading)
            far = length <= x[-1] or (length - x[-1]) ** 2 <= square
            near = far and length >= -x[-1] and square <= (length + x[-1]) ** 2
            assert holds == (near and 0 <= x[-1] <= m.length + x[6])
        if not holds:
            return
        long = [r * {"-": -1, "0": 0, "+": 1}[sign] for r, sign in zip(m.radii, signs, strict=True)]

        def over(place: F) -> F:
            return apart(m, model, x, [place * c for c in long]) - x[-1]

        low, high = F(-1), F(1)
        if over(high) > 0:
            while high - low > F(1, 10**9):
                middle = (low + high) / 2
                low, high = (low, middle) if over(middle) > 0 else (middle, high)
        assert abs(over(low if over(high) > 0 else high) + x[-1]) <= x[-1] + F(1, 10**6)

    for start in range(8):  # until both outcomes are among them
        seed(start)(check)()
        if len(outcomes) == 2:
            break
    assert outcomes == {True, False}


Held = tuple[Exact, Problem, Unknowns, Vector]


def held(model: str, length: int, radius_: int, extra: F, eps: int, reach: int, of_length: int = 0) -> Held:
    """A leg of that length between (reach, 0, 0) and the origin, known to `radius` along x, at a point x."""
    zero = F(0)
    radii = (F(radius_), *(zero,) * 5, F(of_length))
    m = Exact((F(reach), zero, zero), (F(1), zero, zero, zero), F(length), radii)
    rest = [zero] * (len(REACH[model]) - 1)
    x = [*[zero] * 7, extra, *rest, F(eps)]
    return m, leg(m, model), unknowns(ExactBox(tuple(x), tuple(x))), x


def test_a_length_less_eps_that_is_negative() -> None:
    """The leg reads 128, which the gain makes 16; 99 more or less is zero, where U^2 alone would say no."""
    m, problem, at, x = held("gain", 128, 0, F(-7, 8), 99, 0)
    assert left_side(m, "gain", "lower", x, [F(0)] * 7) == 83**2
    assert value(problem.row(at, "lower", 0, "0" * 7), [F(0)] * len(x)) == 0
    wider = ExactBox((*x[:7], F(-1), *x[8:]), tuple(x))
    u = coordinates(wider, x)
    assert value(problem.row(unknowns(wider), "lower", 0, "0" * 7), u) == 83**2 - 99**2


def test_no_reading_makes_up_for_a_negative_length() -> None:
    """||v|| is 47 to 53, but the length is -50: both squares would fit."""
    for extra, good in ((F(-3, 2), False), (F(-1, 2), True)):
        _, problem, at, _ = held("gain", 100, 3, extra, 1, 50)
        assert (holding(problem, at, 0) is not None) == good
        assert (problem.unproved(at, [(0, "+000000")]) is None) == good


def test_nor_for_a_vector_that_is_too_short() -> None:
    """||v|| is 30 to 50, and the length 30."""
    for h, good in ((2500, False), (1600, True)):
        _, problem, at, _ = held("lateral", 30, 10, F(h), 0, 40)
        assert (holding(problem, at, 0) is not None) == good


@pytest.mark.parametrize("model", EXTRA)
def test_an_eps_below_zero_holds_nowhere(model: str) -> None:
    """The two ends would prove what lies between them, but then nothing does."""
    m, problem, _, x = held(model, 50, 8, F(0), 0, 50) if model != "plain" else held("gain", 50, 8, F(0), 0, 50)
    for eps in (F(0), F(-1, 4)):
        point = (*x[:-1], eps)
        assert (problem.unproved(unknowns(ExactBox(point, point)), [(0, "+000000")]) is None) == (eps == 0)
    assert m.radii[0] == 8


def apart(m: Exact, model: str, x: Vector, reading: Vector) -> F:
    square, length = parts(m, model, x, reading)
    assert square >= 0
    return root(square) - length


@pytest.mark.parametrize("model", EXTRA)
def test_length_rows_know_nothing_of_corrections(model: str) -> None:
    m, box = some(random.Random(6), 1, model)
    x = point_of(random.Random(7), box)
    row = leg(m, model).row(unknowns(box), "length", 0, "0" * 7)
    assert value(row, coordinates(box, x)) == x[-1] - x[6] - (m.length - m.radii[6])


@pytest.mark.parametrize("name", ["exact_proof", "uncertain_proof", "network_proof"])
def test_no_solution_lies_beyond_a_bound(name: str, request: pytest.FixtureRequest) -> None:
    """The rule's sum is at most zero at the known best point, whatever the weights."""
    proof, rng = request.getfixturevalue(name), random.Random(8)
    problem = proof.problem
    lo, hi = (tuple(map(F, side)) for side in proof.bounds())
    box, x, n = ExactBox(lo, hi), [F(v) for v in proof.point], len(problem.unknowns)
    u = [(v - c) / r for v, c, r in zip(x, center(box), radius(box), strict=True)]
    assert all(abs(v) <= 1 for v in u)
    table = [
        one
        for _ in range(9)
        for one in rows_of(problem, unknowns(box), [(rng.choice(problem.sides), rng.randrange(problem.count))])
    ]
    rule = proof.rule(lo, hi, table)

    def weight() -> int:
        return rng.randrange(1 << rng.randint(1, 60))

    nothing = Weights((), (), (), (0, 0, 0))  # then a bound is that of the box
    for more in (0, 3):
        ends = [v - more for v in lo], [v + more for v in hi]
        of_box = proof.rule(*map(tuple, ends), [])
        assert [of_box.bound(i, side, nothing) for side in ("lo", "hi") for i in range(n)] == [*ends[0], *ends[1]]
    for _ in range(6):
        rows = [(rng.randrange(len(table)), weight()) for _ in range(9)]
        pairs = [
            (rng.randrange(n), rng.randrange(n), rng.choice([-1, 1]), rng.choice([-1, 1]), weight()) for _ in "12345"
        ]
        squares = [(rng.randrange(n), F(rng.uniform(-1, 1)), weight()) for _ in range(3)]
        exponents = rng.randint(-70, 5), rng.randint(-70, 5), rng.randint(-70, 5)
        weights = Weights(tuple(rows), tuple(pairs), tuple(squares), exponents)
        aggregate = rule.aggregate(weights)
        assert value(aggregate, u) <= 0
        direct = sum((w * value(rule.row[k], u) * F(2) ** exponents[0] for k, w in rows), F(0))
        direct -= sum((w * (1 + p * u[i]) * (1 + q * u[j]) * F(2) ** exponents[1] for i, j, p, q, w in pairs), F(0))
        direct -= sum((w * (u[i] - t) ** 2 * F(2) ** exponents[2] for i, t, w in squares), F(0))
        assert value(aggregate, u) == direct
        assert not rule.excludes(weights)
        for i in range(n):
            assert rule.bound(i, "lo", weights) <= x[i] <= rule.bound(i, "hi", weights)


@pytest.mark.parametrize("factor", [F(1), F(1, 2), F(0)])
@pytest.mark.parametrize("model", EXTRA)
def test_what_holds_for_all_readings_holds_for_each_and_eps_is_the_least(model: str, factor: F) -> None:
    """At every corner and inside, with the leg's own formula; a little less is refused, and some reading needs it. In
    wide sets a leg may be longest at another end than where it grows from the middle."""
    rng = random.Random(f"all {model}")
    for wide in (3, 3, 3, 100, 100, 100, 100, 100):
        m, box = some(rng, wide, model)
        x = point_of(rng, box)
        square, length = parts(m, model, x, [F(0)] * 7)
        x[6] += root(square) - length + rng.choice([-2, -1, 1, 2])  # off by some mm
        least = all_readings(leg(m, model), [float(v) for v in x[:-1]]).least_eps(float(factor))
        assert math.isfinite(least) or wide > 3
        eps, x = F(least if math.isfinite(least) else 250.0), [F(float(v)) for v in x]

        def holds(eps: F, factor: F = factor, m: Exact = m, x: Vector = x) -> bool:
            at = unknowns(ExactBox((*x[:-1], eps), (*x[:-1], eps)))
            return leg(m, model).unproved(at, [(0, "0" * 7)], factor) is None

        radii = [factor * r for r in m.radii]
        readings = [[*map(mul, radii, signs)] for signs in product((-1, 1), repeat=7)]
        readings += [[within(rng, r) for r in radii] for _ in range(20)]
        worst = max(abs(apart(m, model, x, reading)) for reading in readings)
        assert not holds(dyadic(worst) - F(1, 1 << 20))
        if holds(eps):
            assert not holds(eps * (1 - F(1, 1 << 20)))
            assert worst <= eps + F(1, 10**6)
            assert wide > 3 or eps * (1 - F(1, 1000)) <= worst
            assert not factor or not any(m.radii) or not holds(eps, factor=factor * F(9, 8))
        else:
            assert eps == 250
