"""Every registered contractor, and the algebra, keeps the promises of `solver.testing`; broken ones are refused."""

import itertools
import math
import tomllib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contractors import HC4, Cid, Lifted, Newton
from cpcal.solver import plugins, testing
from cpcal.solver.contract import Contraction, Contractor, ContractorFactory, Repeat, Step
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.testing import CONFORMANCE, Case, boxes, cases, check_contractor

Trial = tuple[Case, Contractor, Box, Contraction, str]


ALGEBRA: dict[str, ContractorFactory] = {
    "then": lambda net, **options: HC4(net, **options) >> Lifted(net, **options),
    "union": lambda net, **options: HC4(net, **options) | (Lifted(net, **options) >> HC4(net, **options)),
    "repeat": lambda net, **options: Repeat(HC4(net, **options), ratio=0.99),
}
VARIANTS: dict[str, ContractorFactory] = {
    "cid with newton": lambda net, **options: Cid(HC4(net, **options) >> Newton(net, **options), slices=2)
}
OURS = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text())["project"]["entry-points"]
FACTORIES = {name: plugins.load(name) for name in OURS[plugins.GROUP]} | ALGEBRA


TRIALS = testing._trials


@lru_cache(maxsize=1)  # the checks of a contractor come one after another
def tried(factory: ContractorFactory, seed: int) -> tuple[Trial, ...]:
    return tuple(TRIALS(factory, seed))


@pytest.fixture
def tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(testing, "_trials", tried)


@pytest.mark.usefixtures("tried_once")
@pytest.mark.parametrize("check", CONFORMANCE)
@pytest.mark.parametrize("name", FACTORIES)
def test_conformance(name: str, check: str) -> None:
    CONFORMANCE[check](FACTORIES[name])


@pytest.mark.usefixtures("tried_once")
@pytest.mark.parametrize("check", ["keeps_solutions", "leaves_a_part"])
@pytest.mark.parametrize("name", VARIANTS)
def test_conformance_of_variants(name: str, check: str) -> None:
    CONFORMANCE[check](VARIANTS[name])


def test_ours_are_found_by_entry_point() -> None:
    assert set(OURS[plugins.GROUP]) <= set(plugins.found())


@pytest.mark.parametrize("seed", [0, 7])
def test_every_case_of_the_suite_has_solutions_in_its_domain_and_in_boxes(seed: int) -> None:
    for case in cases(seed):
        assert len(case.solutions) > 0
        assert all(point in case.network.domain for point in case.solutions)
        held = [sum(point in box for point in case.solutions) for box in boxes(case, seed)]
        assert sum(count > 0 for count in held) >= 4


# contractors that break a promise ---------------------------------------------------------------------------


class Wrapped:
    """hc4, spoilt by a function of the box given and of its result."""

    def __init__(self, network: ConstraintNetwork, spoil: Callable[[Box, Contraction], Contraction]) -> None:
        self._inner, self._spoil = HC4(network), spoil

    def contract(self, box: Box, deadline: float = math.inf) -> Contraction:
        return self._spoil(box, self._inner.contract(box))


def spoilt(spoil: Callable[[Box, Contraction], Contraction], **attributes: Any) -> ContractorFactory:
    def make(network: ConstraintNetwork, *, objective: str | None = None) -> Contractor:
        contractor: Any = Wrapped(network, spoil)
        for name, value in attributes.items():
            setattr(contractor, name, value)
        return contractor

    return make


def halve(box: Box, result: Contraction) -> Contraction:
    if result.box.is_empty:
        return result
    return Contraction(result.box.with_bounds(result.box.lo, result.box.mid))


def shave_one_float(box: Box, result: Contraction) -> Contraction:
    if result.box.is_empty:
        return result
    return Contraction(result.box.with_bounds(np.nextafter(result.box.lo, np.inf), result.box.hi))


def fill(box: Box, result: Contraction) -> Contraction:
    return Contraction(box.with_bounds(np.zeros(len(box)), np.ones(len(box)))) if box.is_empty else result


_COUNTER = itertools.count()


def waver(box: Box, result: Contraction) -> Contraction:
    return result if next(_COUNTER) % 2 else Contraction(box)


def waver_in_steps(box: Box, result: Contraction) -> Contraction:
    step = Step("waver", box.names[0], "lo", -np.inf, ((next(_COUNTER), 0),))
    return Contraction(result.box, (step,))


def scribble(box: Box, result: Contraction) -> Contraction:
    if not box.is_empty:
        object.__setattr__(box, "lo", np.nextafter(box.lo, -np.inf))
    return result


BROKEN = {
    "halve": (spoilt(halve), "keeps_solutions"),
    "shave": (spoilt(shave_one_float), "keeps_solutions"),
    "widen": (
        spoilt(lambda box, _: Contraction(box.with_bounds(np.nextafter(box.lo, -np.inf), box.hi))), "leaves_a_part"),
    "rename": (
        spoilt(lambda _, found: Contraction(Box([f"{n}'" for n in found.box.names], found.box.lo, found.box.hi))),
        "leaves_a_part"),
    "fill": (spoilt(fill), "leaves_a_part"), "waver": (spoilt(waver), "is_repeatable"),
    "waver in steps": (spoilt(waver_in_steps), "is_repeatable"),
    "lambda": (spoilt(lambda box, result: result), "is_repeatable"),
    "scribble": (spoilt(scribble), "is_repeatable"),
    "invent": (
        spoilt(lambda _, found: Contraction(found.box, (Step("x", "no such variable", "lo", -np.inf),))),
        "leaves_a_part"),
    "boast": (  # of more than the box shows
        spoilt(lambda box, found: Contraction(found.box, (Step("x", box.names[0], "lo", np.inf),))), "leaves_a_part"),
    "claim": (spoilt(lambda box, _: Contraction(box, (Step("x", None, "", np.nan),))), "leaves_a_part"),
    "no weights": (spoilt(lambda box, result: result, gives_weights=True), "leaves_a_part"),
    "no word": (spoilt(lambda box, result: result, gives_weights="yes"), "leaves_a_part"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_the_suite_refuses_broken_contractors(name: str) -> None:
    factory, check = BROKEN[name]
    with pytest.raises(AssertionError, match=r"\w+ \w+"):
        CONFORMANCE[check](factory)


def loses_readings(network: ConstraintNetwork, **options: Any) -> Contractor:
    """The classical mistake: contracts as if every reading were exact."""
    exact = ConstraintNetwork()
    exact.__dict__.update(network.__dict__)
    constraints = [c for c in network.constraints if c.body.shape != (8,)]
    if len(constraints) < len(network.constraints):
        exact._constraints = constraints
        a = network.variables[0]
        exact.add([a[0] >= 59.0])
    return HC4(exact)


def test_the_suite_refuses_one_that_ignores_the_reading_sets() -> None:
    with pytest.raises(AssertionError, match="is lost on the network 'readings'"):
        CONFORMANCE["keeps_solutions"](loses_readings)


def test_check_contractor_accepts_a_good_one() -> None:
    check_contractor(HC4, seed=3)
    with pytest.raises(AssertionError, match=r"\w+ \w+"):
        check_contractor(BROKEN["halve"][0])
