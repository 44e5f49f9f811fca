"""Conformance suite for contractors: what every one must hold to, ours and a plug-in author's.

    from cpcal.solver.testing import CONFORMANCE

    @pytest.mark.parametrize("name", CONFORMANCE)
    def test_conformance(name):
        CONFORMANCE[name](MyContractor)

Each check builds the contractor, by a factory as the entry point names it, on a set of small networks and tries
it on random boxes. A failure is an AssertionError that says which promise was broken, where.
"""

import itertools
import pickle
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from cpcal.common.values import Floats, norms
from cpcal.solver.contract import Contraction, Contractor, ContractorFactory
from cpcal.solver.interval import Box, Interval
from cpcal.solver.network import ConstraintNetwork, maximum, minimum, norm, sqr, sqrt

# ------------------------------------------------------------------------------------------------------------------
# Small networks with known solutions, and random boxes to try a contractor on.

BOXES = 8  # random boxes for each network


class Case(NamedTuple):
    """A network and some of its solutions, (S, n): exact ones, or ones with room to spare."""

    name: str
    network: ConstraintNetwork
    solutions: Floats


def cases(seed: int = 0) -> list[Case]:
    """The networks of the suite. Known solutions have few binary digits wherever a constraint is tight."""
    rng, out = np.random.default_rng(seed), []
    for make in (_circle, _products, _leg, _readings, _unbounded, _kinks, _division):
        net = ConstraintNetwork()
        out.append(Case(make.__name__[1:], net, np.array(make(net, rng), np.float64)))
    return out


_Solutions = list[list[float]] | Floats


def _circle(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    x, y = net.variable("x", (), (-8, 8)), net.variable("y", (), (-8, 8))
    net.add([sqr(x) + y * y == 25, sqrt(x + 8) >= y - 3])
    return [[3, 4], [-4, 3], [5, 0], [0, -5], [-3, -4]]


def _products(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    x = net.variable("x", 4, (-40, 40))
    net.add([x[0] * x[1] == x[2], x[0] * x[1] * x[2] - x[3] ** 3 <= 8, x[3] >= x[0] ** 2 - 20])
    y = rng.integers(-24, 25, (40, 4)) / 8.0
    y[:, 2] = y[:, 0] * y[:, 1]
    return y[(y[:, 2] ** 2 <= 8 + y[:, 3] ** 3) & (y[:, 3] >= y[:, 0] ** 2 - 20)]


def _leg(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    a, b = net.variable("a", 3, (-60, 60)), net.variable("b", 3, (-60, 60))
    offset, eps = net.variable("l", (), (-60, 60)), net.variable("eps", (), (0, 50))
    y = rng.uniform(-20, 20, (6, 8))
    position = rng.uniform(-100, 100, (10, 3)) + [0, 0, 400]
    turn = np.linalg.qr(rng.standard_normal((10, 3, 3)))[0]
    arms = position + np.einsum("kij,sj->ski", turn, y[:, 3:6]) - y[:, None, :3]
    lengths = norms(arms) - y[:, 6:7]
    y[:, 7] = np.max(np.abs(lengths - lengths[0]), axis=1) + 1e-6
    net.add((norm(position + turn @ b - a) - (lengths[0] + offset)).within((-eps, eps)))
    return y[y[:, 7] <= 50]


def _readings(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    """Distances to points, both uncertain: a point solves when SOME readings in their sets fit.

    Two readings of equal sets are two numbers.
    """
    a, x = net.variable("a", 2, (-60, 60)), net.variable("x", (), (-3, 3))
    point, away = rng.uniform(-20, 20, 2), rng.uniform(-100, 100, (8, 2))
    slack = 0.999 * rng.uniform(-1, 1, (8, 2)) * [0.2, 0.1]
    read = norms(away + slack - point) + 0.999 * rng.uniform(-0.5, 0.5, 8)
    net.add(norm(net.reading(away, [0.2, 0.1]) - a) == net.reading(read, 0.5))
    net.add([x == net.reading(0.0, 1.0) - net.reading(0.0, 1.0), x <= Interval(1, 2) * net.reading(1.0, 0.5)])
    return [[*point, x] for x in (0.25, -0.5, -1.75)]


def _unbounded(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    x, y = net.variable("x"), net.variable("y", (), (0, np.inf))
    net.add([x - 2 * y == 1, x * y >= -4, x.within((-np.inf, 1e6))])
    return [[1, 0], [2, 0.5], [3.25, 1.125], [7, 3]]


def _kinks(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    x = net.variable("x", 4, (-30, 30))
    net.add([maximum(x[0], x[1]) <= x[2], minimum(x[0], 2 * x[1]) >= x[3], abs(x[0] - x[1]) + abs(x[2]) <= 9])
    net.add([2 - abs(x[0]) <= x[2] - x[3], maximum(x[2], x[3]) == x[2]])
    return [[2, 1.5, 2, 2], [-2.5, 1, 1, -2.5], [0, 0, 1, -1], [1.5, -2, 1.5, -4]]


def _division(net: ConstraintNetwork, rng: Generator) -> _Solutions:
    x = net.variable("x", 3, (-12, 12))
    net.add([x[0] / x[1] == x[2], 1 / (1 + sqr(x[0])) <= 0.9, x[1] ** -2 <= 70, sqrt(x[2] + 12) >= 1])
    return [[1.5, 0.25, 6], [-0.5, 2, -0.25], [3, -0.5, -6], [-2, -4, 0.5], [0.625, 0.125, 5]]


def boxes(case: Case, seed: int = 0) -> Iterator[Box]:
    """The domain, the empty box, random boxes: around solutions, with solutions on a face, single points, any."""
    rng = np.random.default_rng([seed, 1])
    domain = case.network.domain
    yield from (domain, Box.empty(domain.names))
    lo, hi = np.maximum(domain.lo, -1e3), np.minimum(domain.hi, 1e3)
    for k in range(BOXES):
        center = case.solutions[k % len(case.solutions)] if k % 4 else rng.uniform(lo, hi)
        below, above = 10.0 ** rng.uniform(-4, 2) * rng.uniform(0, 1, (2, len(lo)))
        if k % 4 == 2:
            below[rng.random(len(lo)) < 0.5] = 0.0
        if k % 8 == 7:
            below, above = np.zeros_like(below), np.zeros_like(above)
        yield domain.with_bounds(np.maximum(domain.lo, center - below), np.minimum(domain.hi, center + above))


def _trials(factory: ContractorFactory, seed: int) -> Iterator[tuple[Case, Contractor, Box, Contraction, str]]:
    for case in cases(seed):
        contractor = factory(case.network, objective=None)
        for box in boxes(case, seed):
            yield case, contractor, box, contractor.contract(box), f"on the network {case.name!r} and {box!r}"


# the promises -----------------------------------------------------------------------------------------------


def keeps_solutions(factory: ContractorFactory, seed: int = 0) -> None:
    """No solution is lost: neither of constraints nor of constraints that hold for SOME readings."""
    for case, _, box, result, where in _trials(factory, seed):
        for point in case.solutions:
            if point in box:
                assert point in result.box, f"the solution {point.tolist()} is lost {where}: {result.box!r}"


def leaves_a_part(factory: ContractorFactory, seed: int = 0) -> None:
    """The result and its steps are about a part of the box; declarations are of their types, and true."""
    weights = set[bool]()
    for case, contractor, box, result, where in _trials(factory, seed):
        assert result.box.names == box.names, f"the names changed to {result.box.names} {where}"
        assert result.box.subset(box), f"the result is no subset {where}: {result.box!r}"
        assert result.programs >= 0, f"{result.programs} linear programs {where}"
        declared = getattr(contractor, "gives_weights", False)
        assert isinstance(declared, bool), "a contractor states `gives_weights`, True or False"
        for step in result.steps:
            if step.variable is None:
                assert result.box.is_empty, f"a step claims that the box is empty, but it is not {where}"
                continue
            assert step.variable in box.names, f"a step names {step.variable!r}, which does not exist {where}"
            assert step.side in ("lo", "hi"), f"a step has the side {step.side!r} {where}"
            if not result.box.is_empty:
                left = result.box[step.variable]
                agrees = step.bound <= left.lo if step.side == "lo" else step.bound >= left.hi
                assert agrees, f"{step} says more than the result {left} {where}"
        carried = [step.weights for step in result.steps if step.weights is not None]
        for one in carried:
            values = [entry[-1] for kind in (one.rows, one.products, one.tangents) for entry in kind]
            assert all(0.0 <= value < np.inf for value in values), f"a weight is no multiplier {where}"
            assert all(0 <= c < len(case.network.constraints) for c, *_ in one.rows), f"no such constraint {where}"
        weights |= {bool(carried)} if declared else set()
    assert not weights or True in weights, "a contractor that declares `gives_weights` gives none"


def is_repeatable(factory: ContractorFactory, seed: int = 0) -> None:
    """The same box gives the same bytes: on the same object, a new one and a pickled one, whatever each saw before.

    The box and the network are the same after the call as before.
    """
    for case, group in itertools.groupby(_trials(factory, seed), key=lambda trial: trial[0]):
        trials, digest = list(group), case.network.digest
        for given, (_, _, box, _, where) in zip(boxes(case, seed), trials, strict=True):
            assert given == box, f"the box was changed {where}"
        contractor = trials[0][1]
        try:
            copy = pickle.loads(pickle.dumps(contractor))
        except Exception as error:
            raise AssertionError(f"the contractor does not pickle: {error!r}") from error
        for _, _, box, result, where in reversed(trials):
            for kind, other in (
                ("second", contractor),
                ("new", factory(case.network, objective=None)),
                ("pickled", copy),
            ):
                again = other.contract(box)
                # of steps the repr, because NaN, the bound of one that empties the box, equals nothing
                before, after = (
                    (c.box, repr(c.steps), None if c.point is None else c.point.tobytes(), c.programs)
                    for c in (result, again)
                )
                assert before == after, f"a {kind} one differs {where}: {result} and {again}"
        fresh = next(one for one in cases(seed) if one.name == case.name).network
        assert case.network.digest == digest == fresh.digest, f"the network {case.name!r} was changed"


Check = Callable[..., None]  # (factory) or (factory, seed)

_CHECKS: tuple[Check, ...] = (keeps_solutions, leaves_a_part, is_repeatable)
CONFORMANCE: dict[str, Check] = {check.__name__: check for check in _CHECKS}


def check_contractor(factory: ContractorFactory, *, seed: int = 0) -> None:
    """All checks; AssertionError for the first promise that the contractor does not keep."""
    for check in _CHECKS:
        check(factory, seed)
