"""Directed rounding on top of round-to-nearest: bounds of sums, totals, powers and roots of float64 arrays.

Functions expect their caller to have silenced floating-point warnings (`np.errstate(all="ignore")`). NaN goes
through all of them. A `_down` result is never +inf and an `_up` result never -inf: overflow becomes the
largest float on its safe side.
"""

from __future__ import annotations

from math import ceil, log2

import numpy as np
import numpy.typing as npt

from cpcal.common.arrays import Bools, Floats
from cpcal.common.errors import RoundingError

MAX = float(np.finfo(np.float64).max)
ETA = 5e-324  # the least positive float

# Subtracting |v| * PHI from a normal v moves it one float down, as np.nextafter does but six times faster: in
# [2^k, 2^(k+1)) it is at least 0.75 and less than 1.5 units in the last place, which rounds to one (to two at
# some of the smallest normal numbers). Zero and subnormal numbers stay: sums that small are exact, and the
# other operations add ETA.
_PHI = 0.75 * 2.0**-52

_SEQUENTIAL = 8  # the longest axis that is added term by term
_LARGE = 2000  # from this size on a comparison beats `count_nonzero`


_ONE, _TINY, _HALF = 1.0, 2.0**-60, 0.5
_NORMAL = float(np.finfo(np.float64).smallest_normal)


def check_rounding() -> None:
    """Raises RoundingError where this thread does not compute as IEEE 754 has it, which all float64 bounds rest on.

    Some interval libraries switch the rounding, and leave it so: codac and others on gaol, filib or boost. Libraries
    that were compiled with -ffast-math switch subnormal numbers off for whoever loads them: results that small are
    zero then, and bounds of them false.
    """
    nearest = _ONE + _TINY == _ONE and _ONE - _TINY == _ONE
    if not nearest or _NORMAL * _HALF == 0.0 or ETA / _NORMAL == 0.0:
        raise RoundingError(
            "another library in this process has changed how the processor rounds, or switched small numbers off: no "
            "bound in float64 can be trusted. Run that library in a process of its own"
        )


def has_zero(a: Floats) -> bool:
    """Whether any element is zero."""
    if a.size < _LARGE:
        return bool(np.count_nonzero(a) < a.size)
    return bool((a == 0.0).any())


def has_nan(a: Floats) -> bool:
    """Whether any element is NaN."""
    return bool(np.isnan(np.minimum.reduce(a, axis=None, initial=0.0)))


def is_nonnegative(a: Floats) -> bool:
    """Whether all elements are at least zero, none NaN."""
    return bool(np.minimum.reduce(a, axis=None, initial=0.0) >= 0.0)


def next_down(v: Floats, eta: float, exact: Bools | None = None) -> Floats:
    """A lower bound of every number that rounds to v; v itself where exact. Overwrites v.

    With eta == 0, subnormal v must be exact.
    """
    v = np.asarray(v)
    np.minimum(v, MAX, out=v)
    v -= _step(v, eta, exact)
    return v


def next_up(v: Floats, eta: float, exact: Bools | None = None) -> Floats:
    """An upper bound of every number that rounds to v; v itself where exact. Overwrites v.

    With eta == 0, subnormal v must be exact.
    """
    v = np.asarray(v)
    np.maximum(v, -MAX, out=v)
    v += _step(v, eta, exact)
    return v


def _step(v: Floats, eta: float, exact: Bools | None) -> Floats:
    step = np.asarray(np.abs(v))
    step *= _PHI
    if eta:
        step += eta
    if exact is not None:
        np.copyto(step, 0.0, where=exact)
    return step


def sum_down(a: Floats, b: Floats) -> Floats:
    """A lower bound of a + b; exact where a, b or the sum is zero."""
    exact = (a == 0.0) | (b == 0.0) if has_zero(a) or has_zero(b) else None
    return next_down(a + b, 0.0, exact)


def sum_up(a: Floats, b: Floats) -> Floats:
    """An upper bound of a + b; exact where a, b or the sum is zero."""
    exact = (a == 0.0) | (b == 0.0) if has_zero(a) or has_zero(b) else None
    return next_up(a + b, 0.0, exact)


def total_down(a: Floats, axis: int) -> Floats:
    """A lower bound of the sum along an axis."""
    a = np.moveaxis(a, axis, 0)
    if 0 < len(a) <= _SEQUENTIAL:
        total = np.asarray(a[0])
        for term in a[1:]:
            total = sum_down(total, term)
        return total
    total, error = _tree_sum(a)
    down = np.where(np.isinf(total) | np.isinf(error), -np.inf, next_down(total - error, 0.0))
    return np.where(error == 0.0, total, down)


def total_up(a: Floats, axis: int) -> Floats:
    """An upper bound of the sum along an axis."""
    return -total_down(-a, axis)


def _tree_sum(a: Floats) -> tuple[Floats, Floats]:
    """The sum along axis 0 rounded to nearest, and a bound of its error.

    Pairs are added, then pairs of pairs: a term takes part in only d = ceil(log2(n)) additions. So the error
    is at most (d u + O(u^2)) sum |a|, without an underflow term because tiny sums are exact. The computed sum
    of magnitudes may be short by n u (relatively), and the bound is itself rounded: 2^-20 covers both.
    """
    if len(a) == 0:
        zero = np.zeros(a.shape[1:])
        return zero, zero
    depth = ceil(log2(len(a)))
    size = np.abs(a).sum(axis=0)
    while len(a) > 1:
        half = len(a) // 2
        paired = a[:half] + a[half : 2 * half]
        a = paired if len(a) % 2 == 0 else np.concatenate([paired, a[-1:]])
    error = size * (depth * 2.0**-53 * (1.0 + 2.0**-20)) + ETA
    return a[0], np.where(size == 0.0, 0.0, error)


def power(m: Floats, n: int, away: Floats | float) -> Floats:
    """A bound of m ** n for m >= 0, n >= 1: upper where `away` (from zero) is 1, lower where it is -1."""
    result: Floats | None = None
    bits = n
    while True:
        if bits & 1:
            result = m if result is None else _product(result, m, away)
        bits >>= 1
        if not bits:
            assert result is not None
            break
        m = _product(m, m, away)
    return result


def _product(a: Floats, b: Floats, away: Floats | float) -> Floats:
    """A bound, on the side `away`, of the product of numbers >= 0; zero stays zero."""
    v = np.asarray(a * b)
    np.minimum(v, MAX, out=v)  # an upper bound grows back to inf below
    step = _step(v, ETA, (a == 0.0) | (b == 0.0) if has_zero(v) else None)
    step *= away
    v += step
    return np.asarray(np.maximum(v, 0.0))


def root(m: Floats, n: int, away: Floats | float) -> Floats:
    """A bound of the n-th root of m >= 0, upper or lower as in `power`, and proved by its n-th power."""
    scaled, exponent = _scale(m, n)
    away = np.asarray(away)
    width = _PHI
    bound = scaled ** (1.0 / n) * (1.0 + 2.0 * width * away)
    while (wrong := (power(bound, n, -away) - scaled) * away < 0.0).any():
        if width > 1.0:  # only if n is in the hundreds and scaled near the ends of the float range
            bound = np.where(wrong, np.where(away > 0.0, np.maximum(scaled, 1.0), np.minimum(scaled, 1.0)), bound)
            break
        width *= 2.0
        bound = np.where(wrong, bound + width * away * bound, bound)
    infinite = np.where(away > 0.0, np.inf, MAX)
    return np.where(m == np.inf, infinite, np.ldexp(bound, exponent))


def _scale(m: Floats, n: int) -> tuple[Floats, npt.NDArray[np.int64]]:
    """`(s, q)` with m == s * 2^(n q) exactly and s near 1, where float powers are accurate; s = 1 for inf."""
    mantissa, exponent = np.frexp(np.where(m == np.inf, 1.0, m))
    quotient = np.trunc(exponent / n).astype(np.int64)
    return np.ldexp(mantissa, exponent - n * quotient), quotient
