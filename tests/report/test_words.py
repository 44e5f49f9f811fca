"""Words of verdicts: what is not proved is not said to be proved; what to do next is what the cause asks for."""

import dataclasses
import math
from dataclasses import replace

import pytest
import scipy.stats

import cpcal
from cpcal.models import PARAMETERS, PLAIN
from cpcal.questions import Uncertified, VerifiedPoint
from cpcal.report.section import html
from cpcal.report.words import advise, leg_lines, leg_sentence, overall, student
from cpcal.robot import Campaign
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


CAMPAIGN = cpcal.simulate(seed=7, joint_error=0.0, factor=0.0, noise=0.2)


def advised(campaign, **asked):
    result = cpcal.certify(campaign, legs=[2], **asked)
    leg = result.legs[0]
    found = advise(campaign, result, leg, PLAIN)
    return found, cpcal.verdict_of(result, leg)


def test_nothing_is_said_of_a_leg_that_passes():
    found, verdict = advised(CAMPAIGN, tolerance=3.0)
    assert verdict.passes
    assert (found.short, found.wrong) == ("", ())


def test_the_readings_and_not_the_leg_are_blamed_where_no_error_of_it_is_proved():
    good = cpcal.simulate(seed=1, joint_error=0.0)  # each reading may be off by three deviations
    result = cpcal.certify(good, legs=[2], tolerance=0.1)
    (leg,) = result.legs
    found = advise(good, result, leg, PLAIN)
    assert cpcal.verdict_of(result, leg).kind == "undecided"
    assert leg.bracket.lo == 0.0
    assert found.short == "because the readings are too uncertain: measure them more precisely"
    assert "sensors" not in html(leg_lines(result, leg, found))


@pytest.mark.parametrize("rows", [(5,), (40,), (5, 40)])
def test_wrong_readings_are_the_ones_that_are_named(rows):
    length = CAMPAIGN.length.copy()
    length[list(rows), 1] += 4.0
    found, _ = advised(dataclasses.replace(CAMPAIGN, length=length), tolerance=0.5)
    assert sorted(found.wrong) == list(rows)
    assert found.short.startswith(f"because of measurement{'s' * (len(rows) > 1)} {found.wrong[0] + 1}")
    assert found.short.endswith(f": measure {'it' if len(rows) == 1 else 'them'} again")


@pytest.mark.parametrize("freedom", [3, 5, 57, 1000])
def test_the_quantile_of_student_is_scipys_and_never_below(freedom):
    chance = 1.0 - 2e-3 / (freedom + len(PARAMETERS))
    assert 1.0 <= student(chance, freedom) / scipy.stats.t.ppf(chance, freedom) <= 1.05


def test_a_wrong_scale_of_the_sensor_calls_for_the_model_gain():
    found, _ = advised(dataclasses.replace(CAMPAIGN, length=1.02 * CAMPAIGN.length), tolerance=0.1)
    assert found.short == "because of the leg model: use --model gain"
    assert found.wrong == ()


def test_poses_are_asked_for_where_parameters_are_open():
    few = [0] * 9
    same = Campaign.of(
        CAMPAIGN.robot, CAMPAIGN.position[few], CAMPAIGN.quaternion[few], CAMPAIGN.length[few], exact=True
    )
    found, verdict = advised(same, tolerance=1.0)
    assert found.short.endswith("add poses")
    assert "Add poses that show" in found.more
    assert verdict.names
