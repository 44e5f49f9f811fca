"""Ranges of parameters: they hold every point that reaches the tolerance; what is not determined is found out."""

import dataclasses
import json

import numpy as np
import pytest

import cpcal
from cpcal.checker import Refused, check_run
from cpcal.models import PLAIN
from cpcal.questions import verdict_of
from cpcal.questions.bracket import prepared_leg
from cpcal.questions.data_check import determination
from cpcal.questions.leg import MARGIN, range_eps, ranges_of
from cpcal.questions.question import Question
from cpcal.robot.campaign import ARRAYS
from tests.changed import leg_with


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=7, joint_error=1.0, factor=0.0)


@pytest.fixture(scope="module")
def run(campaign, tmp_path_factory):
    """The folder of a run with ranges, and its result."""
    folder = tmp_path_factory.mktemp("run")
    found = cpcal.certify(campaign, legs=[2], ranges=True, certificates=folder)
    cpcal.save_result(found, folder)
    return folder, found


def test_points_that_reach_the_tolerance_are_in_the_ranges_and_the_ranges_are_wider_than_the_enclosure(campaign, run):
    leg = run[1].legs[0]
    assert leg.ranges.eps == MARGIN * leg.bracket.hi
    assert (leg.ranges.box.width > 10.0 * leg.bracket.enclosure.width).all()
    point, rng = np.array(leg.bracket.point), np.random.default_rng(1)
    inside = 0
    for _ in range(20):
        x = point + 1e-3 * leg.ranges.box.width * rng.standard_normal(7)
        if cpcal.certify_point(campaign, 2, x, eps=leg.ranges.eps).verified.verdict is cpcal.Verdict.PROVED:
            assert tuple(x) in leg.ranges.box
            inside += 1
    assert inside > 5


def test_the_checker_ties_the_ranges_to_their_certificate(run, tmp_path):
    folder, found = run
    (checked,) = check_run(folder)
    assert checked.refused is None
    assert checked.proofs[1][1].claims.cap == found.legs[0].ranges.eps
    text = (folder / "result.json").read_text(encoding="utf-8")

    def refused(change):
        data = json.loads(text)
        change(data["legs"][0]["ranges"])
        (folder / "result.json").write_text(json.dumps(data), encoding="utf-8")
        return check_run(folder)[0].refused

    def narrower(ranges):
        ranges["box"]["hi"][3] -= 1e-3

    try:
        assert "enclosure" in refused(narrower)
        assert "eps" in refused(lambda ranges: ranges.update(eps=2.0 * ranges["eps"]))
        with pytest.raises(Refused, match="ranges-leg2"):
            refused(lambda ranges: ranges.update(certificate="leg2.cert.jsonl"))
        assert "parameters" in refused(lambda ranges: ranges["box"]["names"].reverse())
    finally:
        (folder / "result.json").write_text(text, encoding="utf-8")


def test_there_are_none_where_no_tolerance_is_reached(campaign, run):
    lost = leg_with(run[1].legs[0], point=None, eps_hi=float("inf"), verdict=cpcal.Verdict.UNKNOWN)
    assert ranges_of(prepared_leg(Question(campaign=campaign, options=run[1].options), 2), lost) is None


def test_the_tolerance_fits_the_question(run):
    options, hi = run[1].options, run[1].legs[0].bracket.hi
    asked = dataclasses.replace(options, eps=0.7)
    assert range_eps(asked, hi) == 0.7
    assert range_eps(asked, hi, refuted=True) is None
    assert range_eps(options, np.inf) is None
    assert range_eps(options, hi) == MARGIN * hi
    assert range_eps(dataclasses.replace(options, tolerance=2.0 * hi), hi) == 2.0 * hi
    assert range_eps(dataclasses.replace(options, tolerance=0.5 * hi), hi) == MARGIN * hi


whole = cpcal.simulate(seed=1, joint_error=0.0, runs=40)


def part(rows):
    rows = np.asarray(rows)
    radii = {name: getattr(whole, name)[rows] for name in ARRAYS[3:]}
    return cpcal.Campaign.of(whole.robot, *(getattr(whole, name)[rows] for name in ARRAYS[:3]), **radii)


def of(rows):
    campaign = part(rows)
    return determination(campaign, 1, campaign.robot.parameters[0], PLAIN)


names = whole.measurement_ids
first = [k for k, name in enumerate(names) if name.startswith(names[0].split("/")[0])]


@pytest.mark.parametrize("rows", [[0], [0] * 40, first])
def test_one_pose_read_any_number_of_times_determines_next_to_nothing(rows):
    found = of(rows)
    assert found.rank <= 2
    assert found.sentence
    assert "l" in found.undetermined


def test_identical_measurements_are_no_pass():
    result = cpcal.certify(part([0] * 40), legs=[1], tolerance=400.0, support="none")
    assert verdict_of(result, result.legs[0]).kind == "undetermined"


def test_poses_of_full_rank_that_leave_wide_ranges_are_no_pass():
    """They are not shown to determine l: at the smallest error it may lie in more than half of the box."""
    campaign = cpcal.simulate(seed=1, joint_error=0.0, extremal=False, random_poses=16)
    result = cpcal.certify(campaign, legs=[1], tolerance=400.0, support="none")
    leg = result.legs[0]
    assert not leg.determination.sentence
    assert leg.bracket.enclosure["l"].width > 100.0
    verdict = verdict_of(result, leg)
    assert verdict.kind == "undetermined"
    assert "l" in verdict.names
    assert "l (" in verdict.sentence
