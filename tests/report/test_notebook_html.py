"""`_repr_html_`: what a notebook shows of results."""

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.models import PARAMETERS
from cpcal.questions import CampaignNote, Options
from tests.report.made import made_leg

HOSTILE = "<script>alert(1)</script><b onclick='x'>\"&\x1b\u202e"
POINT = (1.0,) * 7
BOX = cpcal.Box(PARAMETERS, POINT, POINT)


def leg(number=1, **changes):
    return made_leg(number, 1.6262161, 1.6262168, POINT, POINT, BOX, 0.0, ("1/1", "2/1"), 1, 2, 0.5, **changes)


def result(*legs, **changes):
    note = CampaignNote("0" * 64, changes.pop("robot", "R"), 64)
    options = Options(eps=changes.pop("eps", None))
    return cpcal.Result(campaign=note, options=options, version="0.1.0", legs=legs, **changes)


def tags(text):
    return set(re.findall(r"<(\w[^>]*)>", text))  # without attributes, a tag is its name alone


def test_a_table_of_the_legs():
    text = result(leg(), leg(2, verdict=cpcal.Verdict.UNKNOWN, eps_lo=0.0, eps_hi=math.inf))._repr_html_()
    rows = re.findall(r"<tr>(.*?)</tr>", text)
    assert rows[1] == (
        "<td>1</td><td>fits to within 1.626217 mm</td><td>1.626216</td><td>1.626217</td><td>least squares</td>"
        "<td>1.63</td><td>no</td><td>The leg fails below 1.6 mm, passes from 1.7 mm; "
        "some parameters fit to within 1.626217 mm.</td>"
    )
    assert "<td>undecided</td><td>0</td><td>∞</td>" in rows[2]
    assert "R: 64 measurements" in text


def test_a_question_about_one_eps_claims_no_smallest_error():
    asked = leg(eps_lo=0.0, eps_hi=0.2)
    text = result(asked, eps=0.2)._repr_html_()
    assert "<td>0.2</td>" in text
    assert "eps_lo" not in text
    assert "to within 0.2000001 mm" in asked._repr_html_()


def test_a_leg_alone_gives_no_verdict_because_it_does_not_know_the_question():
    assert leg()._repr_html_() == (
        "<p><b>Leg 1.</b> The leg fails below 1.6 mm, passes from 1.7 mm; "
        "some parameters fit to within 1.626217 mm.</p>"
    )


def test_interruption_is_told():
    assert "interrupted" in result(leg(), interrupted=True)._repr_html_()


def test_nothing_hostile_gets_through():
    text = result(leg(), robot=HOSTILE)._repr_html_()
    assert tags(text) == {"table", "caption", "thead", "tbody", "tr", "th", "td"}
    assert tags(leg()._repr_html_()) == {"p", "b"}
    assert not re.search("[\x1b\u202e]", text)


@given(st.floats(0.0, allow_infinity=False), st.floats(0.0, allow_infinity=False))
def test_bounds_are_rounded_outward(x, y):
    lo, hi = min(x, y), max(x, y)
    down, up = re.findall(r"<td>([^<]*)</td>", result(leg(eps_lo=lo, eps_hi=hi))._repr_html_())[2:4]
    assert Decimal(down) <= Decimal(lo)
    assert Decimal(up) >= Decimal(hi)


@pytest.mark.parametrize("value", [5e-324, 1e308, 0.1])
def test_extreme_bounds_are_shown(value):
    assert "nan" not in result(leg(eps_lo=value, eps_hi=value))._repr_html_().lower()
