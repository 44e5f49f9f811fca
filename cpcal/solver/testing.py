"""Conformance suite for contractors: what every one must hold to, ours and a plug-in author's.

    from cpcal.solver.testing import CONFORMANCE

    @pytest.mark.parametrize("name", CONFORMANCE)
    def test_conformance(name):
        CONFORMANCE[name](MyContractor)

Each check builds the contractor, by a factory as the entry point names it, on a set of small networks and tries
it on random boxes. A failure is an AssertionError that says which promise was broken, where.
"""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cpcal.common.values import Floats
from cpcal.solver.contract import (
    ROUNDING,
    Contraction,
    Contractor,
    ContractorFactory,
    Repeat,
    Then,
    Union,
    monotone_tolerance,
)
from cpcal.solver.interval import Box, Interval
from cpcal.solver.network import ConstraintNetwork, maximum, minimum, norm, sqr, sqrt

# ------------------------------------------------------------------------------------------------------------------
# Small networks with known solutions, and random boxes to try a contractor on.

BOXES = 8  # random boxes for each network


@dataclass(frozen=True)
class Case:
    """A network and some of its solutions, (S, n): exact ones, or ones with room to spare."""

    name: str
    network: ConstraintNetwork
    solutions: Floats


def cases(seed: int = 0) -> list[Case]:
    """The networks of the suite. Known solutions have few binary digits wherever a constraint is tight."""
    rng = np.random.default_rng(seed)
    return [make(ConstraintNetwork(), rng) for make in _MAKERS]


def _dyadic(rng: np.random.Generator, shape: int | tuple[int, ...], largest: int = 24) -> Floats:
    """Random multiples of 1/8: sums and products of a few of them are exact in float64."""
    return rng.integers(-largest, largest + 1, shape) / 8.0


def _linear(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 3, (-10, 10))
    a, y = _dyadic(rng, (4, 3)), _dyadic(rng, (6, 3))
    net.add((a[:2] @ x).within((np.min(y @ a[:2].T, axis=0), np.max(y @ a[:2].T, axis=0))))
    net.add(a[2] @ x <= float(np.max(y @ a[2])))
    return Case("linear", net, y)


def _circle(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x, y = net.variable("x", (), (-8, 8)), net.variable("y", (), (-8, 8))
    net.add([sqr(x) + y * y == 25, sqrt(x + 8) >= y - 3])
    return Case("circle", net, np.array([[3.0, 4], [-4, 3], [5, 0], [0, -5], [-3, -4], [1.4, 4.8]][:5]))


def _products(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 4, (-40, 40))
    net.add([x[0] * x[1] == x[2], x[0] * x[1] * x[2] - x[3] ** 3 <= 8, x[3] >= x[0] ** 2 - 20])
    y = _dyadic(rng, (40, 4))
    y[:, 2] = y[:, 0] * y[:, 1]
    y = y[(y[:, 2] ** 2 <= 8 + y[:, 3] ** 3) & (y[:, 3] >= y[:, 0] ** 2 - 20)]
    return Case("products", net, y)


def _leg(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    a, b = net.variable("a", 3, (-60, 60)), net.variable("b", 3, (-60, 60))
    offset, eps = net.variable("l", (), (-60, 60)), net.variable("eps", (), (0, 50))
    y = rng.uniform(-20, 20, (6, 8))
    position = rng.uniform(-100, 100, (10, 3)) + [0, 0, 400]
    turn = np.linalg.qr(rng.standard_normal((10, 3, 3)))[0]
    arms = position + np.einsum("kij,sj->ski", turn, y[:, 3:6]) - y[:, None, :3]
    lengths = np.linalg.norm(arms, axis=2) - y[:, 6:7]
    y[:, 7] = np.max(np.abs(lengths - lengths[0]), axis=1) + 1e-6
    y = y[y[:, 7] <= 50]
    net.add((norm(position + turn @ b - a) - (lengths[0] + offset)).within((-eps, eps)))
    return Case("leg", net, y)


def _readings(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    """Distances to points, both uncertain: a point solves when SOME readings in their sets fit."""
    a = net.variable("a", 2, (-60, 60))
    point, away = rng.uniform(-20, 20, 2), rng.uniform(-100, 100, (8, 2))
    radius = np.array([0.2, 0.1])
    slack = 0.999 * rng.uniform(-1, 1, (8, 2)) * radius
    lengths = np.linalg.norm(away + slack - point, axis=1)
    read = lengths + 0.999 * rng.uniform(-0.5, 0.5, 8)
    net.add(norm(net.reading(away, radius) - a) == net.reading(read, 0.5))
    return Case("readings", net, point[None])


def _twins(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    """Two readings of equal sets are two numbers; so are two equal enclosures of constants."""
    x = net.variable("x", 4, (-3, 3))
    net.add([x[0] == net.reading(0.0, 1.0) - net.reading(0.0, 1.0)])
    net.add([x[1] == x[2] * net.reading(1.0, 0.5), x[3] <= Interval(1, 2) * net.reading(1.0, 0.5)])
    return Case("twins", net, np.array([[1.5, 1.25, 1.0, -1], [-1.75, -0.5, -1.0, 0.5], [0.0, 0.0, 0.0, 0.25]]))


def _unbounded(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x, y = net.variable("x"), net.variable("y", (), (0, np.inf))
    net.add([x - 2 * y == 1, x * y >= -4, x.within((-np.inf, 1e6))])
    y_ = np.abs(_dyadic(rng, 8))
    return Case("unbounded", net, np.stack([1 + 2 * y_, y_], axis=1))


def _kinks(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 4, (-30, 30))
    net.add([maximum(x[0], x[1]) <= x[2], minimum(x[0], 2 * x[1]) >= x[3], abs(x[0] - x[1]) + abs(x[2]) <= 9])
    net.add([2 - abs(x[0]) <= x[2] - x[3], maximum(x[2], x[3]) == x[2]])
    y = _dyadic(rng, (300, 4))
    y[:, 2] = np.maximum(y[:, 0], y[:, 1])
    y[:, 3] = np.minimum(y[:, 0], 2 * y[:, 1])
    y = y[(np.abs(y[:, 0] - y[:, 1]) + np.abs(y[:, 2]) <= 9) & (2 - np.abs(y[:, 0]) <= y[:, 2] - y[:, 3])]
    return Case("kinks", net, y[:8])


def _division(net: ConstraintNetwork, rng: np.random.Generator) -> Case:
    x = net.variable("x", 3, (-12, 12))
    net.add([x[0] / x[1] == x[2], 1 / (1 + sqr(x[0])) <= 0.9, x[1] ** -2 <= 70, sqrt(x[2] + 12) >= 1])
    y = _dyadic(rng, (60, 3))
    y[:, 1] = 2.0 ** rng.integers(-3, 3, 60) * rng.choice([-1, 1], 60)
    y[:, 2] = y[:, 0] / y[:, 1]
    good = (np.abs(y[:, 2]) <= 10) & (np.abs(y[:, 0]) >= 0.5)
    return Case("division", net, y[good][:8])


_MAKERS = (_linear, _circle, _products, _leg, _readings, _twins, _unbounded, _kinks, _division)


def boxes(case: Case, seed: int = 0) -> Iterator[Box]:
    """The domain, then random boxes in it: around solutions, with solutions on a face, single points, any."""
    rng = np.random.default_rng([seed, 1])
    domain = case.network.domain
    yield domain
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
        contractor = _made(factory, case)
        for box in boxes(case, seed):
            yield case, contractor, box, contractor.contract(box), f"on the network {case.name!r} and {box!r}"


def _made(factory: ContractorFactory, case: Case) -> Contractor:
    return factory(case.network, objective=None, arithmetic="float64")


# the promises -----------------------------------------------------------------------------------------------


def keeps_solutions(factory: ContractorFactory, seed: int = 0) -> None:
    """No solution is lost: neither of constraints nor of constraints that hold for SOME readings."""
    for case, _, box, result, where in _trials(factory, seed):
        for point in case.solutions:
            if point in box:
                assert point in result.box, f"the solution {point.tolist()} is lost {where}: {result.box!r}"
                outside = result.polyhedron is not None and point not in result.polyhedron
                assert not outside, f"the solution {point.tolist()} lies outside of the polyhedron {where}"


def never_widens(factory: ContractorFactory, seed: int = 0) -> None:
    """The result is a subset of the box, with the same names (and so has a polyhedron, if any)."""
    for _, _, box, result, where in _trials(factory, seed):
        assert result.box.names == box.names, f"the names changed to {result.box.names} {where}"
        others = result.polyhedron is not None and result.polyhedron.names != box.names
        assert not others, f"the polyhedron has other names {where}"
        assert result.box.subset(box), f"the result is no subset {where}: {result.box!r}"


def keeps_empty(factory: ContractorFactory, seed: int = 0) -> None:
    """The empty box stays empty, without an error."""
    for case in cases(seed):
        result = _made(factory, case).contract(Box.empty(case.network.names))
        assert result.box.is_empty, f"the empty box became {result.box!r} on the network {case.name!r}"


def is_monotone(factory: ContractorFactory, seed: int = 0) -> None:
    """From A in B follows contract(A) in contract(B), up to rounding.

    A contractor that linearises on the box, or stops at a tolerance, is monotone only up to that: it states
    `monotone_tolerance`, a share of B's width; infinite for one that promises nothing. A is chosen around a solution of
    B, if one is known: any contractor keeps it.
    """
    rng = np.random.default_rng([seed, 2])
    for case, contractor, big, outer, where in _trials(factory, seed):
        if big.is_empty:
            continue
        lo, hi = np.maximum(big.lo, -1e3), np.minimum(big.hi, 1e3)
        ends = np.sort(rng.uniform(lo, hi, (2, len(lo))), axis=0)
        known = [point for point in case.solutions if point in big][:1]
        small = big.with_bounds(np.min([ends[0], *known], axis=0), np.max([ends[1], *known], axis=0))
        inner = contractor.contract(small).box
        assert all(point in inner for point in known), f"the solution {known} is lost in a part, {small!r}, {where}"
        tolerance = monotone_tolerance(contractor)
        if inner.is_empty or tolerance == np.inf:
            continue
        assert not outer.box.is_empty, f"a part, {small!r}, is kept, but not the whole {where}"
        room = tolerance * (hi - lo) + ROUNDING * np.maximum(np.abs(lo), np.abs(hi))
        good = (inner.lo >= outer.box.lo - room) & (inner.hi <= outer.box.hi + room)
        assert good.all(), f"not monotone: {small!r} gives {inner!r}, the whole {outer.box!r}, {where}"


def is_idempotent_if_promised(factory: ContractorFactory, seed: int = 0) -> None:
    """`idempotent`, where declared, is a bool, and where it is True a second call changes nothing."""
    for _, contractor, _, result, where in _trials(factory, seed):
        declared = getattr(contractor, "idempotent", False)
        assert isinstance(declared, bool), "a contractor states `idempotent`, True or False"
        if declared:
            again = contractor.contract(result.box).box
            assert again == result.box, f"not idempotent, though promised: {result.box!r}, then {again!r}, {where}"


def is_deterministic(factory: ContractorFactory, seed: int = 0) -> None:
    """The same box gives the same bytes: on the same object again, and on a new one, whatever either saw before."""
    for _, group in itertools.groupby(_trials(factory, seed), key=lambda trial: trial[0].name):
        trials = list(group)
        other = _made(factory, trials[0][0])
        for _, contractor, box, result, where in reversed(trials):
            for again in (contractor.contract(box), other.contract(box)):
                _same(result, again, f"a second call differs {where}")


def pickles(factory: ContractorFactory, seed: int = 0) -> None:
    """A contractor goes through pickle, and what comes out gives the same results."""
    copies: dict[str, Contractor] = {}
    for case, contractor, box, result, where in _trials(factory, seed):
        if case.name not in copies:
            try:
                copies[case.name] = pickle.loads(pickle.dumps(contractor))
            except Exception as error:
                raise AssertionError(f"the contractor does not pickle: {error!r}") from error
        _same(result, copies[case.name].contract(box), f"the pickled copy differs {where}")


def leaves_input_alone(factory: ContractorFactory, seed: int = 0) -> None:
    """The box and the network are the same after the call as before."""
    untouched = {case.name: (case.network.digest, list(boxes(case, seed))) for case in cases(seed)}
    for case, _, box, _, _ in _trials(factory, seed):
        digest, left = untouched[case.name]
        assert box == left.pop(0), f"the box given was changed to {box!r}"
        assert case.network.digest == digest, f"the network {case.name!r} was changed"


def steps_agree(factory: ContractorFactory, seed: int = 0) -> None:
    """Steps name variables and sides of the box, and no step moves a bound further than the result has it."""
    for _, _, box, result, where in _trials(factory, seed):
        assert result.programs >= 0, f"{result.programs} linear programs {where}"
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


def declares_truly(factory: ContractorFactory, seed: int = 0) -> None:
    """Declarations are of their types; one that gives weights gives them for some step, and they are multipliers."""
    weights = set[bool]()
    for case, contractor, _, result, where in _trials(factory, seed):
        declared = getattr(contractor, "gives_weights", False)
        assert isinstance(declared, bool), "a contractor states `gives_weights`, True or False"
        assert monotone_tolerance(contractor) >= 0.0, "a `monotone_tolerance` is a share of a width, 0 or more"
        carried = [step.weights for step in result.steps if step.weights is not None]
        for step in carried:
            values = [entry[-1] for kind in (step.rows, step.products, step.tangents) for entry in kind]
            assert all(0.0 <= value < np.inf for value in values), f"a weight is no multiplier {where}"
            assert all(0 <= c < len(case.network.constraints) for c, *_ in step.rows), f"no such constraint {where}"
        weights |= {bool(carried)} if declared else set()
    assert not weights or True in weights, "a contractor that declares `gives_weights` gives none"


def composes(factory: ContractorFactory, seed: int = 0) -> None:
    """Twice, repeated and joined with itself by the core's algebra it still loses no solution."""
    for case in cases(seed):
        made = _made(factory, case)
        for both in (Then(made, made), Union(made, made), Repeat(made, most=3)):
            for box in itertools.islice(boxes(case, seed), 3):
                left = both.contract(box).box
                where = f"by {type(both).__name__} on the network {case.name!r} and {box!r}"
                assert left.subset(box), f"the result is no subset {where}: {left!r}"
                lost = [point.tolist() for point in case.solutions if point in box and point not in left]
                assert not lost, f"the solution {lost[0]} is lost {where}"


def _same(one: Contraction, two: Contraction, message: str) -> None:
    assert _content(one) == _content(two), f"{message}: {one} and {two}"


def _content(c: Contraction) -> tuple[object, ...]:
    """What is compared; of steps the repr, because NaN, the bound of one that empties the box, equals nothing."""
    rows = () if c.polyhedron is None else (c.polyhedron.matrix.tobytes(), c.polyhedron.rhs.tobytes())
    return c.box, repr(c.steps), None if c.point is None else c.point.tobytes(), c.programs, rows


Check = Callable[..., None]  # (factory) or (factory, seed)

_CHECKS: list[Check] = [keeps_solutions, never_widens, keeps_empty, is_monotone, is_idempotent_if_promised]
_CHECKS += [is_deterministic, pickles, leaves_input_alone, steps_agree, declares_truly, composes]
CONFORMANCE: dict[str, Check] = {check.__name__: check for check in _CHECKS}


def check_contractor(factory: ContractorFactory, *, seed: int = 0) -> None:
    """All checks; AssertionError for the first promise that the contractor does not keep."""
    for check in _CHECKS:
        check(factory, seed)
