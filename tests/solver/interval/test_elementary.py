"""Elementary functions in float64: their cores' errors are proved here, and random arguments are compared with arb."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

from cpcal.solver.compiled import plain
from cpcal.solver.interval import functions as el
from cpcal.solver.interval import functions as fn

UNIT = 2.0**-53
PROVED = 2.0**-50.5  # leaves half of el.ERROR, and more, for the rounding of what `widened` does


@dataclass(frozen=True)
class Tracked:
    """A float64 that a computation gives somewhere in a subinterval: what exact arithmetic on the same float64 inputs
    would give lies in `exact`, and the float64 differs from it by at most `error`. No underflow: see the test."""

    exact: arb
    error: arb

    @staticmethod
    def of(value: Any) -> Tracked:
        return value if isinstance(value, Tracked) else Tracked(arb(value), arb(0))

    def _rounded(self, exact: arb, error: arb) -> Tracked:
        return Tracked(exact, (error + UNIT * (abs(exact).upper() + error)).upper())

    def __add__(self, other: Any) -> Tracked:
        y = Tracked.of(other)
        return self._rounded(self.exact + y.exact, self.error + y.error)

    def __sub__(self, other: Any) -> Tracked:
        y = Tracked.of(other)
        return self._rounded(self.exact - y.exact, self.error + y.error)

    def __rsub__(self, other: Any) -> Tracked:
        return Tracked.of(other) - self

    def __mul__(self, other: Any) -> Tracked:
        y = Tracked.of(other)
        a, b = abs(self.exact).upper(), abs(y.exact).upper()
        return self._rounded(self.exact * y.exact, a * y.error + b * self.error + self.error * y.error)

    __radd__, __rmul__ = __add__, __mul__


def series(coefficients: tuple[float, ...], exact: Callable[[int], Fraction], first: int, z: arb) -> arb:
    """A bound of the sum of |c - exact| z^k over the coefficients (highest power first), and of what follows them.

    `exact(n)` is the n-th exact coefficient, `first` the n of the lowest; magnitudes fall.
    """
    total = arb(0)
    for k, c in enumerate(reversed(coefficients)):
        wanted = exact(first + k)
        total += abs(arb(c) - arb(wanted.numerator) / wanted.denominator) * z**k
    rest = abs(exact(first + len(coefficients)))
    return total + arb(rest.numerator) / rest.denominator * z ** len(coefficients) / (1 - z)


def factorial(n: int) -> int:
    return 1 if n < 2 else n * factorial(n - 1)


def rational(n: int) -> Fraction:
    return Fraction(1, 2 * n + 1)


CORES: dict[str, tuple[Callable[..., Any], float, float, Callable[[arb], arb], Callable[[arb], arb]]] = {
    # name: core, range, size of the tail per argument, the function, its truncation error over |r| at most r
    "exp": (el.exp_core, 0.36, 0.0, lambda r: r.exp(),
        lambda r: series(el.EXP, lambda n: Fraction(1, factorial(n)), 0, r)),
    "log": (el.log_core, 0.22, 0.0, lambda s: 2 * s.atanh(), lambda s: 2 * s**3 * series(el.ATANH, rational, 1, s**2)),
    "sin": (el.sin_core, 0.79, UNIT, lambda r: r.sin(),
        lambda r: r**3 * series(el.SIN, lambda n: Fraction((-1) ** n, factorial(2 * n + 1)), 1, r**2)),
    "cos": (el.cos_core, 0.79, UNIT, lambda r: r.cos(),
        lambda r: r**2 * series(el.COS, lambda n: Fraction((-1) ** n, factorial(2 * n)), 1, r**2)),
    "atan": (el.atan_core, 0.4143, 0.0, lambda t: t.atan(),
        lambda t: t**3 * series(el.ATAN, lambda n: (-1) ** n * rational(n), 1, t**2)),
}  # fmt: skip


@pytest.mark.parametrize("name", CORES)
def test_the_relative_error_of_every_core_is_proved_over_its_range(name: str) -> None:
    """Rounding: the core's own source on tracked numbers. Truncation: the series. Both piece by piece, towards zero.

    The pieces are [a, 1.05 a] and their mirror images, down to 1e-30: below, every term but the first is less than
    1e-59 of it (1e-29 for exp), and an underflow of those is covered by the ETA that `widened` adds.
    """
    core, end, tail, function, truncation = CORES[name]
    with ctx.workprec(200):
        for sign in (1, -1):
            top = arb(end)
            while top > 1e-30:
                bottom = top / 1.05
                size = bottom.union(top)
                r = sign * size
                small = [Tracked(arb(0, 1) * (tail * top).upper(), arb(0))] if tail else []
                found = plain(core)(Tracked(r, arb(0)), *small)
                error = found.error + truncation(top)
                if tail:  # sin(r + t) - (sin r + t (1 - r^2/2)), cos(r + t) - (cos r - t r): r^3/6 or r^4/24, and t^2
                    t = tail * top
                    error += t * (top**4 / 24 if name == "sin" else top**3 / 6) + t**2
                least = abs(function(r)).lower()
                assert error < PROVED * least, f"{name} at {r}: {(error / least).str(5)}"
                top = bottom


def test_constants_of_the_reductions() -> None:
    """Products with k are exact up to 2^20 (the exponents of log and exp are below 2^11); what is left out is small."""
    with ctx.workprec(300):
        assert abs(arb.const_log2() - el.LN2_HI - el.LN2_LO) < 2.0**-85
        assert abs(arb.pi() / 2 - el.PIO2_1 - el.PIO2_2 - el.PIO2_3) < 2.0**-122
        assert el.PI[0] < arb.pi() < el.PI[1]
    for constant, bits in ((el.LN2_HI, 32), (el.PIO2_1, 33), (el.PIO2_2, 33)):
        assert Fraction(constant).numerator.bit_length() <= bits
    assert el.FARTHEST * 2.0 / 3.14 < 2.0**20


# what is compared with arb: interval function, arb's, sampled exponents of arguments, domain
UNARY: dict[str, tuple[Callable[..., Any], Callable[[arb], arb], tuple[float, float], tuple[float, float]]] = {
    "exp": (fn.exp, lambda x: x.exp(), (-20, 3), (-np.inf, np.inf)),
    "log": (fn.log, lambda x: x.log(), (-308, 308), (0, np.inf)),
    "sin": (fn.sin, lambda x: x.sin(), (-20, 6.2), (-np.inf, np.inf)),
    "cos": (fn.cos, lambda x: x.cos(), (-20, 6.2), (-np.inf, np.inf)),
    "tan": (fn.tan, lambda x: x.tan(), (-20, 6.2), (-np.inf, np.inf)),
    "asin": (fn.asin, lambda x: x.asin(), (-20, 0), (-1, 1)),
    "atan": (fn.atan, lambda x: x.atan(), (-20, 300), (-np.inf, np.inf)),
}


def sample(rng: np.random.Generator, exponents: tuple[float, float], domain: tuple[float, float], count: int) -> Any:
    """Numbers of all sizes and signs in a domain."""
    x = 10.0 ** rng.uniform(*exponents, count) * rng.choice([-1, 1], count)
    special = np.concatenate([np.pi / 2 * np.arange(-40, 41), np.log(2.0) * np.arange(-20, 21), [1.0, -1.0, 1e-300]])
    x = np.concatenate([x, special, np.nextafter(special, 9.0)])
    return x[(x > domain[0]) & (x < domain[1])]


@pytest.mark.parametrize("name", UNARY)
def test_three_thousand_arguments_are_enclosed_tightly(name: str) -> None:
    function, exact, exponents, domain = UNARY[name]
    rng = np.random.default_rng(1)
    ctx_before = ctx.prec
    widest = 0.0
    for x in sample(rng, exponents, domain, 3_000):
        lo, hi = function((x, x))
        with ctx.workprec(180):
            value = exact(arb(float(x)))
            assert arb(lo) <= value.upper(), f"{name}({x!r})"
            assert value.lower() <= arb(hi), f"{name}({x!r})"
        if np.isfinite(hi) and np.isfinite(lo) and abs(lo) > 1e-280 and lo < 1e300:
            size = max(abs(lo), abs(hi))
            reduction = 2.0**-88 * (1.0 + size**2) if name in ("sin", "cos", "tan") else 0.0
            widest = max(widest, (hi - lo - reduction) / size)
    assert ctx.prec == ctx_before
    assert widest < 2.0**-44


def test_outside_of_the_domain_nothing_is_left() -> None:
    for function, lo, hi in ((fn.log, -2.0, -1.0), (fn.asin, 2.0, 3.0)):
        assert np.isnan(function((lo, hi))).all()
    assert fn.asin((0.0, 5.0))[1] >= np.pi / 2
    assert fn.log((-1.0, 1.0))[0] == -np.inf
