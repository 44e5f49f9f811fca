"""The mathematics of the checker against an independent statement, in fractions at random points and readings."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from fractions import Fraction as F

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cpcal.checker.equation import Equation
from cpcal.checker.leg import Leg
from cpcal.checker.measurement import Measurement
from cpcal.checker.models import EXTRA, Model
from cpcal.checker.polynomial import ExactBox
from cpcal.checker.rule import Weights

Vector = list[F]
SIDES = ("upper", "lower")
REACH = {"plain": (), "gain": (0.5,), "lateral": (900.0,), "linear": (0.5, 0.5, 0.5, 0.5, 20.0, 20.0, 20.0)}


def rational(rng: random.Random, size: int) -> F:
    return F(rng.randint(-1000 * size, 1000 * size), 1000)


def hamilton(p: Vector, q: Vector) -> Vector:
    a, b, c, d = p
    e, f, g, h = q
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]


def parts(m: Measurement, model: str, x: Vector, reading: Vector) -> tuple[F, F]:
    """||v||^2 - h and L + e + l + t, with v and r through products of quaternions."""
    d, s, e = reading[:3], reading[3:6], reading[6]
    q = hamilton([F(1), *s], list(m.quaternion))
    norm = sum((c * c for c in q), F(0))
    turned = hamilton(hamilton(q, [F(0), *x[3:6]]), [q[0], -q[1], -q[2], -q[3]])[1:]
    v = [m.position[i] + d[i] + turned[i] / norm - x[i] for i in range(3)]
    square, length = sum((c * c for c in v), F(0)), m.length + e + x[6]
    if model == "lateral":
        square -= x[7]
    if model in ("gain", "linear"):
        length += x[7] * (m.length + e)
    if model == "linear":
        length += sum((x[8 + i] * (m.position[i] + d[i]) for i in range(3)), F(0))
        length += sum((x[11 + i] * 2 * q[0] * q[1 + i] / norm for i in range(3)), F(0))
    return square, length


def left_side(m: Measurement, model: str, side: str, x: Vector, reading: Vector) -> F:
    """(1 + s.s) (||v||^2 - h - (L + e + l + t + eps)^2), or its counterpart."""
    square, length = parts(m, model, x, reading)
    kappa = 1 + sum((c * c for c in reading[3:6]), F(0))
    return kappa * (square - (length + x[-1]) ** 2 if side == "upper" else (length - x[-1]) ** 2 - square)


def value(p: dict[tuple[int, ...], F], x: Vector) -> F:
    total = F(0)
    for monomial, c in p.items():
        for i in monomial:
            c *= x[i]
        total += c
    return total


def some(rng: random.Random, factor: int, model: str = "plain") -> tuple[Measurement, ExactBox]:
    """A measurement with reading sets `factor` times those of a sensor, and a box."""
    radii = [factor * F(rng.randint(0, 9), 100) for _ in range(3)]
    turns = [factor * F(rng.randint(0, 9), 10000) for _ in range(3)]
    quaternion = tuple(F(rng.randint(-9, 9)) for _ in range(3))
    m = Measurement(
        tuple(rational(rng, 300) for _ in range(3)),
        (F(rng.randint(1, 9)), *quaternion),
        F(rng.randint(300, 900)),
        tuple(radii),
        tuple(turns),
        factor * F(rng.randint(0, 9), 100),
    )
    extra = [c * rng.uniform(-1, 1) for c in REACH[model]]
    center = [*(rational(rng, 200) for _ in range(7)), *map(F, extra)]
    part = F(rng.choice([0, 1, 10, 1000]), 10)
    widths = [part] * 7 + [part * F(c) / 50 for c in REACH[model]]
    eps = F(rng.randint(0, 5))
    lo, hi = ([c + sign * w for c, w in zip(center, widths, strict=True)] for sign in (-1, 1))
    return m, ExactBox((*lo, eps), (*hi, eps + rng.randint(0, 3)))


def within(rng: random.Random, radius: F) -> F:
    return radius * (F(rng.randint(-8, 8), 8) if rng.random() < 0.5 else rng.choice([-1, 1]))


def point_of(rng: random.Random, box: ExactBox) -> Vector:
    return [c + within(rng, r) for c, r in zip(box.center, box.radius, strict=True)]


TINY = F(1, 10**9)


def derivative(m: Measurement, model: str, side: str, x: Vector, reading: Vector, j: int) -> F:
    """With respect to component j of the reading, by a central difference of exact numbers: to about 1e-10."""
    ends = []
    for sign in (-1, 1):
        moved = list(reading)
        moved[j] += sign * TINY
        ends.append(left_side(m, model, side, x, moved))
    return (ends[1] - ends[0]) / (2 * TINY)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("factor", [1, 100])
@pytest.mark.parametrize("model", EXTRA)
def test_rows_slopes_bends_and_penalties(model: str, side: str, factor: int) -> None:
    rng = random.Random(f"{side}{factor}")
    for _ in range(7):
        m, box = some(rng, factor, model)
        equation, radii = Equation(m, Model(model)), m.radii
        loose = equation.bends(side, box)
        chosen, penalty = equation.reference(side, box)
        assert all(abs(c) <= r for c, r in zip(chosen, radii, strict=True))
        assert penalty >= 0
        best = equation.inequality(side, chosen)
        for _ in range(5):
            x, reading = point_of(rng, box), [within(rng, r) for r in radii]
            here = left_side(m, model, side, x, reading)
            assert value(equation.inequality(side, tuple(reading)), x) == here
            assert here >= value(best, x) - penalty
            lengths = [parts(m, model, x, at)[1] for at in (reading, [F(0)] * 7)]
            assert abs(lengths[0] - lengths[1]) <= equation.spread(box)
            for j, (slope, bend) in enumerate(zip(equation.slopes(side), loose, strict=True)):
                middle = value(slope, x)
                assert abs(middle - derivative(m, model, side, x, [F(0)] * 7, j)) <= F(1, 10**8)
                assert abs(derivative(m, model, side, x, reading, j) - middle) <= bend + F(1, 10**8)


def root(square: F) -> F:
    """Nearly the square root."""
    return F(math.isqrt(int(square * 10**20)), 10**10)


@st.composite
def solutions(draw: st.DrawFn, model: str) -> tuple[Measurement, ExactBox, Vector, Vector]:
    """A measurement, a box, a point of it and a reading of the set with which the point is a solution, just about."""
    rng, factor = draw(st.randoms(use_true_random=False)), draw(st.sampled_from([0, 1, 10, 100]))
    m, box = some(rng, factor, model)
    x, reading = point_of(rng, box), [within(rng, r) for r in m.radii]
    square, length = parts(m, model, x, reading)
    assume(square > 0)
    off = rational(rng, 3)
    scale = 1 + (x[7] if model in ("gain", "linear") else 0)
    assume(scale > F(1, 10))
    m = replace(m, length=m.length + (root(square) + off - length) / scale)
    square, length = parts(m, model, x, reading)
    least, most = abs(root(square) - length) + F(1, 10**9), m.length - m.length_radius + x[6]
    assume(least <= most)
    part = draw(st.sampled_from([F(0), F(0), F(1, 1000), F(1, 2), F(1)]))
    x[-1] = least + part * (most - least)
    wide = draw(st.sampled_from([F(0), F(1), F(100)]))
    lo, hi = max(F(0), x[-1] - wide * F(rng.random())), x[-1] + wide * F(rng.random())
    return m, ExactBox((*box.lo[:-1], lo), (*box.hi[:-1], hi)), x, reading


@pytest.mark.parametrize("model", EXTRA)
def test_every_row_is_at_most_zero_at_every_solution(model: str) -> None:
    @given(solutions(model))
    @settings(max_examples=200)
    def check(found: tuple[Measurement, ExactBox, Vector, Vector]) -> None:
        m, box, x, reading = found
        square, length = parts(m, model, x, reading)
        assert max(F(0), length - x[-1]) ** 2 <= square <= (length + x[-1]) ** 2
        equation = Equation(m, Model(model))
        for side in (*SIDES, "length"):
            assert value(equation.row(side, box), x) <= 0
        problem = Leg(One(m), Model(model))
        assert not problem.fails(0, tuple(x))

    check()


@pytest.mark.parametrize("model", EXTRA)
def test_a_point_that_holds_has_a_reading(model: str) -> None:
    """Which is found between two ends of the set, by the formula of the model."""
    outcomes: set[bool] = set()

    @given(solutions(model), st.sampled_from([F(0), F(1, 100), F(-1, 100), F(-1)]))
    @settings(max_examples=200)
    def check(found: tuple[Measurement, ExactBox, Vector, Vector], more: F) -> None:
        m, _, x, reading = found
        x[-1] = x[-1] + more if more > -1 else F(0)
        equation, radii = Equation(m, Model(model)), m.radii
        holds = equation.holds(tuple(x))
        outcomes.add(holds)
        if not any(radii):
            square, length = parts(m, model, x, reading)
            near = x[-1] <= length and (length - x[-1]) ** 2 <= square <= (length + x[-1]) ** 2
            assert holds == (near and 0 <= x[-1] <= m.length + x[6])
        if not holds:
            return
        long = equation.lengthening(tuple(x))
        assert all(abs(c) <= r for c, r in zip(long, radii, strict=True))

        def over(place: F) -> F:
            return apart(m, model, x, [place * c for c in long]) - x[-1]

        low, high = F(-1), F(1)
        if over(high) > 0:
            while high - low > F(1, 10**12):
                middle = (low + high) / 2
                low, high = (low, middle) if over(middle) > 0 else (middle, high)
        assert abs(over(low if over(high) > 0 else high) + x[-1]) <= x[-1] + F(1, 10**6)

    check()
    assert outcomes == {True, False}


def held(model: str, length: int, radius: int, extra: F, eps: int, reach: int) -> tuple[Equation, Vector]:
    """A leg of that length between (reach, 0, 0) and the origin, known to `radius` along x, and the point x."""
    zero = F(0)
    m = Measurement(
        (F(reach), zero, zero), (F(1), zero, zero, zero), F(length), (F(radius), zero, zero), (zero,) * 3, zero
    )
    rest = [zero] * (len(REACH[model]) - 1)
    return Equation(m, Model(model)), [*[zero] * 7, extra, *rest, F(eps)]


@pytest.mark.parametrize("model", ["gain", "linear"])
def test_a_length_less_eps_that_is_negative(model: str) -> None:
    """The leg reads 100, which the gain makes 10; 99 more or less is zero, where U^2 alone would say no."""
    equation, x = held(model, 100, 0, F(-9, 10), 99, 0)
    box = ExactBox(tuple(x), tuple(x))
    assert value(equation.inequality("lower", [F(0)] * 7), x) == 89**2
    assert value(equation.row("lower", box), x) == 0
    wider = ExactBox((*x[:7], F(-1), *x[8:]), tuple(x))
    assert value(equation.row("lower", wider), x) == 89**2 - 99**2
    uncertain = Equation(replace(equation.measurement, length_radius=F(5)), equation.model)
    assert uncertain.slack(box) == F(179, 2)


@pytest.mark.parametrize("model", ["gain", "linear"])
def test_no_reading_makes_up_for_a_negative_length(model: str) -> None:
    """||v|| is 47 to 53, but the length is -50: both squares would fit."""
    equation, x = held(model, 100, 3, F(-3, 2), 1, 50)
    assert not equation.holds(tuple(x))
    equation, x = held(model, 100, 3, F(-1, 2), 1, 50)
    assert equation.holds(tuple(x))


def test_nor_for_a_vector_that_is_too_short() -> None:
    """||v|| is 30 to 50, and the length 30."""
    for h, good in ((2500, False), (1600, True)):
        equation, x = held("lateral", 30, 10, F(h), 0, 40)
        assert equation.holds(tuple(x)) == good


def test_the_lateral_offset_bends_with_the_rotation() -> None:
    """Where all else is zero, Q is -(1 + s.s) h."""
    zero = F(0)
    m = Measurement((zero,) * 3, (F(1), zero, zero, zero), zero, (zero,) * 3, (F(1, 100),) * 3, zero)
    x = (*[zero] * 7, F(900), zero)
    bends = Equation(m, Model("lateral")).bends("upper", ExactBox(x, x))
    assert bends[3:6] == [2 * F(1, 200) * 900] * 3


@pytest.mark.parametrize("model", EXTRA)
def test_slopes_and_bends_of_the_length(model: str) -> None:
    rng = random.Random(model)
    for _ in range(20):
        m, box = some(rng, 100, model)
        slopes, bends = Model(model).length_slopes(m), Model(model).length_bends(m, box)
        x, reading = point_of(rng, box), [within(rng, r) for r in m.radii]
        for j in range(7):
            there, here = (
                (parts(m, model, x, up)[1] - parts(m, model, x, down)[1]) / (2 * TINY)
                for up, down in (
                    [[c + sign * TINY * (i == j) for i, c in enumerate(at)] for sign in (1, -1)]
                    for at in (reading, [F(0)] * 7)
                )
            )
            assert abs(value(slopes[j], x) - here) <= F(1, 10**12)
            assert abs(there - here) <= bends[j] + F(1, 10**12)


@pytest.mark.parametrize("model", EXTRA)
def test_the_ends_tried_are_those_that_matter(model: str) -> None:
    """No other end makes a leg longer, compared to what it is read."""
    rng = random.Random(model)
    for _ in range(20):
        m, box = some(rng, 1, model)
        x = point_of(rng, box)
        long = Equation(m, Model(model)).lengthening(tuple(x))
        most = apart(m, model, x, long)
        for j in range(7):
            other = [-c if i == j else c for i, c in enumerate(long)]
            assert apart(m, model, x, other) <= most + F(1, 1000)


def apart(m: Measurement, model: str, x: Vector, reading: Vector) -> F:
    square, length = parts(m, model, x, reading)
    assert square >= 0
    return root(square) - length


class One:
    """A campaign of one measurement."""

    def __init__(self, m: Measurement) -> None:
        self._m = m

    def __len__(self) -> int:
        return 1

    def measurement(self, k: int) -> Measurement:
        return self._m


@pytest.mark.parametrize("model", EXTRA)
def test_exact_readings_have_no_penalty(model: str) -> None:
    rng = random.Random(5)
    for side in SIDES:
        m, box = some(rng, 0, model)
        assert Equation(m, Model(model)).reference(side, box) == ((F(0),) * 7, F(0))


@pytest.mark.parametrize("model", EXTRA)
def test_length_rows_know_nothing_of_corrections(model: str) -> None:
    m, box = some(random.Random(6), 1, model)
    x = [F(i + 1) for i in range(len(box.lo))]
    assert value(Equation(m, Model(model)).row("length", box), x) == x[-1] - x[6] - (m.length - m.length_radius)


@pytest.mark.parametrize("name", ["exact_proof", "uncertain_proof", "network_proof"])
def test_no_solution_lies_beyond_a_bound(name: str, request: pytest.FixtureRequest) -> None:
    """The rule's sum is at most zero at the known best point, whatever the weights."""
    proof, rng = request.getfixturevalue(name), random.Random(8)
    rule, problem = proof.rule(*proof.bounds()), proof.problem
    x, box, n = [F(v) for v in proof.point], rule.box, len(problem.unknowns)
    u = [(v - c) / r for v, c, r in zip(x, box.center, box.radius, strict=True)]
    assert all(abs(v) <= 1 for v in u)

    def weight() -> int:
        return rng.randrange(1 << rng.randint(1, 60))

    for _ in range(6):
        rows = [(rng.choice(problem.sides), rng.randrange(problem.count), weight()) for _ in range(9)]
        pairs = [
            (rng.randrange(n), rng.randrange(n), rng.choice([-1, 1]), rng.choice([-1, 1]), weight()) for _ in "12345"
        ]
        squares = [(rng.randrange(n), F(rng.uniform(-1, 1)), weight()) for _ in range(3)]
        exponents = rng.randint(-70, 5), rng.randint(-70, 5), rng.randint(-70, 5)
        weights = Weights(tuple(rows), tuple(pairs), tuple(squares), exponents)
        aggregate, factor = rule.aggregate(weights)
        assert factor > 0
        assert value(aggregate, u) <= 0
        direct = sum((w * value(rule.row(side, k), u) * F(2) ** exponents[0] for side, k, w in rows), F(0))
        direct -= sum((w * (1 + p * u[i]) * (1 + q * u[j]) * F(2) ** exponents[1] for i, j, p, q, w in pairs), F(0))
        direct -= sum((w * (u[i] - t) ** 2 * F(2) ** exponents[2] for i, t, w in squares), F(0))
        assert value(aggregate, u) == factor * direct
        assert not rule.excludes(weights)
        for i in range(n):
            assert rule.bound(i, "lo", weights) <= x[i] <= rule.bound(i, "hi", weights)
