"""Contractors compose: `Then`, `Union`, `Repeat` on ours and on those of third parties."""

import math

import pytest

from contractors import HC4, Lifted
from cpcal.solver import plugins
from cpcal.solver.contract import Contraction, Repeat, Then, Union, elements, givers
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork


class Foreign:
    """A third party's contractor that declares nothing and has no operators."""

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return Contraction(box.replace("x", hi=min(1.0, float(box.hi[0]))), programs=2)


@pytest.fixture
def network() -> ConstraintNetwork:
    net = ConstraintNetwork()
    x = net.variable("x", (), (-4, 4))
    net.add(x**2 <= 4)
    return net


def test_operators_compose_with_a_foreign_contractor_on_either_side(network: ConstraintNetwork) -> None:
    ours, foreign = HC4(network), Foreign()
    for both in (ours >> foreign, foreign >> ours):
        assert isinstance(both, Then)
        result = both.contract(network.domain)
        assert result.box["x"].hi == 1.0
        assert result.box["x"].lo == pytest.approx(-2.0)
        assert result.programs == 2
    for either in (ours | foreign, foreign | ours):
        assert isinstance(either, Union)
        result = either.contract(network.domain)
        assert result.box["x"].lo == -4.0
        assert result.box["x"].hi == pytest.approx(2.0)
        assert result.steps == ()


def test_the_core_composes_contractors_that_know_nothing_of_composition(network: ConstraintNetwork) -> None:
    named = plugins.build_each(network, [Foreign(), Foreign()])
    assert [name for name, _ in named] == ["Foreign", "Foreign"]
    result = Then(*(part for _, part in named)).contract(network.domain)
    assert result.box["x"].hi == 1.0
    assert result.programs == 4
    assert Repeat(Foreign(), most=5).contract(network.domain).programs == 4  # the second call changes nothing
    assert Union(Foreign(), Foreign()).contract(network.domain).box["x"].hi == 1.0
    lifted, hc4 = Lifted(network), HC4(network)
    assert elements(Then(hc4, Repeat(Then(lifted, hc4)))) == (hc4, lifted, hc4)
    assert [givers(c) for c in (lifted, hc4, Foreign(), lifted >> hc4)] == [[lifted], [], [], [lifted]]


def test_repeat_stops_on_empty_and_refuses_a_senseless_ratio(network: ConstraintNetwork) -> None:
    network.add(network.variables[0] >= 3)
    assert Repeat(HC4(network)).contract(network.domain).box.is_empty
    for ratio in (0.0, -1.0, 1.5):
        with pytest.raises(ValueError, match="ratio"):
            Repeat(HC4(network), ratio)
