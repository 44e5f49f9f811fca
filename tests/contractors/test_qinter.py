"""All but q constraints: the exact q-intersection against brute force, and ranges of which one is false."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import HC4, qinter
from contractors.qinter import one_by_one, q_intersection
from cpcal import Network
from cpcal.solver.contract import Repeat
from cpcal.solver.interval import IntervalArray
from cpcal.solver.network import ConstraintNetwork, norm


def brute_force(boxes: IntervalArray, q: int) -> IntervalArray | None:
    """The hull over all choices of N - q boxes."""
    lo, hi, count = boxes.lo, boxes.hi, len(boxes.lo)
    found = []
    for chosen in itertools.combinations(range(count), count - q):
        low, high = lo[list(chosen)].max(axis=0), hi[list(chosen)].min(axis=0)
        if (low <= high).all():  # NaN, an empty box, is not
            found.append((low, high))
    if not found:
        return None
    return IntervalArray(np.min([f[0] for f in found], axis=0), np.max([f[1] for f in found], axis=0))


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_q_intersection_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, n = int(rng.integers(1, 8)), int(rng.integers(1, 4))
    ends = np.sort(rng.integers(0, int(rng.integers(4, 12)), (2, count, n)), axis=0).astype(float)
    ends[:, rng.random(count) < 0.1] = np.nan
    lo, hi = ends
    lo[rng.random((count, n)) < 0.05] -= np.inf  # NaN stays
    boxes = IntervalArray(lo, hi)
    for q in range(count):
        exact, found = brute_force(boxes, q), q_intersection(boxes, q)
        assert (exact is None) == (found is None)
        if exact is not None and found is not None:
            assert (exact.lo == found.lo).all()
            assert (exact.hi == found.hi).all()


BEACONS = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10], [5, -3], [-3, 5], [13, 5], [5, 13]])
TRUTH = np.array([3.0, 4.0])


def ranging(wrong: int | None) -> Network:
    """Eight distances to within 0.05, of which one may be 4 too long."""
    distance = np.linalg.norm(BEACONS - TRUTH, axis=1)
    if wrong is not None:
        distance[wrong] += 4.0
    net = Network()
    p = net.variable("p", 2, (-20, 20))
    net.add((norm(BEACONS - p) - distance).within((-0.05, 0.05)))
    return net


@pytest.mark.parametrize("wrong", [0, 5])
def test_a_false_range_is_tolerated(wrong: int) -> None:
    net = ranging(wrong)
    assert Repeat(HC4(net)).contract(net.domain).box.is_empty  # all together they contradict each other
    assert Repeat(qinter(net, q=0)).contract(net.domain).box.is_empty
    box = Repeat(qinter(net, q=1)).contract(net.domain).box
    assert TRUTH in box
    paving = net.solve(width=0.2, contractors=[qinter(net, q=1)])
    assert paving.complete
    assert len(paving.clusters) == 1
    assert TRUTH in paving.clusters[0]
    assert paving.clusters[0].width.max() < 0.5


def test_measurements_are_taken_apart_and_q_is_checked() -> None:
    net = ranging(None)
    net.add(net.variables[0][0] >= 0)
    assert len(one_by_one(net)) == 9
    for q in (-1, 9):
        with pytest.raises(ValueError, match="q ="):
            qinter(net, q=q)
    empty = ConstraintNetwork()
    empty.variable("x", (), (0, 1))
    assert qinter(empty).contract(empty.domain).box == empty.domain
