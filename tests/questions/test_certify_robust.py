"""eps* when some measurements may be wrong: found, proved whichever they are, and never above what trying all gives."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

import cpcal
from cpcal.checker import check, check_run
from cpcal.common.errors import InputError, Problem
from cpcal.common.files import write_file
from cpcal.questions import Uncertified, ask, verdict_of
from cpcal.questions import leg as robust
from cpcal.robot import Robot
from cpcal.simulate import simulate
from cpcal.solver.certificate.recording import Recording, UncheckableError


def campaign(measurements, wrong, seed=1, error=3.0):
    good = simulate(seed=seed, extremal=False, random_poses=measurements, factor=0.0, noise=0.02, joint_error=0.05)
    length = good.length.copy()
    length[list(wrong), 0] += error * np.where(np.arange(len(wrong)) % 2, -1.0, 1.0)
    return cpcal.Campaign.of(good.robot, good.position, good.quaternion, length, pose=good.pose, exact=True)


@pytest.mark.parametrize("wrong", [(4,), (2, 9)])
def test_wrong_measurements_are_found_and_proved_with_certificates(wrong, tmp_path):
    asked, how = campaign(18, wrong), {"outliers": len(wrong), "legs": (1,), "certificates": tmp_path}
    found = cpcal.certify(asked, delta=10.0, center="nominal", time_limit=60.0, **how)  # a search without end fails
    (leg,) = found.legs
    assert leg.bracket.left_out == tuple(asked.measurement_ids[k] for k in wrong)
    assert leg.bracket.verdict is cpcal.Verdict.PROVED
    assert 0.0 < leg.bracket.lo < leg.bracket.hi < 0.05
    cpcal.save_result(found, tmp_path)
    assert cpcal.load_result(tmp_path) == found
    (checked,) = check_run(tmp_path)
    assert checked.refused is None
    assert float(checked.robust.lo) == leg.bracket.lo
    assert float(checked.robust.hi) == leg.bracket.hi


def asked_of(folder, **options):
    """One leg of twelve measurements, the fourth of which is wrong."""
    given = {"outliers": 1, "legs": (1,), "delta": 8.0, "center": "nominal", "certificates": folder}
    found = cpcal.certify(campaign(12, (3,), error=0.3), **(given | options))
    cpcal.save_result(found, folder)
    return found.legs[0]


def test_the_weakest_of_the_proofs_is_the_bound(tmp_path, monkeypatch):
    """A bad first guess is refuted at large errors too; the bound is what holds whichever measurement is wrong."""
    usual = asked_of(tmp_path / "usual")
    monkeypatch.setattr(robust, "guessed", lambda question, leg, center: frozenset({0}))
    leg = asked_of(tmp_path / "other")
    levels = [check(tmp_path / "other" / name).claims.eps_lo for name in leg.bracket.proofs]
    assert max(levels) > leg.bracket.hi > leg.bracket.lo == float(min(levels))
    assert leg.bracket.lo == pytest.approx(usual.bracket.lo, rel=1e-4)


def test_a_search_that_time_ended_states_no_bound_and_leaves_no_proofs(tmp_path, monkeypatch):
    """Two searches at a second each, where three do not settle it."""
    monkeypatch.setattr(robust, "time", SimpleNamespace(monotonic=count(0.0).__next__))
    leg = asked_of(tmp_path, time_limit=2.5)
    assert leg.work.nodes == 3
    assert (leg.bracket.lo, leg.bracket.proofs, leg.bracket.verdict) == (0.0, (), cpcal.Verdict.UNKNOWN)
    others = {leg.recommended.certificate, leg.passes_from.certificate}
    assert {path.name for path in tmp_path.glob("*.cert.jsonl")} == {leg.bracket.point_certificate, *others}
    (checked,) = check_run(tmp_path)
    assert (checked.refused, checked.robust.lo, float(checked.robust.hi)) == (None, None, leg.bracket.hi)


def test_without_a_point_nothing_is_called_wrong_and_nothing_passes(tmp_path):
    """In the whole box the legs would be shorter than nothing."""
    asked = campaign(12, (3,))
    known = asked.robot.parameters - np.array([0.0] * 6 + [2000.0])
    asked = replace(asked, robot=Robot.from_parameters("short", known))
    options = {"outliers": 1, "legs": (1,), "delta": 8.0, "center": "nominal", "certificates": tmp_path}
    found = cpcal.certify(asked, **options)
    (leg,) = found.legs
    assert (leg.bracket.point, leg.bracket.hi, leg.bracket.left_out) == (None, np.inf, ())
    assert (leg.bracket.verdict, leg.passes_from) == (cpcal.Verdict.UNKNOWN, None)
    assert verdict_of(found, leg).word != "pass"
    cpcal.save_result(found, tmp_path)
    assert cpcal.load_result(tmp_path) == found
    (checked,) = check_run(tmp_path)
    assert (checked.refused, checked.robust) == (None, None)


def test_proofs_of_which_one_is_missing_leave_no_files(tmp_path, monkeypatch):
    whole = Recording.content

    def content(recording, name, claims):
        if name == "leg1.002.cert.jsonl":
            raise UncheckableError([Problem(name, "would be refused", "")])
        return whole(recording, name, claims)

    monkeypatch.setattr(Recording, "content", content)
    leg = asked_of(tmp_path)
    assert leg.bracket.proofs == ()
    assert leg.bracket.point_certificate is not None
    assert not list(tmp_path.glob("leg1.0*"))


def test_the_bracket_is_that_of_the_best_choice_among_all():
    asked = campaign(12, (3,), error=0.3)
    (leg,) = cpcal.certify(asked, outliers=1, legs=(1,), delta=8.0, center="nominal").legs
    rows = np.arange(len(asked))
    best = np.inf
    for k in rows:
        keep = rows[rows != k]
        part = cpcal.Campaign.of(
            asked.robot, asked.position[keep], asked.quaternion[keep], asked.length[keep], exact=True
        )
        (alone,) = cpcal.certify(part, legs=(1,), delta=8.0, center="nominal", support="none", gap=1e-5).legs
        best = min(best, alone.bracket.hi)
        assert leg.bracket.lo <= alone.bracket.hi * (1.0 + 1e-4)
    assert leg.bracket.hi == pytest.approx(best, rel=1e-3)


def test_a_proof_that_cannot_be_written_takes_the_others_with_it_until_there_is_room(tmp_path, monkeypatch):
    def full(path, content):
        if path.name.endswith(".001.cert.jsonl"):
            raise InputError([])
        return write_file(path, content)

    with monkeypatch.context() as disk:
        disk.setattr(ask, "write_file", full)
        leg = asked_of(tmp_path, delta=2.0)
    assert (leg.certified, leg.not_certified) == (False, Uncertified.UNWRITTEN)
    assert not list(tmp_path.glob("*.cert.jsonl"))
    again = asked_of(tmp_path, delta=2.0, resume=True)
    assert (again.bracket.lo, again.bracket.hi) == (leg.bracket.lo, leg.bracket.hi)
    (checked,) = check_run(tmp_path)
    assert (checked.refused, float(checked.robust.lo), float(checked.robust.hi)) == (
        None,
        leg.bracket.lo,
        leg.bracket.hi,
    )
