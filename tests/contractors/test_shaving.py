"""What hc4 alone can not do: constructive disjunction goes beyond its fixpoint."""

import math

import numpy as np
import pytest

from contractors import HC4, Cid
from contractors.shaving import cuts
from cpcal.solver.contract import Contraction, Repeat
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork


def crossing(half: float = 3.0) -> ConstraintNetwork:
    """x + y = 0 and x - y = 0: the smallest system at which hc4 stands still (Lhomme 1993)."""
    net = ConstraintNetwork()
    x, y = net.variable("x", (), (-half, half)), net.variable("y", (), (-half, half))
    net.add([x + y == 0, x - y == 0])
    return net


def stuck(net: ConstraintNetwork) -> bool:
    return Repeat(HC4(net), 0.999).contract(net.domain).box == net.domain


def test_slices_where_hc4_is_stuck() -> None:
    net = crossing()
    assert stuck(net)
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
