"""`cpcal verify` accepts what certify wrote, refuses what was touched; sentences on certificates are true."""

import dataclasses
import json
import re
import shutil
from decimal import Decimal
from fractions import Fraction as F

import pytest
from hypothesis import given
from hypothesis import strategies as st

import cpcal
from cpcal.checker import Refused
from cpcal.checker.certificate import Accepted, Claims, Point
from cpcal.checker.files import A_FILE
from cpcal.checker.run import certificates_of
from cpcal.cli.claims import sentences
from cpcal.files.folders import save_campaign_json
from cpcal.models import PARAMETERS
from cpcal.simulate import simulate
from tests.cli.command import done, run
from tests.remembered import verify_once


def test_a_bound_that_is_not_proved_is_refused(genuine, small, tmp_path):
    lines = (genuine / "leg2.cert.jsonl").read_text().splitlines()
    claims = json.loads(lines[1])
    claims["epsilon"]["lo"] = claims["cap"]
    lines[1] = json.dumps(claims)
    forged = tmp_path / "forged.cert.jsonl"
    forged.write_text("\n".join(lines) + "\n")
    shutil.copy(genuine / "campaign.json", tmp_path)
    said = done("verify", forged, "--campaign", small, status=1)
    assert "REFUSED" in said
    assert "still open below eps_lo" in said
    assert "PROVED" in done("verify", genuine / "leg2.cert.jsonl", "--campaign", small)


def test_constraints_of_ones_own_need_no_campaign(tmp_path):
    net = cpcal.Network()
    x, t = net.variable("x", 2, (-4.0, 4.0)), net.variable("t", (), (0.0, 9.0))
    net.add(cpcal.norm(x - 3.0) <= t)
    net.add(cpcal.norm(x + 3.0) <= t)
    net.minimize(t, certificate=tmp_path / "own.cert.jsonl")
    said = done("verify", tmp_path / "own.cert.jsonl")
    assert "own.cert.jsonl: points that satisfy all 2 constraints: none in the box with t < 4.24" in said
    assert "some in the box with t <= 4.24" in said
    assert said.splitlines()[-1] == "1 of 1 certificates hold; nothing is refused"


@pytest.mark.parametrize(
    "asked",
    [
        ["--eps", "5"],
        ["--eps", "1e-3"],
        ["--support", "none"],
        ["--tolerance", "5"],
        ["--method", "timeout", "--time-limit", "5", "--gap", "0.5"],
        ["--time-limit", "1e-3"],
        ["--contractors", "hc4,lifted"],
        ["--model", "gain"],
        ["--delta", "0"],
    ],
    ids=" ".join,
)
def test_whatever_was_asked_an_honest_run_is_accepted(asked, small, tmp_path, monkeypatch):
    verify_once(monkeypatch)  # no process begins
    outcome = run("certify", small, "-o", tmp_path, "--legs", "1", "--delta", "0.5", "--gap", "1e-2", *asked)
    assert outcome.exit_code in (0, 1), outcome.output
    checked = run("verify", tmp_path)
    certified = cpcal.load_result(tmp_path).legs[0].certified
    assert checked.exit_code == (0 if certified else 2), checked.output
    assert "REFUSED" not in checked.output
    done("report", tmp_path)


def test_all_certificates_of_a_folder_share_one_budget(tmp_path, monkeypatch, genuine_run):
    """Each by itself costs less than half of what they may cost together."""
    genuine_run("fits", tmp_path)
    folder = tmp_path / "run"
    among = certificates_of(folder)
    before = among.budget.left
    for name in among.names:
        among.accepted(name)
        assert before - among.budget.left >= A_FILE
    whole, legs = before - among.budget.left, among.campaign.legs
    monkeypatch.setattr("cpcal.checker.run.leg_work", lambda *_: -(-whole // legs))
    done("verify", folder)
    monkeypatch.setattr("cpcal.checker.run.leg_work", lambda *_: whole // legs - 1)
    said = done("verify", folder, status=1)
    refused = [line for line in said.splitlines() if "takes more work than the" in line]
    assert [line.split(":")[0] for line in refused] == [max(among.names)]
    count = len(among.names)
    assert f"{count - 1} of {count} certificates hold, 1 REFUSED: there is no verdict" in said


def test_it_prints_a_line_a_certificate_and_ends_with_the_verdict(tmp_path):
    good = simulate(seed=3, extremal=False, random_poses=12, factor=0.0)
    length = good.length.copy()
    length[4, 2] += 3.0
    cpcal.save_campaign(dataclasses.replace(good, length=length), tmp_path / "c")
    done("certify", tmp_path / "c", "-o", tmp_path / "r", "--legs", "2,3", "--tolerance", "0.5", status=1)
    lines = done("verify", tmp_path / "r").splitlines()
    names = {line.split(": ")[0] for line in lines[:-1] if ".cert.jsonl: " in line}
    said = [line for line in lines[:-1] if not line.startswith("Not asked about")]
    assert names <= {path.name for path in (tmp_path / "r").glob("*.cert.jsonl")}
    assert len(said) == len(names)
    count = len(list((tmp_path / "r").glob("*.cert.jsonl")))
    assert lines[-1] == f"{count} of {count} certificates hold; verdict: FAIL (leg 3)"


def test_a_folder_that_names_many_files_is_refused_before_they_are_read(tmp_path):
    """A certificate of a hundred bytes counts as a millisecond, and the campaign is read once for all of them."""
    save_campaign_json(cpcal.simulate(seed=4, factor=0.0), tmp_path)
    for k in range(30):
        (tmp_path / f"{k}.cert.jsonl").write_text("{}\n")
    among = certificates_of(tmp_path, work=25 * A_FILE)
    for k, name in enumerate(sorted(among.names)):
        with pytest.raises(Refused, match="more work than" if k >= 24 else "format"):
            among.accepted(name)


# `cpcal certify --outliers`.


@pytest.fixture(scope="module")
def robust(tmp_path_factory):
    good = simulate(seed=1, extremal=False, random_poses=14, factor=0.0, noise=0.02, joint_error=0.05)
    length = good.length.copy()
    length[5, 0] += 2.0
    where = tmp_path_factory.mktemp("robust")
    made = cpcal.Campaign.of(good.robot, good.position, good.quaternion, length, pose=good.pose, exact=True)
    cpcal.save_campaign(made, where / "campaign")
    said = done("certify", where / "campaign", "-o", where / "out", "--outliers", "1", "--legs", "1")
    assert "r005/1" in said
    return where / "out"


def test_what_was_written_is_proved_again(robust):
    said = done("verify", robust)
    assert "leg 1, at most 1 wrong: PROVED, eps >= 0.0" in said  # not the 2 mm of the wrong one
    assert "leaving out r005/1" in said


@pytest.mark.parametrize("what", ["nothing", "empty"])
def test_nothing_to_check_is_unusable(tmp_path, what):
    (tmp_path / "empty").mkdir()
    assert run("verify", tmp_path / what).exit_code == 2


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
