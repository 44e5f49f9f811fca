"""A certificate whose check would pass the checker's limit is not written, and the result says so."""

import pytest

import cpcal
from cpcal.checker import certificate, check, check_run
from cpcal.checker.files import Lines
from cpcal.questions import Uncertified
from cpcal.solver.certificate import recording

LOW = 100  # of work: less than any certificate of a leg takes


@pytest.fixture(scope="module")
def campaign():
    return cpcal.simulate(seed=1, joint_error=1.0, factor=0.0, extremal=False, random_poses=12)


def limited(monkeypatch, work):
    monkeypatch.setattr(recording, "WORK", work)
    monkeypatch.setattr(recording, "leg_work", lambda legs, measurements: work)


@pytest.mark.parametrize("method", ["bound", "timeout"])
def test_the_result_says_not_certified_instead(campaign, tmp_path, monkeypatch, method):
    options = {"legs": [1], "delta": 0.5, "method": method, "time_limit": 5.0 if method == "timeout" else None}
    limited(monkeypatch, LOW)
    result = cpcal.certify(campaign, certificates=tmp_path, **options)
    leg = result.legs[0]
    assert leg.not_certified is Uncertified.UNCHECKABLE
    assert not leg.certified
    assert leg.bracket.hi < float("inf")
    assert not list(tmp_path.glob("*.cert.jsonl"))


def test_the_limit_is_that_of_the_checker(campaign, tmp_path, monkeypatch):
    """What is written the checker affords, down to the last unit of work."""
    whole = cpcal.certify(campaign, legs=[1], delta=0.5, certificates=tmp_path / "whole").legs[0]
    spent = []

    class Counted(Lines):
        def spend(self, work):
            spent.append(work)
            super().spend(work)

    monkeypatch.setattr(certificate, "Lines", Counted)
    check(tmp_path / "whole" / whole.bracket.certificate)
    for work, certified in ((sum(spent), True), (sum(spent) - 1, False)):
        limited(monkeypatch, work)
        leg = cpcal.certify(campaign, legs=[1], delta=0.5, certificates=tmp_path / str(work)).legs[0]
        assert leg.certified is certified
        assert (leg.bracket.lo, leg.bracket.hi, leg.bracket.point) == (
            whole.bracket.lo,
            whole.bracket.hi,
            whole.bracket.point,
        )


def test_a_robust_bound_without_one_of_its_proofs_is_not_certified(campaign, tmp_path, monkeypatch):
    limited(monkeypatch, LOW)
    found = cpcal.certify(campaign, outliers=1, legs=[1], delta=0.5, certificates=tmp_path)
    cpcal.save_result(found, tmp_path)
    assert found.legs[0].bracket.lo > 0.0
    (leg,) = check_run(tmp_path)
    assert leg.refused is None
    assert leg.robust is None
    assert not list(tmp_path.glob("*.cert.jsonl"))
