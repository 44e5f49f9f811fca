"""hc4: batches are what their boxes are alone; constructive disjunction goes beyond its fixpoint."""

import math

import numpy as np
import pytest

import cpcal
from contractors import HC4, Cid
from contractors.shaving import cuts
from cpcal.models import fit_model, leg_box, leg_network
from cpcal.solver.contract import Contraction, Repeat
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork
from tests.networks import network


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_a_batch_is_its_boxes_one_by_one(factor: float) -> None:
    campaign = cpcal.simulate(seed=3, joint_error=1.0, factor=factor, runs=3)
    fit = fit_model(campaign, 2)
    net = leg_network(campaign, 2, leg_box(fit, 50.0), eps=(0.0, 2.0))
    hc4 = HC4(net)
    rng = np.random.default_rng(0)
    half = 10.0 ** rng.uniform(-2.0, 1.5, (25, 1))
    middle = fit + rng.uniform(-5.0, 5.0, (25, 7))
    lo, hi = np.hstack([middle - half, np.zeros((25, 1))]), np.hstack([middle + half, np.full((25, 1), 2.0)])
    together = hc4.contract_batch(IntervalArray(lo, hi))
    emptied = 0
    for k in range(25):
        alone = hc4.contract(Box(net.names, lo[k], hi[k])).box
        if alone.is_empty:
            emptied += 1
            assert np.isnan(together.lo[k]).any()
        else:
            assert np.array_equal(alone.lo, together.lo[k])
            assert np.array_equal(alone.hi, together.hi[k])
    assert 0 < emptied < 25


@pytest.mark.parametrize("expression", ["3 * x", "x + 3", "3 - x", "x - 3", "x / 3", "3 / x"])
def test_what_a_constant_forbids_is_found_at_the_other_argument(expression: str) -> None:
    net, x = network(x=(1.0, 2.0))
    value = eval(expression, {"x": x})
    inside, outside = eval(expression, {"x": 1.5}), eval(expression, {"x": 2.5})
    net.add(value.within((inside, inside)))
    assert HC4(net).contract(net.domain).box["x"].width < 1e-12
    net.add(value.within((outside, outside)))
    assert HC4(net).contract(net.domain).box.is_empty


def test_a_constraint_of_constants_alone_can_fail() -> None:
    net, x = network(x=(1.0, 2.0))
    one = net.constant(np.array([1.0, 1.0]))
    net.add((one + 1.0 + 0.0 * x).within((3.0, 4.0)))
    assert HC4(net).contract(net.domain).box.is_empty


def crossing(half: float = 3.0) -> ConstraintNetwork:
    """x + y = 0 and x - y = 0: the smallest system at which hc4 stands still (Lhomme 1993)."""
    net, x, y = network(x=(-half, half), y=(-half, half))
    net.add([x + y == 0, x - y == 0])
    return net


def test_slices_where_hc4_is_stuck() -> None:
    net = crossing()
    assert Repeat(HC4(net), 0.999).contract(net.domain).box == net.domain
    result = Cid(HC4(net)).contract(net.domain)
    assert result.box.width.max() < 1e-9
    assert (0.0, 0.0) in result.box
    assert {(step.variable, step.side) for step in result.steps} == {(n, s) for n in "xy" for s in ("lo", "hi")}


def test_cuts_cover_and_batches_agree_with_single_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    for lo, hi in ((0.0, 1.0), (-1.7e308, 1.7e308), (1.0, np.nextafter(1.0, 2.0))):
        ends = cuts(lo, hi, 4)
        assert ends[0] == lo
        assert ends[-1] == hi
        assert (np.diff(ends / 4) > 0).all()

    class Single:
        def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
            return HC4(net).contract(box)

    monkeypatch.setattr("contractors.shaving._PASSES", 1)
    net = crossing()
    ends = np.array([-3.0, -1.0, 2.0, 3.0])
    at_once, singly = (Cid(inner).slices(net.domain, 0, ends) for inner in (HC4(net), Single()))
    np.testing.assert_array_equal(at_once.lo, singly.lo)
    np.testing.assert_array_equal(at_once.hi, singly.hi)


def test_a_disjunction_of_one_slice_is_refused() -> None:
    with pytest.raises(ValueError, match="slices"):
        Cid(HC4(crossing()), slices=1)
