"""Intervals of whole multiples of 2^-160 hold every result of the numbers that they hold, and little more."""

import operator
import random
from fractions import Fraction as F

import pytest

from cpcal.checker.bounds import Bounds, between, dot, longest, number, rotation, total
from cpcal.checker.polynomial import inner
from cpcal.checker.readers import Refused

UNIT = F(1, 1 << 160)
SMALL = F(1, 1 << 90)  # much more than what rounding outward adds here


def drawn(rng: random.Random) -> tuple[Bounds, list[F]]:
    """An interval and numbers in it, its ends among them, all multiples of 2^-160."""
    lo, hi = sorted(rng.randint(-(1 << 165), 1 << 165) for _ in range(2))
    if rng.random() < 0.2:
        hi = lo
    return Bounds(lo, hi), [lo * UNIT, hi * UNIT, (lo + hi >> 1) * UNIT]


def held(found: Bounds, values: list[F]) -> None:
    assert found.lo * UNIT <= min(values)
    assert max(values) <= found.hi * UNIT


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul, operator.truediv])
def test_operations_hold_the_results_of_all_numbers_and_end_near_them(operation):
    rng = random.Random(1)
    for _ in range(200):
        (a, xs), (b, ys) = drawn(rng), drawn(rng)
        if operation is operator.truediv and min(ys) <= 0 <= max(ys):
            with pytest.raises(Refused, match="a divisor may be zero"):
                operation(a, b)
            continue
        found, values = operation(a, b), [operation(x, y) for x in xs for y in ys]
        held(found, values)
        assert min(values) - found.lo * UNIT < SMALL
        assert found.hi * UNIT - max(values) < SMALL


def test_squares_roots_sizes_and_sums_hold_those_of_all_numbers():
    rng = random.Random(2)
    for _ in range(200):
        (a, xs), (b, ys) = drawn(rng), drawn(rng)
        zero = [F(0)] if min(xs) <= 0 <= max(xs) else []
        held(a.square, [x * x for x in [*xs, *zero]])
        assert a.size.hi * UNIT >= max(map(abs, xs))
        held(-3 * a, [-3 * x for x in xs])
        held(total([a, b, a]), [2 * x + y for x in xs for y in ys])
        for of in (inner, dot):
            held(of([a, b], [b, b]), [x * y + y * y for x in xs for y in ys])
            held(of([a, b], [-3 * a.least, b.most]), [-3 * x * xs[0] + y * ys[1] for x in xs for y in ys])
        assert (longest([a, b]).lo * UNIT) ** 2 >= max(x * x + y * y for x in xs for y in ys)
        root = a.size.root
        assert (root.lo * UNIT) ** 2 <= a.size.lo * UNIT
        assert max(map(abs, xs)) <= (root.hi * UNIT) ** 2


def test_a_fraction_lies_between_its_bounds():
    for value in (F(1, 3), F(-1, 3), F(5), F(10**40, 7)):
        held(number(value), [value])
        held(between(value, value + 1), [value, value + 1])


def test_a_rotation_turns_a_right_handed_frame_into_one():
    matrix = rotation([number(v) for v in (3, -1, 2, 5)])
    for i in range(3):
        for j in range(3):
            held(inner(matrix[i], matrix[j]), [F(i == j)])
    (a, b, c), (d, e, f), (g, h, k) = matrix
    held(a * (e * k - f * h) - b * (d * k - f * g) + c * (d * h - e * g), [F(1)])
    held(matrix[0][1], [F(2 * (-1 * 2 - 3 * 5), 39)])
