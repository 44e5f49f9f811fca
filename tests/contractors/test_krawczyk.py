"""krawczyk, beaumont, newton, qinter: the literature's examples, brute force, what no polyhedron may lose."""

import itertools
import time
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contractors import HC4, Beaumont, Krawczyk, Newton, qinter
from contractors.krawczyk import IntervalRows, beaumont, inequalities
from contractors.qinter import one_by_one, q_intersection
from cpcal import Network
from cpcal.solver.contract import Repeat
from cpcal.solver.interval import Box, IntervalArray
from cpcal.solver.network import ConstraintNetwork, evaluate, maximum, minimum, norm, sqr, sqrt
from tests.networks import network

Floats = npt.NDArray[np.float64]
SEEDS = st.integers(0, 2**32 - 1)
KINDS = {"krawczyk": Krawczyk, "beaumont": Beaumont}


# interval linear systems ------------------------------------------------------------------------------------


def linear(matrix: tuple[Floats, Floats], right: tuple[Floats, Floats], lo: Floats, hi: Floats) -> ConstraintNetwork:
    """A x = b for SOME A and b in their sets."""
    net, x = network(len(lo), x=(lo, hi))
    A, b = (net.reading((u + v) / 2, (v - u) / 2) for u, v in (matrix, right))
    net.add((A * x).sum(-1) == b)
    return net


BARTH_NUDING = ((np.array([[2.0, -2], [-1, 2]]), np.array([[4.0, 1], [2, 4]])), (np.full(2, -2.0), np.full(2, 2.0)))
HANSEN = ((np.array([[2.0, 0], [1, 2]]), np.array([[3.0, 1], [2, 3]])), (np.array([0.0, 60]), np.array([120.0, 240])))
NEUMAIER = (  # 3.5 on the diagonal, [0, 2] elsewhere
    (3.5 * np.eye(3), 3.5 * np.eye(3) + 2 * (1 - np.eye(3))),
    (np.full(3, -1.0), np.full(3, 1.0)),
)
HULLS = {  # checked below against the vertices of the sign pieces
    "barth-nuding": (BARTH_NUDING, [-4, -4], [4, 4]),
    "hansen": (HANSEN, [-120, -60], [90, 240]),
    "neumaier": (NEUMAIER, [-30 / 17] * 3, [30 / 17] * 3),
}


@pytest.mark.parametrize("name", HULLS)
def test_beaumont_gives_the_exact_hull_where_the_signs_are_known(name: str) -> None:
    """Orthant by orthant the inequalities of Oettli and Prager are linear; krawczyk's polyhedron is wider."""
    (matrix, right), lo, hi = HULLS[name]
    n = len(lo)
    hulls: dict[str, list[Box]] = {kind: [] for kind in KINDS}
    for signs in itertools.product([-1.0, 1.0], repeat=n):
        ends = np.sort([np.zeros(n), 300.0 * np.array(signs)], axis=0)
        net = linear(matrix, right, *ends)
        for kind, make in KINDS.items():
            hulls[kind].append(make(net).contract(net.domain).box)
    bounds = {kind: ([b.lo for b in boxes], [b.hi for b in boxes]) for kind, boxes in hulls.items()}
    assert np.nanmin(bounds["beaumont"][0], axis=0) == pytest.approx(lo)
    assert np.nanmax(bounds["beaumont"][1], axis=0) == pytest.approx(hi)
    wider = np.nanmax(bounds["krawczyk"][1], axis=0) - np.nanmin(bounds["krawczyk"][0], axis=0)
    assert (wider > 1.2 * (np.array(hi) - lo)).all()


@pytest.mark.parametrize("decomposition", ["middle", "beaumont", "any"])
@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_inequalities_hold_for_all_solutions_of_the_interval_rows(decomposition: str, seed: int) -> None:
    """`v + A (x - c) <= 0` for one A and v in their sets: x, rounded to float64, is moved inside by a hair."""
    rng = np.random.default_rng(seed)
    c, x = rng.normal(0, 100, 3), rng.normal(0, 100, 3)
    matrix = IntervalArray.around(rng.normal(size=(6, 3)), 10.0 ** rng.uniform(-6, 0) * rng.random((6, 3)))
    some = rng.uniform(matrix.lo, matrix.hi)
    value = -some @ (x - c) - 1e-9
    rows = IntervalRows(c, IntervalArray.around(value, rng.random(6)), matrix, np.zeros((6, 2), dtype=np.intp))
    box = Box(["x", "y", "z"], x - rng.uniform(0, 9, 3), x + rng.uniform(0, 9, 3))
    choices = {"middle": matrix.mid, "beaumont": beaumont(rows, box), "any": rng.normal(size=matrix.shape)}
    found, exact = inequalities(rows, box, choices[decomposition]), [Fraction(v) for v in x]
    for row, most in zip(found.matrix, found.rhs, strict=True):
        assert sum(Fraction(a) * v for a, v in zip(row, exact, strict=True)) <= Fraction(most)


# nonlinear networks -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_never_loses_a_point_that_touches_its_constraints(kind: str, seed: int) -> None:
    """Kinks, poles, shared and own readings; the point lies on faces of the box and on the constraint's bound."""
    rng = np.random.default_rng(seed)
    point, slack = rng.normal(0, 2, 3), rng.normal(0, 1, 4)
    net = ConstraintNetwork()
    size = 10.0 ** rng.uniform(-4, 1) * rng.random((2, 3)) * rng.integers(0, 2, (2, 3))
    x = net.variable("x", 3, (point - size[0], point + size[1]))
    m, s = net.reading(slack, 0.1), net.reading(1.0, 0.2)
    exprs = [
        abs(m - x[0]) * s - maximum(m, x[1]) * x[2],
        m / (sqr(x[0]) + 0.5) + sqrt(sqr(x[1] - m) + sqr(x[2])),
        x[0] / x[1] + m * x[2] - minimum(m, x[0]) ** 3,
        (m + s) * x[0] - s * x[1] + 2.0 * m,
    ]
    expr = exprs[rng.integers(len(exprs))]
    here = evaluate(net, expr, net.domain.with_bounds(point, point))
    net.add(expr.within((-np.inf, here.hi) if rng.random() < 0.5 else (here.lo, here.hi)))
    assert point in KINDS[kind](net).contract(net.domain).box


def test_a_zero_in_one_call_where_hc4_is_stuck() -> None:
    """Two curves that cross at right angles, neither along an axis, at (1, 1)."""
    net, x, y = network(x=(0.5, 1.5), y=(0.5, 1.5))
    net.add([10 * x + 10 * y + x * y == 21, 10 * x - 10 * y + sqr(x) - sqr(y) == 0])
    assert Repeat(HC4(net), 0.999).contract(net.domain).box.width.min() > 0.9
    box = Newton(net).contract(net.domain).box
    assert (1.0, 1.0) in box
    assert box.width.max() < 1e-14


def test_after_the_deadline_boxes_stay_as_they_are() -> None:
    net, x, y = network(x=(-3, 3), y=(-3, 3))
    net.add([sqr(x) + sqr(y) == 4, y == sqr(x) - 1])
    near = Box(net.names, [1.2, 1.2], [1.6, 1.4])
    assert Newton(net).contract(near, time.monotonic()).box == near
    assert Newton(net).contract(near).box.width.max() < 1e-12


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
    net, p = network(2, p=(-20, 20))
    net.add((norm(BEACONS - p) - distance).within((-0.05, 0.05)))
    return net


@pytest.mark.parametrize("wrong", [0, 5])
def test_a_false_range_is_tolerated(wrong: int) -> None:
    net = ranging(wrong)
    assert Repeat(HC4(net)).contract(net.domain).box.is_empty  # all together they contradict each other
    assert Repeat(qinter(net, q=0)).contract(net.domain).box.is_empty
    assert TRUTH in Repeat(qinter(net, q=1)).contract(net.domain).box
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
