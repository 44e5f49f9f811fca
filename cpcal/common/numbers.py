"""Numbers in print. Every bound that a person reads is rounded here to the side on which it stays true.

Bounds: `bracket_text`, `rounded_down`, `rounded_up`, `at_least`, `at_most`, `gap_text`. What
the user stated is repeated by `stated`. Estimates, of which nothing is proved: `nearest`, `about`.
"""

import math
from collections.abc import Callable
from decimal import MIN_EMIN, ROUND_DOWN, Context, Decimal
from fractions import Fraction

Number = float | Fraction  # a Fraction is exact, and so is a float

_DIGITS = 7  # significant ones, of the larger bound of a bracket
_PLAIN = range(-5, 10)  # decimal exponents that are written without "e"
_INFINITY = "∞"
_NONE = "—"
_TEN = Fraction(10)
_CUT = Context(prec=9, rounding=ROUND_DOWN, Emin=MIN_EMIN)

Rounding = Callable[[Fraction], int]


def bracket_text(lo: Number, hi: Number, digits: int = _DIGITS) -> tuple[str, str]:
    """`lo` rounded down and `hi` rounded up, to so many significant digits of the larger."""
    exponent = max((_exponent(v) for v in (lo, hi) if _finite(v) and v), default=0)
    return _scaled(lo, exponent, digits, math.floor), _scaled(hi, exponent, digits, math.ceil)


def rounded_down(value: Number, decimals: int) -> str:
    """With so many decimals, never above `value`."""
    return _fixed(value, decimals, math.floor)


def rounded_up(value: Number, decimals: int) -> str:
    """With so many decimals, never below `value`."""
    return _fixed(value, decimals, math.ceil)


def at_least(value: Number, digits: int = 3) -> str:
    """With so many significant digits, never above `value`: for "at least ..."."""
    return _scaled(value, _exponent(value), digits, math.floor)


def at_most(value: Number, digits: int = 3) -> str:
    """With so many significant digits, never below `value`: for "at most ..."."""
    return _scaled(value, _exponent(value), digits, math.ceil)


def gap_text(lo: Number, hi: Number) -> str:
    """`hi - lo` to two digits, never less than it is; without an exponent where that is short."""
    if not (_finite(lo) and _finite(hi)):
        return _INFINITY if hi > lo else _NONE
    gap = Fraction(hi) - Fraction(lo)
    if not gap:
        return "0"
    number = _quantized(gap, _exponent(gap) - 1, math.ceil)
    return f"{number:f}" if Decimal("0.001") <= number < 1_000_000 else f"{number:.1e}"


def stated(value: float) -> str:
    """A number that the user gave, in the fewest digits that give the same float64 back."""
    return repr(float(value)).removesuffix(".0") if _finite(value) else _fixed(value, 0, round)


def nearest(value: Number, decimals: int) -> str:
    """With so many decimals: an estimate."""
    return _fixed(value, decimals, round)


def about(value: Number, digits: int = 3) -> str:
    """With so many significant digits at most: an estimate."""
    return short(_scaled(value, _exponent(value), digits, round))


def short(text: str) -> str:
    """The same number without zeros at its end."""
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def _exponent(value: Number) -> int:
    """Decimal exponent of the first digit; 0 where there is none."""
    if not _finite(value) or not value:
        return 0
    size = Fraction(value)
    return _CUT.divide(Decimal(size.numerator), Decimal(size.denominator)).adjusted()


def _scaled(value: Number, exponent: int, digits: int, rounding: Rounding) -> str:
    """Digits counted from the decimal `exponent` on."""
    if not _finite(value):
        return _fixed(value, 0, rounding)
    if not (number := _quantized(value, exponent - digits + 1, rounding)):
        return "0"
    return f"{number:f}" if exponent in _PLAIN else f"{number:e}"


def _fixed(value: Number, decimals: int, rounding: Rounding) -> str:
    if not _finite(value):
        return _NONE if math.isnan(value) else _INFINITY if value > 0 else "-" + _INFINITY
    number = _quantized(value, -decimals, rounding)
    return f"{number or abs(number):f}"


def _quantized(value: Number, exponent: int, rounding: Rounding) -> Decimal:
    """An exact multiple of 10 ** exponent."""
    return Decimal(rounding(Fraction(value) / _TEN**exponent)).scaleb(exponent, Context(prec=2000))


def _finite(value: Number) -> bool:
    return isinstance(value, Fraction | int) or math.isfinite(value)
