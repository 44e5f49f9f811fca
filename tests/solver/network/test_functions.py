"""Functions in networks: proofs that do not rest on clipped domains, numpy's names, and mathematics in print."""

import math

import numpy as np
import pytest

import cpcal
from cpcal import Network, Verdict
from cpcal.common.errors import ModelError
from cpcal.solver.existence import prove_unique
from cpcal.solver.interval import Interval, IntervalArray

BOTH = ["hc4", "newton"]


def test_a_transcendental_system_is_solved_and_counted() -> None:
    """Kepler's equation, and all crossings of a sine with a line: sin x = x / 10 has seven solutions."""
    net = Network()
    e = net.variable("e", domain=(0, 2 * math.pi))
    net.add(e - 0.9 * np.sin(e) == 1.5)
    (only,) = net.solve(contractors=BOTH).solutions
    assert only.verdict is Verdict.PROVED
    found = only[e]
    assert isinstance(found, Interval)
    assert abs(found.mid - 0.9 * math.sin(found.mid) - 1.5) < 1e-12
    net = Network()
    x = net.variable("x", domain=(-20, 20))
    net.add(cpcal.sin(x) == x / 10)
    paving = net.solve(contractors=BOTH)
    assert [s.verdict for s in paving.solutions] == [Verdict.PROVED] * 7
    assert paving.complete


@pytest.mark.parametrize("make", [cpcal.log, cpcal.sqrt, lambda x: x**1.5, lambda x: cpcal.asin(1 - x)])
def test_no_proof_rests_on_a_domain_that_was_cut_off(make) -> None:
    """The only zero, x = -1e-9, lies just outside of where the function is defined."""
    net = Network()
    x = net.variable("x", domain=(-1, 1))
    net.add(x * 3 + make(x) - make(x) == -3e-9)
    for at in (-1e-9, 1e-9):
        assert prove_unique(net, (at,)) is None


def test_numpy_gives_expressions_and_says_what_it_has_not() -> None:
    net = Network()
    x = net.variable("x", (2, 3))
    assert np.linalg.norm(x, axis=-1).shape == (2,)
    assert np.sum(x).shape == ()
    assert np.stack([x[0], x[1]], axis=1).shape == (3, 2)
    assert (np.eye(2) @ x).shape == (2, 3)
    assert x.T.shape == (3, 2)
    assert x.reshape(3, 2).shape == x.reshape((3, -1)).shape == (3, 2)
    assert [e.shape for e in x] == [(3,), (3,)]
    with pytest.raises(TypeError, match="has no length"):
        len(x[0, 0])
    with pytest.raises(ModelError, match="there are exp"):
        np.logaddexp(x, x)
    with pytest.raises(ModelError, match="takes no expressions"):
        np.median(x)
    with pytest.raises(ModelError, match=r"write cpcal\.sin"):
        math.sin(x[0, 0])
    with pytest.raises(ModelError, match="write `<=` or `>=`"):
        x < 1  # noqa: B015
    with pytest.raises(ModelError, match="write `<=` or `>=`"):
        np.ones(3) > x  # noqa: B015
    with pytest.raises(ModelError, match="can not be reshaped"):
        x.reshape(4, 2)


def test_expressions_constraints_and_networks_print_as_mathematics() -> None:
    net = Network("ring")
    x, y = net.variable("x", 2, (-1, 1)), net.variable("y", domain=(0, 3))
    assert str(2 * (x[0] - y) ** 2 - (y - (x[1] - 1)) / -y) == "2 * (x[0] - y)^2 - (y - (x[1] - 1)) / (-y)"
    assert str(np.sin(y) ** 3 * y**0.5 - y**1.5) == "sin(y)^3 * sqrt(y) - exp(1.5 * log(y))"
    assert str((x[0] + y).within((0, 2))) == "0 <= x[0] + y <= 2"
    assert str((x[0] + y).within((3, 3))) == "x[0] + y = 3"
    net.add(cpcal.norm(x) <= y)
    assert str(net).splitlines() == [
        "ring:", "x[0] in [-1, 1]", "x[1] in [-1, 1]", "y in [0, 3]", "sqrt(sum(x^2, axis=0)) - y <= 0",
    ]  # fmt: skip
    long = y
    for _ in range(3000):
        long = long + y
    assert len(str(long)) < 1000


def test_boxes_are_asked_by_variables() -> None:
    net = Network()
    x, y = net.variable("x", (2, 2), (-1, 1)), net.variable("y", domain=(0, 3))
    assert net.domain[y] == Interval(0, 3)
    found = net.domain[x]
    assert isinstance(found, IntervalArray)
    assert found.hi.tolist() == [[1, 1], [1, 1]]
    with pytest.raises(ModelError, match="not for"):
        net.domain[x + 1]
