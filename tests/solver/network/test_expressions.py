"""Building expressions and networks: shapes as numpy has them, identity, digests, and what is refused."""

import contextlib
import pickle

import numpy as np
import pytest

from contractors import HC4, Lifted
from cpcal.common.errors import ModelError
from cpcal.solver.interval import Interval
from cpcal.solver.interval.box import component_names
from cpcal.solver.network import ConstraintNetwork, norm


@pytest.fixture
def net() -> ConstraintNetwork:
    return ConstraintNetwork()


def circle(radius: float = 1.0, name: str = "x", domain: tuple[float, float] = (-2, 2)) -> ConstraintNetwork:
    net = ConstraintNetwork()
    x = net.variable(name, 2, domain)
    net.add(norm(x - net.reading([0.0, 0.0], 0.1)) + Interval(0, 1e-9) <= radius)
    return net


def test_network_digests_are_equal_for_equal_networks_only() -> None:
    base = circle().digest
    assert base == circle().digest
    assert base == pickle.loads(pickle.dumps(circle())).digest
    assert len({base, circle(2.0).digest, circle(name="y").digest, circle(domain=(-2, 3)).digest}) == 4
    more = circle()
    more.add(more.variables[0][0] >= 0)
    assert more.digest != base
    one, two = ConstraintNetwork(), ConstraintNetwork()
    for net, shared in ((one, True), (two, False)):
        x = net.variable("x", 2)
        first = net.reading(0.0, 1.0)
        net.add([x[0] == first, x[1] == (first if shared else net.reading(0.0, 1.0))])
    assert one.digest != two.digest


@pytest.mark.parametrize("contractor", [HC4, Lifted])
def test_equal_reading_sets_hold_different_readings(net: ConstraintNetwork, contractor: type) -> None:
    x, y = net.variable("x", (), (-3, 3)), net.variable("y", (), (-3, 3))
    net.add([net.reading(0.0, 1.0) == x, net.reading(0.0, 1.0) == y])
    z = net.variable("z", (), (-3, 3))
    net.add(net.reading(0.0, 1.0) - net.reading(0.0, 1.0) == z)
    assert (-0.9, 0.9, 1.9) in contractor(net).contract(net.domain).box
    part = net.domain.replace("x", hi=-0.5).replace("y", lo=0.5)
    assert not contractor(net).contract(part).box.is_empty


def test_truth_values_and_chained_comparisons_are_refused(net: ConstraintNetwork) -> None:
    x = net.variable("x")
    with pytest.raises(ModelError, match="truth value"):
        bool(x)
    with pytest.raises(ModelError, match="within"):
        bool(x <= 1)
    with pytest.raises(ModelError, match="within"):
        0 <= x <= 1  # noqa: B015
    with pytest.raises(ModelError, match="truth value"):
        not x  # noqa: B018
    with pytest.raises(ModelError, match="closed"):
        x != 1  # noqa: B015


def test_shape_errors_are_model_errors(net: ConstraintNetwork) -> None:
    x, m = net.variable("x", 3), np.zeros((2, 4))
    wrong = [
        lambda: x + np.zeros(2), lambda: m @ x, lambda: x @ m, lambda: x[0] @ x, lambda: x[3], lambda: x[0, 0],
        lambda: x["a"], lambda: x.sum(1), lambda: x[0].sum(), lambda: norm(x[0]),
        lambda: x.within(([0, 0], [1, 1])), lambda: x.within((np.zeros((2, 3)), 1.0)),
        lambda: x + [[1], [1, 2]], lambda: net.reading(0.0, -1.0), lambda: net.component(x),
        lambda: net.component(x[0] + 1), lambda: net.add(ConstraintNetwork().variable("x") <= 1),
    ]  # fmt: skip
    accepted = []
    for k, build in enumerate(wrong):
        with contextlib.suppress(ModelError):
            build()
            accepted.append(k)
    assert accepted == []


INDICES = [0, -1, slice(1, None), slice(None, None, -1), [2, 0, 0], np.array([True, False, True]), None, ...]
INDICES += [(slice(None), 1), (..., [0, 0]), (1, slice(2)), ([0, 1], [1, 0]), (None, ..., None)]


SHAPES = [((3,), (3,)), ((2, 3), (3,)), ((3,), (3, 4)), ((2, 3), (3, 4)), ((5, 2, 3), (3,)), ((5, 2, 3), (5, 3, 4))]
SHAPES += [((2, 3), (5, 3, 4)), ((1, 2, 3), (6, 3, 4)), ((3,), (5, 3, 2))]


def test_names_of_components(net: ConstraintNetwork) -> None:
    x, y = net.variable("x", (2, 2), (0, 1)), net.variable("y")
    assert net.names == ("x[0,0]", "x[0,1]", "x[1,0]", "x[1,1]", "y")
    assert net.component(x[1, 0]) == "x[1,0]"
    assert net.component(y) == "y"
    assert component_names(y) == ("y",)
    assert not net.domain.is_bounded
    assert repr(net).endswith("5 unknowns, 0 constraints>")
