"""The verdict on a leg: a pass only for what is proved and tested, each kind a type, a word and a colour of its own."""

import math
import re
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.cli.certify import STYLES
from cpcal.questions import CampaignNote, Determination, Options, PassesFrom, Recommended, verdict_of
from cpcal.solver.contract import Verdict
from tests.changed import leg_with

NAMES = ("a_x", "a_y", "a_z", "b_x", "b_y", "b_z", "l")
POOR = Determination(measurements=40, of=7, rank=1, undetermined=("a_x", "l"))
BARE = Determination(measurements=7, of=7, rank=7)
RICH = Determination(measurements=64, of=7, rank=7)

lengths = st.floats(0.0, 1e6)


def judged(lo, hi, largest=math.inf, *, tolerance=None, eps=None, verdict=Verdict.PROVED, determination=RICH, **others):
    point = (0.0,) * 7 if math.isfinite(hi) else None
    enclosure = cpcal.Box(NAMES, *others.get("enclosure", ([0.0] * 7, [0.0] * 7)))
    leg = leg_with(
        None, leg=1, verdict=verdict, eps_lo=lo, eps_hi=hi, point=point, center=(0.0,) * 7, enclosure=enclosure,
        floor=0.0, support=(), nodes=1, programs=1, seconds=0.1, determination=determination,
        pending=others.get("pending", 0), ranges=others.get("ranges"),
        recommended=Recommended((0.0,) * 7, "least squares", largest),
        passes_from=None if math.isinf(largest) else PassesFrom(largest, (0.0,) * 7),
    )  # fmt: skip
    asked = {name: others[name] for name in ("delta", "method", "time_limit") if name in others}
    options = Options(eps=eps, tolerance=tolerance, **asked)
    result = cpcal.Result(campaign=CampaignNote("0" * 64, "R", 64), options=options, version="0", legs=(leg,))
    return verdict_of(result, leg)


@given(lengths, lengths, lengths, lengths, st.sampled_from(Verdict))
def test_a_pass_is_proved_for_all_readings_and_a_fail_for_all(x, y, z, tolerance, ended):
    lo, hi, largest = sorted((x, y, z))
    verdict = judged(lo, hi, largest, tolerance=tolerance, verdict=ended)
    assert verdict.kind == ("explained" if largest <= tolerance else "unexplained" if lo > tolerance else "undecided")


@given(lengths, lengths, lengths, st.none() | lengths, st.sampled_from(Verdict))
def test_every_number_in_a_sentence_is_on_the_safe_side_and_on_its_side_of_the_tolerance(x, y, z, tolerance, ended):
    lo, hi, largest = sorted((x, y, z))
    verdict = judged(lo, hi, largest, tolerance=tolerance, verdict=ended)
    said = f"{verdict.sentence} {verdict.thresholds}"
    for pattern, bound, up in (
        (r"right to within (\S+) mm", largest, True),
        (r"passes from (\S+) mm", largest, True),
        (r"parameters fit to within (\S+) mm", hi, True),
        (r"fails below (\S+) mm", lo, False),
    ):
        for text in re.findall(pattern, said):
            number = Fraction(Decimal(text))
            assert number >= Fraction(bound) if up else number <= Fraction(bound)
            if tolerance is not None:
                assert (float(text) > tolerance) == (bound > tolerance) or abs(bound - tolerance) <= 1e-15 * bound
    for text in re.findall(r"^(?:Pass|Fail|Undecided) at (\S+) mm", said):
        assert float(text) == tolerance


@pytest.mark.parametrize("tolerance", [None, 0.0, 0.5, 1e9])
@pytest.mark.parametrize("poor", [POOR, BARE])
def test_poor_data_pass_at_no_tolerance(poor, tolerance):
    for lo, hi in ((0.0, 0.0), (0.0, 128.7)):
        verdict = judged(lo, hi, 0.0, tolerance=tolerance, determination=poor)
        assert verdict.kind == "undetermined"
        assert "no test of the model" in verdict.sentence
        assert verdict.sentence.startswith(poor.sentence)
    assert "a_x, l" in judged(0.0, 0.0, determination=POOR).sentence


WIDE = ([0.0, 0.0, -64.4, 0.0, 0.0, 0.0, 0.0], [1.0, 50.0, 64.3, 9.0, 0.0, 0.0, 100.1])


@pytest.mark.parametrize("tolerance", [None, 0.0, 0.5, 1e9])
@pytest.mark.parametrize("ended", [Verdict.PROVED, Verdict.UNKNOWN])  # unknown: a second-order effect ended the search
def test_ranges_of_more_than_half_of_the_box_are_no_pass_and_their_parameters_are_named(tolerance, ended):
    verdict = judged(0.0, 0.0, 0.0, tolerance=tolerance, enclosure=WIDE, verdict=ended)
    assert verdict.kind == "undetermined"
    assert verdict.names == ("a_z", "l")
    assert "a_z (130 mm), l (110 mm)" in verdict.sentence  # rounded up: 128.7 and 100.1
    assert verdict.sentence.endswith(
        "within the stated reading uncertainty, so many very different parameters may fit."
    )
    assert "not shown to determine" in verdict.sentence


@pytest.mark.parametrize(
    "known",
    [
        {"enclosure": ([-50.0] * 7, [50.0] * 7)},  # not more than half
        {"enclosure": WIDE, "pending": 3, "verdict": Verdict.UNKNOWN},  # a limit ended the search, not the data
        {"enclosure": ([-10.0] * 7, [10.0] * 7), "delta": 10.0},  # the box states the parameters by itself
        {"enclosure": WIDE, "method": "timeout", "time_limit": 1.0},  # which encloses nothing
    ],
)
def test_ranges_that_are_wide_for_another_reason_leave_a_pass(known):
    assert judged(0.0, 0.2, 0.4, tolerance=0.5, **known).kind == "explained"


@pytest.mark.parametrize("poor", [{"enclosure": WIDE}, {"determination": POOR}])
def test_poor_data_can_still_refute(poor):
    assert judged(2.0, 3.0, tolerance=1.0, **poor).kind == "unexplained"


def test_without_a_tolerance_an_error_is_neither_pass_nor_fail():
    verdict = judged(1.1, 1.1)
    assert verdict.kind == "bounded"
    assert verdict.word == "fits to within 1.100001 mm"
    assert "proved" not in verdict.word
    assert judged(0.0, 0.0).kind == "explained"


def test_an_open_bracket_is_undecided():
    verdict = judged(0.0, 128.7, verdict=Verdict.UNKNOWN)
    assert verdict.kind == "undecided"
    assert judged(0.3, 0.31, verdict=Verdict.UNKNOWN).kind == "undecided"
    assert judged(0.0, math.inf, verdict=Verdict.UNKNOWN).kind == "undecided"


def test_an_error_that_was_asked_about_says_nothing_of_smaller_ones():
    assert "better" not in judged(0.4, 0.4, eps=0.4).sentence
    refuted = judged(math.inf, math.inf, eps=0.1, verdict=Verdict.REFUTED)
    assert refuted.kind == "unexplained"
    assert refuted.sentence == "No parameters fit to within 0.1 mm."
    assert judged(math.inf, math.inf, eps=0.1, tolerance=0.5, verdict=Verdict.REFUTED).kind == "undecided"
    assert judged(0.4, 0.4, eps=0.4, tolerance=0.1).kind == "undecided"
    for eps in (0.0, 0.4):
        assert judged(eps, math.inf, eps=eps, verdict=Verdict.UNKNOWN).kind == "undecided"


def test_every_kind_has_a_word_and_a_colour_of_its_own():
    kinds = ["explained", "unexplained", "bounded", "undecided", "undetermined"]
    assert set(STYLES) == {*kinds, "uncompared"}
    assert len({STYLES[kind] for kind in kinds}) == 5
    assert STYLES["uncompared"] != STYLES["explained"]
    found = [
        judged(0.0, 1.0, 1.5, tolerance=2.0), judged(3.0, 4.0, tolerance=2.0), judged(1.0, 1.0),
        judged(1.0, 1.5, 3.0, tolerance=2.0), judged(0.0, 1.0, tolerance=2.0, determination=POOR),
    ]  # fmt: skip
    assert [verdict.kind for verdict in found] == kinds
    assert len({verdict.word for verdict in found}) == 5
