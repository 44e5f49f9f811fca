"""Numbers in print. A proved bound is printed rounded to the side on which it stays proved."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Context, Decimal

_DIGITS = 7  # significant ones, of the larger bound of a bracket
_PLAIN = range(-5, 10)  # decimal exponents that are written without "e"
_INFINITY = "∞"


def bracket_text(lo: float, hi: float) -> tuple[str, str]:
    """`lo` rounded down and `hi` rounded up, to seven significant digits of the larger."""
    largest = max((abs(v) for v in (lo, hi) if math.isfinite(v)), default=0.0)
    exponent = Decimal(largest).adjusted() if largest else 0
    return _rounded(lo, exponent, ROUND_FLOOR), _rounded(hi, exponent, ROUND_CEILING)


def rounded_down(value: float, decimals: int) -> str:
    """With so many decimals, never above `value`."""
    return _fixed(value, -decimals, ROUND_FLOOR)


def rounded_up(value: float, decimals: int) -> str:
    """With so many decimals, never below `value`."""
    return _fixed(value, -decimals, ROUND_CEILING)


def nearest(value: float, decimals: int) -> str:
    """With so many decimals, for what is no bound."""
    return _fixed(value, -decimals, ROUND_HALF_EVEN)


def gap_text(lo: float, hi: float) -> str:
    """`hi - lo` to two digits, never less than it is."""
    if not (math.isfinite(lo) and math.isfinite(hi)):
        return _INFINITY if hi > lo else "—"
    gap = Context(prec=2000).subtract(Decimal(hi), Decimal(lo))  # exact: a float has at most 767 digits
    if gap == 0:
        return "0"
    rounded = Context(prec=2, rounding=ROUND_CEILING).plus(gap)
    return f"{rounded:.1e}"


def plain_gap(lo: float, hi: float) -> str:
    """The same, without an exponent where that is short."""
    text = gap_text(lo, hi)
    number = float(text) if text[0].isdigit() else 0.0
    return f"{Decimal(text):f}" if 0.001 <= number < 1e6 else text


def clean(text: str) -> str:
    """Without what could command a terminal or hide in a page: unprintable characters become U+FFFD."""
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def _rounded(value: float, exponent: int, rounding: str) -> str:
    if not math.isfinite(value):
        return _infinite(value)
    number = _quantized(value, exponent - _DIGITS + 1, rounding)
    if number == 0:
        return "0"
    return f"{number:f}" if exponent in _PLAIN else f"{number:e}"


def _fixed(value: float, exponent: int, rounding: str) -> str:
    if not math.isfinite(value):
        return _infinite(value)
    number = _quantized(value, exponent, rounding)
    return f"{abs(number) if number == 0 else number:f}"


def _quantized(value: float, exponent: int, rounding: str) -> Decimal:
    return Decimal(value).quantize(Decimal(1).scaleb(exponent), context=Context(prec=2000, rounding=rounding))


def _infinite(value: float) -> str:
    return "—" if math.isnan(value) else _INFINITY if value > 0 else "-" + _INFINITY
