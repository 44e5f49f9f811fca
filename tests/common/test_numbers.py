"""A printed bound, read back as a number, lies on the side on which it stays true; nobody else prints bounds."""

import ast
import math
import re
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.common import numbers
from cpcal.common.numbers import (
    about,
    at_least,
    at_most,
    bracket_text,
    gap_text,
    nearest,
    rounded_down,
    rounded_up,
    short,
    stated,
)

floats = st.floats(allow_nan=False, allow_infinity=False)
exact = floats | st.fractions()
endless = exact | st.sampled_from([math.inf, -math.inf])
digits = st.integers(1, 20)

PACKAGE = Path(cpcal.__file__).parent
# Rooms of estimates, in which no bound is printed.
ESTIMATES = (
    "calibration", "vision", "simulate", "robot", "files", "common/documents.py",  # what a user stated
    "questions/log.py", "questions/study_calibration.py", "cli/study.py", "cli/image.py",
    "report/figures.py",  # coordinates of drawings, and ticks, which are round numbers
)  # fmt: skip


def read(text):
    """The number that a reader sees."""
    return {"∞": math.inf, "-∞": -math.inf}[text] if "∞" in text else Fraction(Decimal(text))


@given(endless, endless, digits)
def test_a_bracket_is_printed_outward(lo, hi, count):
    down, up = map(read, bracket_text(lo, hi, count))
    assert down <= lo
    assert up >= hi


@given(endless, digits, st.integers(0, 12))
def test_single_bounds_are_rounded_to_their_side(value, count, decimals):
    assert read(at_least(value, count)) <= value <= read(at_most(value, count))
    assert read(rounded_down(value, decimals)) <= value <= read(rounded_up(value, decimals))
    assert read(short(at_least(value, count))) == read(at_least(value, count))


@given(exact, exact)
def test_a_gap_is_never_printed_too_small(x, y):
    lo, hi = min(x, y), max(x, y)
    assert read(gap_text(lo, hi)) >= Fraction(hi) - Fraction(lo)


@given(exact, digits)
def test_rounding_costs_less_than_one_unit_of_the_last_digit(value, count):
    unit = abs(Fraction(value)) / 10 ** (count - 1)
    assert read(at_most(value, count)) - Fraction(value) <= unit
    assert Fraction(value) - read(at_least(value, count)) <= unit


@given(floats)
def test_what_a_user_stated_is_repeated_exactly(value):
    assert float(stated(value)) == value


@given(exact, st.integers(0, 12))
def test_estimates_are_rounded_to_the_nearest(value, decimals):
    assert abs(read(nearest(value, decimals)) - Fraction(value)) <= Fraction(1, 2 * 10**decimals)
    assert abs(read(about(value, 3)) - Fraction(value)) <= abs(Fraction(value)) / 200


def test_examples():
    assert (at_least(8.125), at_most(8.125)) == ("8.12", "8.13")
    assert (at_least(123456), at_most(123456)) == ("123000", "124000")
    assert [gap_text(0.25, 0.25), gap_text(0.0, 0.125), gap_text(0.0, math.inf)] == ["0", "0.13", "∞"]
    assert gap_text(math.inf, math.inf) == "—"
    assert [stated(100.0), stated(0.1), stated(1e-6)] == ["100", "0.1", "1e-06"]
    assert nearest(-1e-12, 6) == "0.000000"
    assert [about(1.1000000000000001), about(100.0), about(0.00034)] == ["1.1", "100", "0.00034"]


def _formatted(tree):
    """Lines on which a number is made text with a rounding of its own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FormattedValue) and isinstance(node.format_spec, ast.JoinedStr):
            spec = "".join(str(getattr(part, "value", "")) for part in node.format_spec.values)
            if re.search(r"[eEfFgG%n]$", spec):
                yield node.lineno
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name == "format" and isinstance(node.func, ast.Attribute) and not _is_text(node.func.value):
                continue  # Markup's puts texts into a page
            if name in ("format", "format_float_positional", "format_float_scientific"):
                yield node.lineno
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mod) and _is_text(node.left):
            yield node.lineno
        elif isinstance(node, ast.JoinedStr):
            calls = (part for part in ast.walk(node) if isinstance(part, ast.Call))
            yield from (node.lineno for call in calls if getattr(call.func, "id", "") == "round")


def _is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def test_no_other_module_rounds_what_it_prints():
    found = []
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).as_posix()
        if path != Path(numbers.__file__) and not name.startswith(ESTIMATES):
            found += [f"{name}:{line}" for line in _formatted(ast.parse(path.read_text(encoding="utf-8")))]
    assert found == []


def test_no_template_rounds_what_it_prints():
    for path in (PACKAGE / "report" / "templates").glob("*.j2"):
        spent = re.findall(r"\|\s*(?:round|float)\b|%[.\d]*[efg]|:[.\d]*[efg]\}", path.read_text(encoding="utf-8"))
        assert spent == [], path.name
