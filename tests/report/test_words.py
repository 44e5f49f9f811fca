"""Words of verdicts: what is not proved is not said to be proved, and one leg's doubt is the robot's."""

import math
from dataclasses import replace

import pytest

import cpcal
from cpcal.models import PARAMETERS
from cpcal.questions import Uncertified, VerifiedPoint
from cpcal.report.words import leg_sentence, overall
from cpcal.solver.accounts import bracket_sentence
from cpcal.solver.contract import Verdict
from tests.report.made import made_leg, made_result

BOX = cpcal.Box(PARAMETERS, [0.0] * 7, [1.0] * 7)


@pytest.fixture(scope="module")
def campaign() -> cpcal.Campaign:
    return cpcal.simulate(seed=1, extremal=False, random_poses=9)


def leg(number: int, lo: float, hi: float, **changes: object) -> cpcal.LegResult:
    return made_leg(number, lo, hi, (0.5,) * 7, (0.5,) * 7, BOX, 0.0, (), 1, 1, 0.1, **changes)


def test_a_robot_passes_if_every_leg_does_and_nothing_is_missing(campaign):
    passing, failing, open_ = leg(1, 0.1, 0.2), leg(2, 0.7, 0.8), leg(3, 0.4, 0.6, verdict=Verdict.UNKNOWN)

    def word(*legs: cpcal.LegResult, interrupted: bool = False) -> str:
        return overall(made_result(campaign, *legs, tolerance=0.5, interrupted=interrupted)).word

    assert word(passing, replace(passing, leg=2)) == "PASS"
    assert word(passing, failing) == word(open_, failing, interrupted=True) == "FAIL"
    assert word(passing, open_) == word(passing, interrupted=True) == "UNDECIDED"


def test_a_leg_that_asked_for_a_certificate_and_has_none_says_so(campaign):
    lost = leg(1, 0.1, 0.2, not_certified=Uncertified.INTERRUPTED)
    assert f"Not certified: {Uncertified.INTERRUPTED}." in leg_sentence(made_result(campaign, lost), lost)


@pytest.mark.parametrize(
    ("verdict", "hi", "undecided", "said"),
    [
        (Verdict.PROVED, 0.2, 0, "the gap is closed"),
        (Verdict.UNKNOWN, 0.2, 3, "Stopped at a limit with 3 undecided boxes; both bounds are proved, the gap is open"),
        (Verdict.UNKNOWN, 0.2, 0, "the contractors cannot close the gap"),
        (Verdict.UNKNOWN, math.inf, 0, "No point was proved"),
        (Verdict.REFUTED, math.inf, 0, "No point of the domain satisfies the constraints: proved"),
    ],
)
def test_a_bracket_is_closed_only_where_that_is_proved(verdict, hi, undecided, said):
    assert said in bracket_sentence(verdict, 0.1, hi, floor=0.0, undecided=undecided)


@pytest.mark.parametrize("verdict", Verdict)
def test_at_one_eps_only_a_verdict_is_proved(campaign, verdict):
    one = leg(1, 0.0, 0.5, verdict=verdict)
    said = cpcal.status_of(made_result(campaign, one, eps=0.5), one)
    assert said.endswith(": proved.") is (verdict in (Verdict.PROVED, Verdict.REFUTED))
    assert said.startswith("No x") is (verdict is Verdict.REFUTED)


@pytest.mark.parametrize(
    ("holds", "fails", "verdict"),
    [(5, 0, Verdict.PROVED), (4, 0, Verdict.UNKNOWN), (4, 1, Verdict.REFUTED), (0, 0, Verdict.UNKNOWN)],
)
def test_a_point_is_a_solution_if_it_holds_everywhere(holds, fails, verdict):
    assert VerifiedPoint(0.1, holds, fails, 5).verdict is verdict
