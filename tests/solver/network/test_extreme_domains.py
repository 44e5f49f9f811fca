"""Every operation forwards, backwards, and its derivatives: on huge, tiny, infinite and 2^53-like domains.

The points are rational numbers, also such between two floats. Exact fractions judge; arb, where a value is irrational.
"""

import math
import os
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx, fmpq

from cpcal.solver.interval import operations
from cpcal.solver.interval.operations import BINARY, CODES

COUNT = int(os.environ.get("CPCAL_EXAMPLES", "60"))
BITS = 2400
EXPONENTS = (*range(-5, 6), 17, -33)
ETA, BIGGEST = 5e-324, 1.7976931348623157e308
ANCHORS = (
    *(
        0.0,
        ETA,
        3 * ETA,
        7 * ETA,
        2.0**-1022,
        2.5e-308,
        1e-200,
        1e-160,
        1e-17,
        0.25,
        0.5,
        1.0,
        1.5,
        2.0,
        math.pi / 2,
        3.0,
    ),
    *(math.pi, 20.0, 709.5, 745.0, 1.5e6, 2.0**52 - 0.5, 2.0**53 - 1.0, 2.0**53, 2.0**54 + 4.0, 1e155, 1e300, BIGGEST),
)

Real = Fraction | arb


def ball(x: Real) -> arb:
    return arb(fmpq(x.numerator, x.denominator)) if isinstance(x, Fraction) else x


def power(x: Real, n: int) -> Real | None:
    return None if n < 0 and x == 0 else x**n


def elementary(name: str, low: float = -math.inf, high: float = math.inf, *, ends: bool = True) -> Callable[..., Any]:
    def value(x: Fraction, y: Fraction, n: int) -> arb | None:
        if not (low <= x <= high) or (not ends and x in (low, high)):
            return None
        return getattr(ball(x), name)()

    return value


def angle(y: Fraction, x: Fraction, n: int) -> Real | None:
    if x == 0 and y == 0:
        return None
    return arb.atan2(ball(y), ball(x))


# the exact value at rational arguments; None where there is none
VALUES: dict[str, Callable[[Fraction, Fraction, int], Real | None]] = {
    "neg": lambda x, y, n: -x,
    "add": lambda x, y, n: x + y,
    "sub": lambda x, y, n: x - y,
    "mul": lambda x, y, n: x * y,
    "div": lambda x, y, n: x / y if y else None,
    "sqr": lambda x, y, n: x * x,
    "sqrt": elementary("sqrt", 0.0),
    "power": lambda x, y, n: power(x, n),
    "abs": lambda x, y, n: abs(x),
    "min": lambda x, y, n: min(x, y),
    "max": lambda x, y, n: max(x, y),
    "log": elementary("log", 0.0, ends=False),
    "asin": elementary("asin", -1.0, 1.0),
    **{name: elementary(name) for name in ("exp", "sin", "cos", "tan", "atan")},
    "atan2": angle,
}


def below(value: Real) -> float:
    """A float that is at most value."""
    if isinstance(value, Fraction):
        try:
            near = float(value)
        except OverflowError:
            return BIGGEST if value > 0 else -math.inf
        return near if near <= value else math.nextafter(near, -math.inf)
    near = float(value.lower())
    near = BIGGEST if near == math.inf else near
    return math.nextafter(near, -math.inf) if not arb(near) <= value else near


def above(value: Real) -> float:
    return -below(-value)


def holds(value: Real, lo: float, hi: float) -> bool:
    """Whether the value may lie in [lo, hi]: false only where it certainly does not; NaN holds nothing."""
    if isinstance(value, Fraction):
        return lo <= value <= hi
    return lo <= hi and not (math.isfinite(lo) and value < arb(lo)) and not (math.isfinite(hi) and value > arb(hi))


def interval(rng: np.random.Generator) -> tuple[tuple[float, float], Fraction]:
    """Bounds about an anchor, wide or a few floats apart or infinite, and a rational number between them."""
    anchor = float(rng.choice(ANCHORS)) * float(rng.choice([-1.0, 1.0]))
    kind = rng.integers(5)
    lo = hi = anchor
    if kind == 1:
        other = float(rng.choice(ANCHORS)) * float(rng.choice([-1.0, 1.0]))
        lo, hi = min(lo, other), max(hi, other)
    elif kind >= 2:
        for _ in range(rng.integers(4)):
            lo = math.nextafter(lo, -math.inf)
        for _ in range(rng.integers(4)):
            hi = math.nextafter(hi, math.inf)
    lo, hi = max(lo, -BIGGEST), min(hi, BIGGEST)
    share = Fraction(int(rng.integers(0, 8)), 7)
    point = Fraction(lo) + share * (Fraction(hi) - Fraction(lo))
    if kind == 4:
        lo, hi = (-math.inf, hi) if rng.integers(2) else (lo, math.inf)
    return (lo, hi), point


def known(rng: np.random.Generator, value: Real, found: tuple[float, float]) -> tuple[float, float]:
    """Bounds that hold the value, as close as floats are or as the forward sweep found them."""
    lo = found[0] if rng.integers(2) else below(value)
    hi = found[1] if rng.integers(2) else above(value)
    return lo, hi


def derivatives(name: str, x: Fraction, y: Fraction, n: int) -> tuple[Real | None, Real | None]:
    """The exact partial derivatives; None where there is none or a kink."""
    a = ball(x)
    one = Fraction(1)
    found: dict[str, Callable[[], tuple[Real | None, Real | None]]] = {
        "neg": lambda: (-one, None),
        "add": lambda: (one, one),
        "sub": lambda: (one, -one),
        "mul": lambda: (y, x),
        "div": lambda: (1 / y, -x / y**2),
        "sqr": lambda: (2 * x, None),
        "sqrt": lambda: (1 / (2 * a.sqrt()) if x else None, None),
        "power": lambda: (None if x == 0 and n <= 0 else n * x ** (n - 1) if n else Fraction(0), None),
        "abs": lambda: (Fraction((x > 0) - (x < 0)) if x else None, None),
        "min": lambda: (None, None) if x == y else (Fraction(x < y), Fraction(y < x)),
        "max": lambda: (None, None) if x == y else (Fraction(x > y), Fraction(y > x)),
        "exp": lambda: (a.exp(), None),
        "log": lambda: (1 / x, None),
        "sin": lambda: (a.cos(), None),
        "cos": lambda: (-a.sin(), None),
        "tan": lambda: (1 + a.tan() ** 2, None),
        "asin": lambda: (1 / ball(1 - x * x).sqrt() if abs(x) != 1 else None, None),
        "atan": lambda: (1 / (1 + x * x), None),
        "atan2": lambda: (y / (x * x + y * y), -x / (x * x + y * y)),
    }
    return found[name]()


@pytest.mark.parametrize("name", CODES)
def test_no_point_is_lost(name: str) -> None:
    code, arity = CODES[name], 1 + (name in BINARY)
    rng = np.random.default_rng(code)
    for _ in range(COUNT):
        n = int(rng.choice(EXPONENTS))
        a, x = interval(rng)
        b, y = interval(rng) if arity == 2 else (a, x)
        with ctx.workprec(BITS):
            value = VALUES[name](x, y, n)
            if value is None or (isinstance(value, arb) and not value.is_finite()):
                continue
            found = operations.value(code, n, a, b)
            told = f"{name} {n}: {x} {y} in {a} {b}"
            assert holds(value, *found), f"{told}: {found}"
            z = known(rng, value, found)
            first = operations.first_argument(code, n, z, a, b)
            assert holds(x, *first), f"{told}: result in {z}, first argument in {first}"
            if arity == 2:
                second = operations.second_argument(code, n, z, a, b)
                assert holds(y, *second), f"{told}: result in {z}, second argument in {second}"
            if not operations.continuous(code, n, a, b):
                continue
            bounds = operations.partials(code, n, found, a, b)
            for derivative, bound in zip(derivatives(name, x, y, n), bounds, strict=True):
                if derivative is not None:
                    assert holds(derivative, *bound), f"{told}: derivative in {bound}"
