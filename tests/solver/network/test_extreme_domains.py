"""Every operation forwards, backwards, and its derivatives and slopes: on huge, tiny, infinite and 2^53-like domains.

The points are rational numbers, also such between two floats. Exact fractions judge; arb, where a value is irrational.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import arb, fmpq

import cpcal
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.interval.arb import precision
from cpcal.solver.interval.operations import BINARY, CODES, CONTINUOUS
from cpcal.solver.network.tape import sweeps_of

COUNT = int(os.environ.get("CPCAL_EXAMPLES", "60"))
BITS = 2400  # tell log1p(x) from x at the least float
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


def real_power(x: Fraction, y: Fraction, n: int) -> Real | None:
    if x > 0:
        return (ball(y) * ball(x).log()).exp()
    return Fraction(0) if x == 0 and y > 0 else None


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
    "log1p": elementary("log1p", -1.0, ends=False),
    "asin": elementary("asin", -1.0, 1.0),
    "acos": elementary("acos", -1.0, 1.0),
    **{name: elementary(name) for name in ("exp", "expm1", "sin", "cos", "tan", "atan", "sinh", "cosh", "tanh")},
    "pow": real_power,
    "atan2": angle,
    "floor": lambda x, y, n: Fraction(math.floor(x)),
    "ceil": lambda x, y, n: Fraction(math.ceil(x)),
    "sign": lambda x, y, n: Fraction((x > 0) - (x < 0)),
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
        "expm1": lambda: (a.exp(), None),
        "log": lambda: (1 / x, None),
        "log1p": lambda: (1 / (1 + x), None),
        "sin": lambda: (a.cos(), None),
        "cos": lambda: (-a.sin(), None),
        "tan": lambda: (1 + a.tan() ** 2, None),
        "asin": lambda: (1 / ball(1 - x * x).sqrt() if abs(x) != 1 else None, None),
        "acos": lambda: (-1 / ball(1 - x * x).sqrt() if abs(x) != 1 else None, None),
        "atan": lambda: (1 / (1 + x * x), None),
        "sinh": lambda: (a.cosh(), None),
        "cosh": lambda: (a.sinh(), None),
        "tanh": lambda: (1 / a.cosh() ** 2, None),
        "pow": lambda: (
            (ball(y) * (ball(y - 1) * a.log()).exp(), a.log() * (ball(y) * a.log()).exp()) if x > 0 else (None, None)
        ),
        "atan2": lambda: (y / (x * x + y * y), -x / (x * x + y * y)),
        **dict.fromkeys(("floor", "ceil"), lambda: (Fraction(0) if x.denominator > 1 else None, None)),
        "sign": lambda: (Fraction(0) if x else None, None),
    }
    return found[name]()


@pytest.mark.parametrize("engine", ["float64", "arb"])
@pytest.mark.parametrize("name", CODES)
def test_no_point_is_lost(name: str, engine: str) -> None:
    sweeps = sweeps_of(get_arithmetic(engine))
    code, arity = CODES[name], 1 + (name in BINARY)
    rng = np.random.default_rng(code)
    for _ in range(COUNT if engine == "float64" else COUNT // 6):
        n = int(rng.choice(EXPONENTS))
        a, x = interval(rng)
        b, y = interval(rng) if arity == 2 else (a, x)
        with precision(BITS):
            value = VALUES[name](x, y, n)
            if value is None or (isinstance(value, arb) and not value.is_finite()):
                continue
            found = sweeps.value(code, n, a, b)
            told = f"{name} {n}: {x} {y} in {a} {b}"
            assert holds(value, *found), f"{told}: {found}"
            z = known(rng, value, found)
            first = sweeps.first_argument(code, n, z, a, b)
            assert holds(x, *first), f"{told}: result in {z}, first argument in {first}"
            if arity == 2:
                second = sweeps.second_argument(code, n, z, a, b)
                assert holds(y, *second), f"{told}: result in {z}, second argument in {second}"
            if sweeps.quality(code, n, a, b) != CONTINUOUS:
                continue
            bounds = sweeps.partials(code, n, found, a, b)
            for derivative, bound in zip(derivatives(name, x, y, n), bounds, strict=True):
                if derivative is not None:
                    assert holds(derivative, *bound), f"{told}: derivative in {bound}"


@pytest.mark.parametrize("engine", ["float64", "arb"])
def test_no_solution_between_two_floats_is_lost(engine: str) -> None:
    for function, value in ((cpcal.floor, 2.0**53), (cpcal.ceil, 2.0**53 + 2.0)):
        net = cpcal.Network()
        y = net.variable("y", domain=(1.25, 1.75) if function is cpcal.ceil else (0.25, 0.75))
        net.add(function(2.0**53 + y) == value)
        assert net.contract(contractors=["hc4"], arithmetic=engine).box == net.domain


@pytest.mark.parametrize("engine", ["float64", "arb"])
@pytest.mark.parametrize("name", CODES)
def test_slopes_hold_every_secant(name: str, engine: str) -> None:
    """From a centre to a point that differs in one argument: exactly the quotient of the differences."""
    sweeps = sweeps_of(get_arithmetic(engine))
    code, arity = CODES[name], 1 + (name in BINARY)
    rng = np.random.default_rng(code + 100)
    for _ in range(COUNT // 2 if engine == "float64" else COUNT // 10):
        n = int(rng.choice(EXPONENTS))
        a, x = interval(rng)
        b, y = interval(rng) if arity == 2 else (a, x)
        if math.inf in (*a, *b) or -math.inf in (*a, *b):
            continue
        c = [float(min(max(below(p), i[0]), i[1])) for p, i in ((x, a), (y, b))]
        at_c = (c[0], c[0]), ((c[1], c[1]) if arity == 2 else (c[0], c[0]))
        if sweeps.quality(code, n, *at_c) != CONTINUOUS:
            continue
        center, anywhere = ((sweeps.value(code, n, *pair), *pair) for pair in (at_c, (a, b)))
        if not (center[0][0] <= center[0][1] and anywhere[0][0] <= anywhere[0][1]):
            continue
        bounds = sweeps.slopes(code, n, center, anywhere)
        with precision(BITS):
            exact = [Fraction(v) for v in c]
            for k, u in ((0, Fraction(a[1])), (0, x), (1, Fraction(b[0])), (1, y)):
                if k >= arity or u == exact[k]:
                    continue
                moved = [u, exact[1]] if k == 0 else [exact[0], u]
                if arity == 1:
                    moved, start = [u, u], [exact[0], exact[0]]
                else:
                    start = exact
                one, two = (VALUES[name](at[0], at[1], n) for at in (moved, start))
                if one is None or two is None:
                    continue
                if isinstance(one, arb) or isinstance(two, arb):
                    one, two = ball(one), ball(two)
                secant = (one - two) / (u - exact[k] if isinstance(one, Fraction) else ball(u - exact[k]))
                if isinstance(secant, Fraction) or secant.is_finite():
                    assert holds(secant, *bounds[k]), f"{name} {n}: {c} to {moved} in {a} {b}: {bounds[k]}"
