"""The paper's timeout method: its rules on solvers made for the purpose, and agreement with branch and bound."""

from pathlib import Path

import numpy as np
import pytest

import cpcal
from contractors import HC4
from cpcal.checker import check
from cpcal.solver.accounts import TimeoutAnswer, Trial
from cpcal.solver.contract import Limits, Repeat, Then
from cpcal.solver.network import ConstraintNetwork, sqr
from cpcal.solver.optimize.timeout import TimeoutOutcome, ask, timeout
from cpcal.solver.optimize.witness import Witness, WitnessProver
from cpcal.solver.search.passes import Contracting, LargestFirst


def play(answers: str, *, lo: float = 0.0, hi: float = 1.0) -> list[Trial]:
    """The method on a solver that gives these answers: i(nfeasible), t(imeout), f(ound, at the eps asked)."""
    given = iter(answers)

    def solve(eps: float, seconds: float) -> TimeoutOutcome:
        answer = next(given)
        if answer == "f":
            return TimeoutOutcome(TimeoutAnswer.FOUND, Witness(np.array([eps]), eps))
        return TimeoutOutcome(TimeoutAnswer.INFEASIBLE if answer == "i" else TimeoutAnswer.TIMEOUT)

    found = timeout(solve, lo=lo, hi=hi, limits=Limits(gap=1e-3, seconds=60.0), delay=1.0)
    return [next(found) for _ in answers]


@pytest.mark.parametrize("width", [0.1, 0.5, 10.0])
def test_a_box_that_is_kept_may_hold_the_planted_point_and_is_not_infeasible(width: float) -> None:
    """(x - 0.3)^2 + (y - 0.3)^2 <= eps up to 1e-6: middles of coarse boxes are points of a larger eps only."""
    net = ConstraintNetwork()
    x, eps = net.variable("x", 2, domain=(-1, 1)), net.variable("eps", domain=(0, 10))
    net.add(sqr(x - 0.3).sum() <= eps)
    domain = net.domain.replace("eps", hi=1e-6)
    assert [0.3, 0.3, 1e-6] in domain
    prover = WitnessProver(net, 2)
    coarse = LargestFirst(width, skip=("eps",))
    found = ask(domain, Contracting([("nothing", Repeat(Then()))]), coarse, prover, 60.0)
    assert found.answer is TimeoutAnswer.TIMEOUT
    fine = ask(domain, Contracting([("hc4", HC4(net))]), LargestFirst(1e-4), prover, 60.0)
    assert fine.answer is TimeoutAnswer.FOUND
    assert fine.witness is not None
    assert fine.witness.value <= 1e-6
    apart = domain.replace("x[0]", lo=0.5)
    assert ask(apart, Contracting([("hc4", HC4(net))]), coarse, prover, 60.0).answer is TimeoutAnswer.INFEASIBLE


@pytest.mark.parametrize(
    ("answers", "asked", "brackets", "delays"),
    [
        ("iif", [0.5, 0.75, 0.875], [(0.5, 1.0), (0.75, 1.0), (0.75, 0.875)], [1.0] * 3),
        ("tti", [0.5, 0.25, 0.125], [(0.0, 1.0), (0.0, 1.0), (0.125, 1.0)], [1.0] * 3),
        ("ttttt", [0.5, 0.25, 0.125, 0.0625, 0.5], [(0.0, 1.0)] * 5, [1.0] * 4 + [2.0]),  # back to the average
    ],
)
def test_infeasible_goes_up_found_and_timeout_down_and_too_close_doubles_the_delay(answers, asked, brackets, delays):
    trials = play(answers)
    assert [t.eps for t in trials] == asked
    assert [(t.lo, t.hi) for t in trials] == brackets
    assert [t.delay for t in trials] == delays


def test_its_infeasible_answers_carry_certificates(tmp_path: Path) -> None:
    cpcal.save_campaign(cpcal.simulate(seed=4, joint_error=3.0, factor=0.0, random_poses=14, extremal=False), tmp_path)
    campaign = cpcal.load_campaign(tmp_path)
    question = {"legs": [1], "delta": 10.0, "method": "timeout", "time_limit": 30.0, "gap": 0.2}
    leg = cpcal.certify(campaign, certificates=tmp_path / "run", **question).legs[0]
    infeasible = [t for t in leg.work.trials if t.answer is TimeoutAnswer.INFEASIBLE]
    assert infeasible
    assert all(t.checked for t in infeasible)
    assert leg.bracket.certificate is not None
    claims = check(tmp_path / "run" / leg.bracket.certificate).claims
    assert claims.infeasible
    assert float(claims.eps_lo or 0) == leg.bracket.lo > 0
    assert claims.point is not None
    assert float(claims.point.at[7]) == leg.bracket.hi
    cpcal.save_result(cpcal.certify(campaign, **question), tmp_path, campaign)
    assert cpcal.load_result(tmp_path).legs[0].work.trials


def test_without_a_certificate_no_answer_is_checked_and_none_is_said_to_be() -> None:
    campaign = cpcal.simulate(seed=4, joint_error=3.0, factor=0.0, random_poses=14, extremal=False)
    result = cpcal.certify(
        campaign, legs=[1], delta=0.0, contractors=["hc4"], method="timeout", time_limit=30.0, gap=1e-2
    )
    leg = result.legs[0]
    assert any(t.answer is TimeoutAnswer.INFEASIBLE for t in leg.work.trials)
    assert not any(t.checked for t in leg.work.trials)
    assert leg.bracket.verdict is cpcal.Verdict.PROVED
    assert "closed" not in cpcal.status_of(result, leg)
    assert "within the relative gap of 0.01" in cpcal.status_of(result, leg)
    assert leg.bracket.hi - leg.bracket.lo <= 1e-2 * leg.bracket.hi
