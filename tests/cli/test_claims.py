"""Sentences on accepted certificates: true whatever the rounding, and on one line whatever the names."""

import re
from decimal import Decimal
from fractions import Fraction as F

from hypothesis import given
from hypothesis import strategies as st

from cpcal.checker.certificate import Accepted, Claims, Point
from cpcal.cli.verify import sentences
from cpcal.models import PARAMETERS

NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?"
exact = st.fractions(-4000, 4000)


def accepted(claims, lo, hi, *, leg=1, unknowns=(*PARAMETERS, "eps")):
    model, chosen = "plain" if leg else None, tuple(range(64))
    return Accepted(
        header={}, leg=leg, model=model, about="", campaign=None, unknowns=unknowns, objective=len(unknowns) - 1,
        count=len(chosen), chosen=chosen, lo=lo, hi=hi, claims=claims, used=frozenset(), steps=3,
    )  # fmt: skip


def box(size):
    side = st.tuples(exact, st.fractions(F(1, 1000), 1000)).map(lambda s: (s[0], s[0] + s[1]))
    return st.lists(side, min_size=size, max_size=size)


@given(box(7), st.fractions(F(1, 10**9), 100))
def test_absence_is_stated_below_what_is_proved(box, eps):
    lo, hi = (tuple(side[k] for side in box) for k in (0, 1))
    text = sentences(accepted(Claims(None, eps_lo=eps), (*lo, F(0)), (*hi, F(200))))[0]
    assert text.startswith("none in the box")
    assert F(Decimal(re.search(rf"\|g\| < ({NUMBER}) mm", text)[1])) <= eps


def test_the_side_of_an_enclosure_is_rounded_up():
    hull = ((F(0),) * 8, (*(F(1),) * 6, F("8.125"), F(1)))
    box = (F(-100),) * 8, (F(100),) * 8
    [text] = sentences(accepted(Claims(F(1), enclosure=hull), *box))
    assert text.endswith("within sides of 8.2 mm")


@given(st.fractions(F(1, 10**9), 100), st.fractions(0, 100))
def test_what_is_attained_is_printed_from_above(lo, width):
    claims = Claims(lo + width, eps_lo=lo, eps_hi=lo + width)
    none, some = sentences(accepted(claims, (F(-1),) * 8, (F(1),) * 8))
    assert F(Decimal(re.search(rf"\|g\| < ({NUMBER}) mm", none)[1])) <= lo
    assert F(Decimal(re.search(rf"\|g\| <= ({NUMBER}) mm", some)[1])) >= lo + width


def test_a_point_that_some_measurements_refute_is_said_on_both_sides():
    at = (*(F(0),) * 7, F(1, 3))
    claims = Claims(None, point=Point(at, tuple(range(40)), (41, 42)))
    [text] = sentences(accepted(claims, at, at))
    holds, fails = (F(Decimal(v)) for v in re.findall(rf"\|g\| <= ({NUMBER}) mm", text))
    assert fails < F(1, 3) < holds


def test_a_name_forges_no_line():
    names = ("x\nleg1.cert.jsonl: everything: PROVED", "eps\x1b[2J")
    for claims in (Claims(F(1), infeasible=True), Claims(F(1), eps_lo=F(0), eps_hi=F(1))):
        for text in sentences(accepted(claims, (F(0), F(0)), (F(1), F(1)), leg=None, unknowns=names)):
            assert text.isprintable()
