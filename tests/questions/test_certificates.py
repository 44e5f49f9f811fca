"""Certificates prove what the result says; a saved run holds its campaign; none is written that no check ends."""

import shutil
from collections.abc import Callable
from fractions import Fraction as F
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import cpcal
from cpcal.checker import Accepted, check, check_run, hand_eye
from cpcal.checker.files import WORK, Budget
from cpcal.checker.hand_eye import HandEyeCertificates, check_hand_eye, run_budget
from cpcal.cli import app
from cpcal.files import load_campaign_json
from cpcal.models.frames import exact_study
from cpcal.models.hand_eye import simulate_hand_eye, study_json
from cpcal.questions import Uncertified, save_result
from cpcal.questions.hand_eye import Within, certify_hand_eye, save_hand_eye_result
from cpcal.solver.certificate import recording

SMALL: dict[str, Any] = {"seed": 1, "extremal": False, "random_poses": 16}
Asked = Callable[..., tuple[cpcal.LegResult, Path]]


@pytest.fixture
def asked(tmp_path: Path) -> Asked:
    """Simulate, save, certify leg 1 with certificates; the leg as result.json says it, and the run."""

    def ask(sim: dict[str, Any], **options: Any) -> tuple[cpcal.LegResult, Path]:
        cpcal.save_campaign(cpcal.simulate(**sim), tmp_path / "campaign")
        run = tmp_path / "run"
        campaign = cpcal.load_campaign(tmp_path / "campaign")
        result = cpcal.certify(campaign, **({"legs": [1], "certificates": run, "delta": 2.0} | options))
        save_result(result, run, campaign)
        return cpcal.load_result(run).legs[0], run

    return ask


def accepted(run: Path, name: str | None) -> Accepted:
    assert name is not None
    (leg,) = check_run(run)
    assert leg.refused is None
    found = check(run / name)
    assert found == leg.proofs[0][1]
    return found


def agrees(leg: cpcal.LegResult, found: Accepted) -> None:
    """The bracket, the point and the enclosure of the result, bit by bit."""
    claims = found.claims
    assert (found.leg, found.chosen) == (leg.leg, tuple(range(found.count)))
    assert claims.eps_lo == F(leg.bracket.lo)
    assert claims.eps_hi == claims.cap == F(leg.bracket.hi)
    assert claims.point is not None
    assert leg.bracket.point is not None
    assert claims.point.at == (*map(F, leg.bracket.point), F(leg.bracket.hi))
    assert claims.point.holds == found.chosen
    assert claims.enclosure is not None
    for side, values in zip(claims.enclosure, (leg.bracket.enclosure.lo, leg.bracket.enclosure.hi), strict=True):
        assert side[:-1] == tuple(F(float(v)) for v in values)
    for a, b, c, d in zip(found.lo, *claims.enclosure, found.hi, strict=True):
        assert a <= b <= c <= d


@pytest.mark.parametrize(
    ("joint_error", "factor", "model"),
    [(10.0, 0.0, "plain"), (10.0, 3.0, "plain"), (0.0, 3.0, "plain"), (10.0, 3.0, "gain"), (10.0, 3.0, "lateral")],
)
def test_the_certificate_says_what_the_result_says(asked: Asked, joint_error: float, factor: float, model: str) -> None:
    leg, run = asked(SMALL | {"joint_error": joint_error, "factor": factor}, model=model)
    assert leg.bracket.certificate == "leg1.cert.jsonl"
    found = accepted(run, leg.bracket.certificate)
    agrees(leg, found)
    assert (found.model, found.unknowns) == (model, (*leg.bracket.enclosure.names, "eps"))
    assert leg.bracket.verdict is cpcal.Verdict.PROVED
    assert (leg.bracket.lo == 0.0) == (joint_error == 0.0)


def test_the_same_bytes_twice_and_for_one_leg_or_more(tmp_path: Path) -> None:
    cpcal.save_campaign(cpcal.simulate(**SMALL, joint_error=10.0, factor=0.0), tmp_path / "campaign")
    campaign = cpcal.load_campaign(tmp_path / "campaign")

    def written(name: str, legs: list[int]) -> dict[str, bytes]:
        cpcal.certify(campaign, legs=legs, delta=2.0, certificates=tmp_path / name)
        return {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}

    both = written("both", [1, 2])
    of = {k: {f"leg{k}{kind}.cert.jsonl" for kind in ("", ".passes", ".recommended")} for k in (1, 2)}
    assert set(both) == {"campaign.json", *of[1], *of[2]}
    assert written("again", [1, 2]) == both
    kept = {"campaign.json": both["campaign.json"]}
    assert written("one", [2]) == kept | {name: both[name] for name in of[2]}
    # an earlier run's certificates do not stay
    assert written("both", [1]) == kept | {name: both[name] for name in of[1]}


CAMPAIGN = cpcal.simulate(seed=1, extremal=False, random_poses=8, joint_error=1.0, factor=0.0)


@pytest.fixture(scope="module")
def result():
    return cpcal.certify(CAMPAIGN, legs=[1], delta=0.5, eps=5.0, support="none")


def test_a_saved_run_needs_nothing_else_wherever_it_is_moved(result, tmp_path):
    cpcal.save_result(result, tmp_path / "run", CAMPAIGN)
    run = shutil.move(tmp_path / "run", tmp_path / "elsewhere")
    assert cpcal.load_result(run) == result
    assert load_campaign_json(run) == CAMPAIGN
    assert CliRunner().invoke(app, ["report", str(run)]).exit_code == 0


def test_a_result_is_not_saved_without_its_campaign(result, tmp_path):
    with pytest.raises(cpcal.InputError, match=r"campaign\.json"):
        cpcal.save_result(result, tmp_path / "run")
    with pytest.raises(cpcal.InputError, match="another campaign"):
        cpcal.save_result(result, tmp_path / "run", cpcal.simulate(seed=2))
    assert not (tmp_path / "run").exists()
    cpcal.save_result(result, tmp_path / "run", CAMPAIGN)
    other = cpcal.certify(cpcal.simulate(seed=2), legs=[1], delta=0.5, eps=5.0, support="none")
    with pytest.raises(cpcal.InputError, match="another campaign"):
        cpcal.save_result(other, tmp_path / "run")
    assert cpcal.load_result(tmp_path / "run") == result


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
    leg = cpcal.certify(campaign, certificates=tmp_path, **options).legs[0]
    assert leg.not_certified is Uncertified.UNCHECKABLE
    assert not leg.certified
    assert leg.bracket.hi < float("inf")
    assert not list(tmp_path.glob("*.cert.jsonl"))


def test_the_limit_is_that_of_the_checker(campaign, tmp_path, monkeypatch):
    """What is written the checker affords, down to the last unit of work; it spends less on a point without doubts."""
    whole = cpcal.certify(campaign, legs=[1], delta=0.5, certificates=tmp_path / "whole").legs[0]
    budget = Budget(WORK)
    check(tmp_path / "whole" / whole.bracket.certificate, work=budget)
    counted = Budget(near := 2 * (WORK - budget.left))  # so little that the writer counts
    monkeypatch.setattr(recording, "Budget", lambda most: counted if most == near else Budget(most))
    limited(monkeypatch, near)
    cpcal.certify(campaign, legs=[1], delta=0.5, certificates=tmp_path / "near")
    spent = near - counted.left
    assert WORK - budget.left <= spent
    for work, certified in ((spent, True), (spent - 1, False)):
        limited(monkeypatch, work)
        leg = cpcal.certify(campaign, legs=[1], delta=0.5, certificates=tmp_path / str(work)).legs[0]
        assert leg.certified is certified
        assert all(getattr(leg.bracket, at) == getattr(whole.bracket, at) for at in ("lo", "hi", "point"))


def test_a_robust_bound_without_one_of_its_proofs_is_not_certified(campaign, tmp_path, monkeypatch):
    limited(monkeypatch, LOW)
    found = cpcal.certify(campaign, outliers=1, legs=[1], delta=0.5, certificates=tmp_path)
    cpcal.save_result(found, tmp_path)
    assert found.legs[0].bracket.lo > 0.0
    (leg,) = check_run(tmp_path)
    assert leg.refused is None
    assert leg.robust is None
    assert not list(tmp_path.glob("*.cert.jsonl"))


def test_a_hand_eye_run_that_verify_would_refuse_for_its_work_says_so_down_to_the_last_unit(tmp_path, monkeypatch):
    study, box = simulate_hand_eye(images=4, corners=(3, 3), pitch=80.0, seed=5).study, Within(50.0, 1.5)

    def certified(work):
        monkeypatch.setattr(hand_eye, "_WORK", work)
        folder = tmp_path / str(work)
        folder.mkdir()
        (folder / "study.json").write_bytes(study_json(study))
        result = certify_hand_eye(study, within=box, certificates=folder, time_limit=0.0)
        save_hand_eye_result(result, folder)
        refused = any("`cpcal verify` will refuse this run" in remark for remark in result.remarks)
        return folder, refused, all(accepted for accepted, _ in check_hand_eye(folder))

    budget, (folder, *answers) = run_budget(len(study.image)), certified(10**8)
    assert answers == [False, True]
    checked = HandEyeCertificates(folder, exact_study(study), sha256(study_json(study)).hexdigest(), budget)
    for path in folder.glob("*.cert.jsonl"):
        checked.accepted(path.name)
    spent = budget.most - budget.left
    assert certified(spent)[1:] == (False, True)
    assert certified(spent - 1)[1:] == (True, False)
