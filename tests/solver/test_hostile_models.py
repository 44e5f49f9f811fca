"""Models that are asked too much, or wrongly: a right answer, checked by hand, or a clear error."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpcal
from cpcal.checker import check
from cpcal.common.errors import ModelError
from cpcal.solver.certificate import recording
from cpcal.solver.certificate.recording import claims_of
from cpcal.solver.contract import Limits, Verdict
from cpcal.solver.existence.unique import Inside
from cpcal.solver.interval import Box
from cpcal.solver.network.expression import as_expr
from cpcal.solver.optimize.witness import WitnessProver
from tests.networks import network


def test_an_element_of_an_array_does_not_ask_the_others_to_be_defined() -> None:
    net = cpcal.Network()
    v, y = net.variable("v", 2, ([0, -1], [1, -0.5])), net.variable("y", domain=(0, 1))
    net.add([np.sqrt(v)[0] == 0.5, np.stack([np.log(v[1]), y])[1] == 0.25])
    net.add(np.concatenate([1 / np.stack([y - 0.25, v[0]]), v])[2] >= 0.1)
    assert (0.25, -0.75, 0.25) in net.contract().box
    assert net.solve(width=0.25).solutions
    net.add(np.sqrt(v) >= 0)
    assert not net.solve().solutions  # here both are asked for


# numbers that overflow --------------------------------------------------------------------------------------


def overflowing() -> tuple[cpcal.Network, cpcal.Network]:
    """Without a solution; at the points that fits propose a row is inf - inf."""
    one, two = cpcal.Network(), cpcal.Network()
    x, y = one.variable("x", domain=(0, 1e200)), two.variable("x", domain=(0, 2000))
    one.add([x * x >= 1, x <= 2, x >= 3])
    two.add([cpcal.exp(y) >= 1e300, y * y <= 1])
    return one, two


def test_a_row_that_overflows_accepts_no_other_row() -> None:
    for net in overflowing():
        best = net.minimize(net.variables[0])
        assert best.verdict is Verdict.REFUTED
        assert best.witness is None
        for x in (0.0, 2.0, 1000.0, 5e199):
            prover = WitnessProver(net, 0)
            assert prover.prove(np.array([min(x, net.domain.hi[0])])) is None
            assert not Inside(net)(Box(net.names, [min(x, 2000.0)], [min(x, 2000.0)]))


def test_a_bound_that_is_not_there_asks_for_a_definition_alone() -> None:
    net, x = network(x=(-4, 4))
    both: Any = np.stack([cpcal.sqrt(x), x])
    net.add(both.within((-np.inf, np.array([np.inf, 1.0]))))
    inside, prover = Inside(net), WitnessProver(net, 0)
    for point, good in ((-1.0, False), (0.5, True), (2.0, False)):
        assert inside(Box(net.names, [point], [point])) is good
        assert (prover.prove(np.array([point])) is not None) is good


def test_products_that_are_too_small_on_the_way_are_not_lost() -> None:
    """1e-200 * 1e-200 * 1e300 is 1e-100, not 0; so is 1e-310 * 1e300 not nothing. Both bounds hold at the point."""
    for coefficient, at in ((1e100, (1e-200, 1e-200, 1e300)), (1e-310, (1.0, 1.0, 1e300))):
        net, x = network(3, x=(np.zeros(3), 2.0 * np.array(at)))
        body = coefficient * (x[0] * x[1] * x[2])
        value = cpcal.evaluate(net, body, Box(net.names, np.array(at), np.array(at)))
        net.add(body.within((float(value.lo), float(value.hi))))
        assert at in net.contract(contractors=["lifted"]).box
        assert any(at in s.box for s in net.solve(limits=Limits(nodes=50)).solutions)


# powers -----------------------------------------------------------------------------------------------------


def test_an_exponent_that_is_no_known_number_means_exp_and_log() -> None:
    net, x = network(x=(0.5, 3))
    for exponent in (cpcal.Interval(1.25, 1.5), net.variable("y", domain=(1, 4)), 1.5):
        net.add(x**exponent <= 9)  # type: ignore[operator]
    for unknown in (cpcal.Interval(1.5, 2.5), np.array([2, 3]), as_expr(1.0) + 1.0):
        with pytest.raises(ModelError, match="may be a whole power of a negative number"):
            x**unknown  # type: ignore[operator]
    with pytest.raises(ModelError, match=r"whole ones are less than 2\^31"):
        x**2.0**40


# certificates of equations ----------------------------------------------------------------------------------


def test_a_solution_of_equations_is_not_certified_and_the_answer_says_so(tmp_path: Path) -> None:
    net, x = network(2, x=(-3, 3))
    net.add(x[0] ** 2 + x[1] ** 2 == 4)
    best = net.minimize(x[0] + 2 * x[1], certificate=tmp_path / "c")
    assert best.verdict is Verdict.NOT_CERTIFIED
    assert best.status.startswith("The gap is closed, but not certified: the certificate proves the bound, not the")
    assert best.lo <= -2.0 * math.sqrt(5.0) <= best.hi <= best.lo + 1e-5
    claims = check(tmp_path / "c").claims
    assert claims.eps_lo is not None
    assert float(claims.eps_lo) == best.lo
    assert claims.point is claims.eps_hi is None
    few = Limits(nodes=0)
    stopped = net.minimize(x[0] + 2 * x[1], certificate=tmp_path / "s", start=[-0.9, -1.8], limits=few)
    assert stopped.verdict is Verdict.UNKNOWN
    assert "Not certified" in stopped.status
    assert check(tmp_path / "s").claims.point is None


@pytest.mark.parametrize(
    ("lowest", "degree", "why"), [(-np.inf, 2, "bounded box: give t a finite"), (-9, 9, "of degree at most 8")]
)
def test_what_no_certificate_can_state_is_refused_before_the_work(tmp_path, lowest, degree, why):
    net, x, t = network(x=(0, 2), t=(lowest, 9))
    net.add(x**degree <= t)
    with pytest.raises(ModelError, match=why):
        net.minimize(t, certificate=tmp_path / "c")


def test_a_certificate_that_the_checker_refuses_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is wrong with it: here an enclosure that nothing proves."""
    net, x = network(x=(-2, 2))
    net.add(x * x >= 1)
    false = {"enclosure": {"lo": ["0x1p+0"], "hi": ["0x1p+0"]}}
    monkeypatch.setattr(recording, "claims_of", lambda *args: claims_of(*args) | false)
    with pytest.raises(recording.UncertifiedError, match="would be refused: box 0 reaches out of the") as raised:
        net.minimize(x, certificate=tmp_path / "c", limits=Limits(nodes=1))
    assert raised.value.answer.verdict is not Verdict.PROVED
    assert "ot certified" in raised.value.answer.status
    assert not (tmp_path / "c").exists()


def test_a_division_by_a_negative_power_keeps_its_solutions():
    """Multiplied out, `x^-2 / x^-4` lost its x^4: the planted networks found it (seed 10307 of 20,000)."""
    net, x = network(x=(2.0, 3.0))
    net.add(x**-2 / x**-4 >= 6.25)
    best = net.minimize(x)
    assert best.verdict is Verdict.PROVED
    assert best.lo <= 2.5 <= best.hi


def test_reductions_are_those_of_numpy() -> None:
    net, v = network((2, 3), v=(-2, 2))
    at = np.array([[0.5, -1.25, 2.0], [1.5, 0.25, -0.75]])
    point = net.domain.with_bounds(at.ravel(), at.ravel())
    for function in (np.sum, np.mean, np.prod, np.max, np.min):
        for axis in (None, 0, 1):
            found = cpcal.evaluate(net, function(v, axis=axis), point)
            assert np.allclose(found.lo, function(at, axis=axis), rtol=1e-12)
            assert (found.lo <= found.hi).all()
