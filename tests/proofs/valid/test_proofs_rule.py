"""The mathematics of the checker against an independent statement, in fractions at random points and readings."""

from __future__ import annotations

import random
from fractions import Fraction as F

import pytest

from cpcal.proof.leg import largest_sizes, reference
from cpcal.proof.measurement import Measurement, bends, inequality, slopes
from cpcal.proof.polynomial import ExactBox
from cpcal.proof.rule import Weights

Vector = list[F]
SIDES = ("upper", "lower")


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


def left_side(m: Measurement, side: str, x: Vector, reading: Vector) -> F:
    """(1 + s.s) (||v||^2 - (L + e + l + eps)^2), or its counterpart, with v through products of quaternions."""
    d, s, e = reading[:3], reading[3:6], reading[6]
    q = hamilton([F(1), *s], list(m.quaternion))
    norm = sum((c * c for c in q), F(0))
    turned = hamilton(hamilton(q, [F(0), *x[3:6]]), [q[0], -q[1], -q[2], -q[3]])[1:]
    v = [m.position[i] + d[i] + turned[i] / norm - x[i] for i in range(3)]
    square, kappa, base = sum((c * c for c in v), F(0)), 1 + sum((c * c for c in s), F(0)), m.length + e + x[6]
    return kappa * (square - (base + x[7]) ** 2 if side == "upper" else (base - x[7]) ** 2 - square)


def value(p: dict[tuple[int, ...], F], x: Vector) -> F:
    total = F(0)
    for monomial, c in p.items():
        for i in monomial:
            c *= x[i]
        total += c
    return total


def some(rng: random.Random, factor: int) -> tuple[Measurement, ExactBox]:
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
    center, width = [rational(rng, 200) for _ in range(7)], F(rng.choice([0, 1, 10, 1000]), 10)
    eps = F(rng.randint(0, 5))
    lo, hi = [c - width for c in center], [c + width for c in center]
    return m, ExactBox((*lo, eps), (*hi, eps + rng.randint(0, 3)))


def within(rng: random.Random, radius: F) -> F:
    return radius * (F(rng.randint(-8, 8), 8) if rng.random() < 0.5 else rng.choice([-1, 1]))


def radii_of(m: Measurement) -> Vector:
    return [*m.position_radius, *(r / 2 for r in m.rotation_radius), m.length_radius]


def point_of(rng: random.Random, box: ExactBox) -> Vector:
    return [c + within(rng, r) for c, r in zip(box.center, box.radius, strict=True)]


def derivative(m: Measurement, side: str, x: Vector, reading: Vector, j: int) -> F:
    """Exact: along a component the left side is a polynomial of degree 4 at most, which five values determine."""
    f = []
    for h in (-2, -1, 1, 2):
        moved = list(reading)
        moved[j] += h
        f.append(left_side(m, side, x, moved))
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / 12


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("factor", [1, 100])
def test_rows_slopes_bends_and_penalties(side: str, factor: int) -> None:
    rng = random.Random(f"{side}{factor}")
    for _ in range(7):
        m, box = some(rng, factor)
        radii = radii_of(m)
        loose = bends(m, largest_sizes(m, box))
        chosen, penalty = reference(m, side, box)
        assert all(abs(c) <= r for c, r in zip(chosen, radii, strict=True))
        assert penalty >= 0
        best = inequality(m, side, chosen)
        for _ in range(5):
            x, reading = point_of(rng, box), [within(rng, r) for r in radii]
            here = left_side(m, side, x, reading)
            assert value(inequality(m, side, tuple(reading)), x) == here
            assert here >= value(best, x) - penalty
            for j, (slope, bend) in enumerate(zip(slopes(m, side), loose, strict=True)):
                middle = value(slope, x)
                assert middle == derivative(m, side, x, [F(0)] * 7, j)
                assert abs(derivative(m, side, x, reading, j) - middle) <= bend


def test_exact_readings_have_no_penalty() -> None:
    rng = random.Random(5)
    for side in (*SIDES, "length"):
        m, box = some(rng, 0)
        assert reference(m, side, box) == ((F(0),) * 7, F(0))


def test_length_rows() -> None:
    m, _ = some(random.Random(6), 1)
    x = [F(i + 1) for i in range(8)]
    assert value(inequality(m, "length", (F(0),) * 7), x) == x[7] - x[6] - (m.length - m.length_radius)


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
