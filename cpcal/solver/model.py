"""The verbs on a network: contract, solve, minimize. `cpcal.Network` is what users write."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cpcal.common.errors import ModelError
from cpcal.execution.executors import Here, executor_for
from cpcal.execution.stopping import asked, heard
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.contract import Contraction, Contractor, Limits, Strategy
from cpcal.solver.existence import Inside, UniquenessProver
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.interval.number import float_bounds
from cpcal.solver.network import ConstraintNetwork, Expr, evaluate
from cpcal.solver.network.divisions import with_products
from cpcal.solver.optimize import Bracket, Minimum, minimize, run
from cpcal.solver.search import (
    ORDERS,
    STRATEGIES,
    Contracting,
    Divide,
    Event,
    Paving,
    Priority,
    Search,
    Solution,
    Spread,
    StepProver,
    conclusion,
)

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["DEFAULT_CONTRACTORS", "Network", "Paving", "Solution"]

DEFAULT_CONTRACTORS = ("hc4", "lifted")

_ABREAST = 64  # pending boxes that a round of `solve` takes, whatever the order


class Network(ConstraintNetwork):
    """A constraint network that can be solved.

    THERE EXISTS one value of every reading in its set: that is what each answer quantifies over.
    """

    def contract(
        self,
        box: Box | None = None,
        *,
        contractors: Sequence[str | Contractor] = DEFAULT_CONTRACTORS,
        arithmetic: str = "float64",
    ) -> Contraction:
        """One pass of the named contractors over `box` (default: the domain). Loses no solution.

        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        Raises ModelError for a box of other variables, PluginError for a contractor that is not there.
        """
        network = self._as_asked()
        box = network.domain if box is None else box
        network.check_box(box)
        return plugins.build(network, contractors, arithmetic=arithmetic).contract(box)

    def solve(
        self,
        *,
        width: float = 1e-6,
        contractors: Sequence[str | Contractor] = DEFAULT_CONTRACTORS,
        arithmetic: str = "float64",
        limits: Limits | None = None,
        progress: Callable[[Event], None] | None = None,
        strategy: str | Strategy = "largest",
        order: str = "depth",
        inner: bool = False,
        workers: int | None = None,
        scheduler: str | None = None,
        executor: Executor | Client | None = None,
    ) -> Paving:
        """Boxes, of components no wider than `width`, that hold all solutions. Ctrl-C ends it early, cleanly.

        Where there are as many equations as unknowns, boxes are proved to hold exactly one solution if they do.
        `strategy` says where a box is cut in two: "largest", "round-robin", "smear", "smear-relative", "smear-max" or
        "lp" (or an object); `order` which boxes are next, up to 64 abreast: "depth", "breadth" or "best". `inner=True`
        looks for boxes that hold nothing but solutions, which are not divided, and lists what was proved to hold none:
        see `Paving`.

        `workers` processes, a Dask `scheduler` or an `executor` (see `cpcal.certify`) decide the boxes of each round;
        the answer is the same. It pays where a box takes a millisecond or more.
        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        Raises PluginError for a contractor or strategy that is not there, ModelError for what has no meaning.
        """
        network, clock = self._as_asked(), _limits(limits).clock()
        engine = get_arithmetic(arithmetic)
        process = Divide(
            plugins.build(network, contractors, arithmetic=arithmetic),
            _strategy(network, strategy, _width(width), arithmetic),
            inside=Inside(network, engine) if inner else None,
        )
        nodes = 0
        with heard(), executor_for(workers, scheduler, executor) as place:
            spread = process if isinstance(place[0], Here) else Spread(process, place)
            search = Search([network.domain], spread, _order(network, order), outside=inner, abreast=_ABREAST)
            try:
                for event in search:
                    nodes += 1
                    if progress is not None:
                        progress(event)
                    if clock.over(nodes) or asked():
                        break
            except KeyboardInterrupt:
                pass
            return conclusion(search, UniquenessProver(network, engine), clock, nodes)

    def minimize(
        self,
        objective: Expr,
        *,
        contractors: Sequence[str | Contractor] = ("lifted",),
        arithmetic: str = "float64",
        limits: Limits | None = None,
        start: npt.ArrayLike | None = None,
        progress: Callable[[Bracket], None] | None = None,
        certificate: str | os.PathLike[str] | None = None,
        workers: int | None = None,
        scheduler: str | None = None,
        executor: Executor | Client | None = None,
    ) -> Minimum:
        """The smallest value of `objective`, a scalar expression over this network, bracketed by proofs.

        An expression that is no variable becomes one, "objective", the last of the answer's boxes: it is at least the
        expression, and its first bounds come from interval evaluation. `start` holds one value per component in the
        order of `names`. Raises ModelError for an objective without finite bounds.

        `certificate` names a file for the proof, which states the constraints exactly. The answer is then what the
        certificate proves, by the steps of contractors that give weights (lifted); what all contractors prove beyond
        it is in `found`. `workers`, `scheduler` and `executor` are as in `solve`; certificates are the same, byte for
        byte. Constraints with readings or without polynomial form raise ModelError.
        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        """
        limit, (network, name) = _limits(limits), _with_objective(self._as_asked(), objective)
        network._check_bounded(name, contractors)
        engine = get_arithmetic(arithmetic)
        exact = certificate is not None
        stated = with_products(network, instead=exact)
        parts = plugins.build_each(stated, contractors, objective=name, arithmetic=arithmetic)
        named = list(zip(map(plugins.name_of, contractors), parts, strict=True))
        first = None if start is None else _start(network, start, len(self.names))

        def bracketed(prover: StepProver | None, observe: Callable[[Event], None] | None) -> Minimum:
            with executor_for(workers, scheduler, executor) as place:
                states = minimize(
                    network,
                    name,
                    named,
                    engine=engine,
                    limits=limit,
                    start=first,
                    prover=prover,
                    observe=observe,
                    place=None if isinstance(place[0], Here) else place,
                )
                return run(states, progress)

        if certificate is None:
            with heard():
                return bracketed(None, None)
        if not Contracting(named).gives_weights:
            given = ", ".join(called for called, _ in named)
            raise ModelError(f"{given} give no weights: no certificate can be written; use lifted")
        with heard(), Recording(network_statement(stated, name), network.domain) as recording:
            found = bracketed(recording.prover, recording.event)
            recording.write(certificate, claims_of(found, network.domain, name))
        return replace(found, contractors_used=recording.credited(found.contractors_used))

    def _as_asked(self) -> Network:
        """A copy, since a callback may add to this network meanwhile. Raises ModelError where there is no variable."""
        if not self.names:
            raise ModelError(
                f"{self.name!r} has no variables: declare one with variable(name) before you ask for values"
            )
        return copy(self)

    def _check_bounded(self, objective: str, contractors: Sequence[str | Contractor]) -> None:
        others = [self.domain[component] for component in self.names if component != objective]
        if not all(bounds.is_bounded for bounds in others) and "hc4" not in contractors:
            raise ModelError("minimize needs bounded domains: give every variable one, or put hc4 first")


def _with_objective(network: Network, objective: Expr) -> tuple[Network, str]:
    """A network of whose components the objective is one, and the component's name."""
    if not isinstance(objective, Expr) or objective.shape != () or objective.op in ("variable", "index"):
        return network, network.component(objective)
    network.check_owner(objective)
    bounds = evaluate(network, objective, network.domain)
    name = "objective"
    while any(leaf.name == name for leaf in network.variables):
        name += "_"
    bound = network.variable(name, domain=(float(bounds.lo), float(bounds.hi)))
    network.add(objective <= bound)
    return network, name


def _width(width: float) -> float:
    """A width that some box can have. Raises ModelError."""
    if not _is_number(width) or not width > 0:
        raise ModelError(f"width={width!r} is no width: give a positive number, below which boxes are not divided")
    return float(width)


def _limits(limits: Limits | None) -> Limits:
    """Limits that a search can reach. Raises ModelError."""
    if limits is None:
        return Limits()
    if not isinstance(limits, Limits):
        raise ModelError(f"limits={limits!r} sets no limit: write cpcal.Limits(seconds=...) or cpcal.Limits(nodes=...)")
    given = (limits.seconds, limits.nodes, limits.gap, limits.gap_absolute)
    if not all(value is None or (_is_number(value) and value >= 0) for value in given):
        raise ModelError(f"{limits!r}: seconds, nodes and gaps are numbers of at least 0")
    return limits


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _start(network: ConstraintNetwork, start: npt.ArrayLike, count: int) -> npt.NDArray[np.float64]:
    """A point to start from, one finite number for each of the first `count` components. Raises ModelError."""
    point = float_bounds(start)[0]
    if point.shape != (count,) or not np.isfinite(point).all():
        raise ModelError(f"start={start!r} is no point: give {count} finite numbers, in the order of `names`")
    return np.concatenate([point, network.domain.hi[count:]])


def _strategy(network: ConstraintNetwork, strategy: str | Strategy, width: float, arithmetic: str) -> Strategy:
    if not isinstance(strategy, str):
        if not hasattr(strategy, "split"):
            raise ModelError(f"strategy={strategy!r} divides no box: give a name or an object with split(box)")
        return strategy
    if strategy in STRATEGIES:
        return STRATEGIES[strategy](network, width)
    return plugins.load_strategy(strategy, STRATEGIES)(network, width, arithmetic=arithmetic)


def _order(network: ConstraintNetwork, order: str) -> Priority:
    if order not in ORDERS:
        raise ModelError(f"no order is called {order!r}; there are: {', '.join(ORDERS)}")
    return ORDERS[order](network)
