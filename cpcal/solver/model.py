"""The verbs on a network: contract, solve, minimize. `cpcal.Network` is what users write."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cpcal.errors import ModelError
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.recording import Recording, claims_of
from cpcal.solver.contract import Contraction, Contractor, Limits, Strategy
from cpcal.solver.existence import Inside, UniquenessProver
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.network import ConstraintNetwork, Expr
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
    StepProver,
    conclusion,
)

__all__ = ["DEFAULT_CONTRACTORS", "Network", "Paving", "Solution"]

DEFAULT_CONTRACTORS = ("hc4", "lifted")


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
        """One pass of the named contractors over `box` (default: the domain). Loses no solution."""
        return plugins.build(self, contractors, arithmetic=arithmetic).contract(self.domain if box is None else box)

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
    ) -> Paving:
        """Boxes, of components no wider than `width`, that hold all solutions. Ctrl-C ends it early, cleanly.

        Where there are as many equations as unknowns, boxes are proved to hold exactly one solution if they do.
        `strategy` says where a box is cut in two: "largest", "round-robin", "smear", "smear-relative", "smear-max" or
        "lp" (or an object); `order` which box is next: "depth", "breadth" or "best". `inner=True` looks for boxes that
        hold nothing but solutions, which are not divided, and lists what was proved to hold none: see `Paving`.
        Raises PluginError for a contractor or strategy that is not there, ModelError for an order.
        """
        limits = limits or Limits()
        engine = get_arithmetic(arithmetic)
        process = Divide(
            plugins.build(self, contractors, arithmetic=arithmetic),
            _strategy(self, strategy, width, arithmetic),
            inside=Inside(self, engine) if inner else None,
        )
        search = Search([self.domain], process, _order(self, order), outside=inner)
        nodes = 0
        clock = limits.clock()
        try:
            for event in search:
                nodes += 1
                if progress is not None:
                    progress(event)
                if clock.over(nodes):
                    break
        except KeyboardInterrupt:
            pass
        return conclusion(search, UniquenessProver(self, engine), clock, nodes)

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
    ) -> Minimum:
        """The smallest value of `objective`, a scalar variable of this network, bracketed by proofs.

        For another expression, add a variable t with `net.add(expr <= t)` and minimise t. `start` holds one value
        per component in the order of `names`. Raises ModelError for anything but a variable with a finite domain.

        `certificate` names a file for the proof, which states the constraints exactly. The answer is then what the
        certificate proves, by the steps of contractors that give weights (lifted); what all contractors prove beyond
        it is in `found`. Constraints with readings or without polynomial form raise ModelError.
        """
        name = self.component(objective)
        others = [
            bound
            for component in self.names
            if component != name
            for bound in (self.domain[component].lo, self.domain[component].hi)
        ]
        if not np.isfinite(others).all() and "hc4" not in contractors:
            raise ModelError("minimize needs bounded domains: give every variable one, or put hc4 first")
        engine = get_arithmetic(arithmetic)
        parts = plugins.build_each(self, contractors, objective=name, arithmetic=arithmetic)
        named = list(zip(map(plugins.name_of, contractors), parts, strict=True))
        first = None if start is None else np.asarray(start, np.float64)

        def bracketed(prover: StepProver | None, observe: Callable[[Event], None] | None) -> Minimum:
            asked = limits or Limits()
            states = minimize(
                self, name, named, engine=engine, limits=asked, start=first, prover=prover, observe=observe
            )
            return run(states, progress)

        if certificate is None:
            return bracketed(None, None)
        if not Contracting(named).gives_weights:
            given = ", ".join(called for called, _ in named)
            raise ModelError(f"{given} give no weights: no certificate can be written; use lifted")
        with Recording(network_statement(self, name), self.domain) as recording:
            found = bracketed(recording.prover, recording.event)
            recording.write(certificate, claims_of(found, self.domain, name))
        return replace(found, contractors_used=recording.credited(found.contractors_used))


def _strategy(network: ConstraintNetwork, strategy: str | Strategy, width: float, arithmetic: str) -> Strategy:
    if not isinstance(strategy, str):
        return strategy
    if strategy in STRATEGIES:
        return STRATEGIES[strategy](network, width)
    return plugins.load_strategy(strategy, STRATEGIES)(network, width, arithmetic=arithmetic)


def _order(network: ConstraintNetwork, order: str) -> Priority:
    if order not in ORDERS:
        raise ModelError(f"no order is called {order!r}; there are: {', '.join(ORDERS)}")
    return ORDERS[order](network)
