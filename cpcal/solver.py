"""The verbs on a network: contract, solve, minimize. `cpcal.Network` is what users write."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal import plugins
from cpcal.errors import ModelError
from cpcal.interfaces import Contraction, Contractor, Limits, Verdict
from cpcal.interval import Box, get_arithmetic
from cpcal.network import ConstraintNetwork, Expr
from cpcal.optimize import Bracket, Minimum, minimize, run
from cpcal.proof.exact_network import network_statement
from cpcal.prove import Recording, certifying, claims_of
from cpcal.search import Event, LargestFirst, Search

DEFAULT_CONTRACTORS = ("hc4", "lifted")


@dataclass(frozen=True)
class Solution:
    """A box of a `Paving`: its verdict says what is known of it (UNKNOWN: it may hold solutions)."""

    verdict: Verdict
    box: Box


@dataclass(frozen=True)
class Paving:
    """Every solution in the domain lies in one of `solutions`; `complete` is False when a limit came first.

    `status` says it in a sentence.
    """

    complete: bool
    status: str
    solutions: tuple[Solution, ...]
    nodes: int


class Network(ConstraintNetwork):
    """A constraint network that can be solved.

    THERE EXISTS one value of every reading in its set: that is what each answer quantifies over.
    """

    def contract(
        self,
        box: Box | None = None,
        *,
        contractors: Sequence[str] = DEFAULT_CONTRACTORS,
        arithmetic: str = "float64",
    ) -> Contraction:
        """One pass of the named contractors over `box` (default: the domain). Loses no solution."""
        return plugins.build(self, contractors, arithmetic=arithmetic).contract(self.domain if box is None else box)

    def solve(
        self,
        *,
        width: float = 1e-6,
        contractors: Sequence[str] = DEFAULT_CONTRACTORS,
        arithmetic: str = "float64",
        limits: Limits | None = None,
        progress: Callable[[Event], None] | None = None,
    ) -> Paving:
        """Boxes, of components no wider than `width`, that hold all solutions. Ctrl-C ends it early, cleanly."""
        limits = limits or Limits()
        contractor = plugins.build(self, contractors, arithmetic=arithmetic)
        search = Search([self.domain], contractor, LargestFirst(width))
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
        pending = [node.box for node in search.pending]
        boxes = tuple(Solution(Verdict.UNKNOWN, box) for box in search.kept + pending)
        if not boxes:
            return Paving(True, "The constraints have no common solution in the domain: proved.", (), nodes)
        if pending:
            return Paving(
                False,
                f"Stopped with {len(pending)} boxes undivided; the boxes hold all solutions.",
                boxes,
                nodes,
            )
        return Paving(True, "All solutions lie in the boxes; whether each box holds one is not proved.", boxes, nodes)

    def minimize(
        self,
        objective: Expr,
        *,
        contractors: Sequence[str] = ("lifted",),
        arithmetic: str = "float64",
        limits: Limits | None = None,
        start: npt.ArrayLike | None = None,
        progress: Callable[[Bracket], None] | None = None,
        certificate: str | os.PathLike[str] | None = None,
    ) -> Minimum:
        """The smallest value of `objective`, a scalar variable of this network, bracketed by proofs.

        For another expression, add a variable t with `net.add(expr <= t)` and minimise t. `start` holds one value
        per component in the order of `names`. Raises ModelError for anything but a variable with a finite domain.

        `certificate` names a file for the proof, which states the constraints exactly; then only contractors that give
        weights take part (lifted), and constraints with readings or without polynomial form raise ModelError.
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
        first = None if start is None else np.asarray(start, np.float64)

        def bracketed(contractor: Contractor, observe: Callable[[Event], None] | None) -> Minimum:
            asked = limits or Limits()
            states = minimize(self, name, contractor, engine=engine, limits=asked, start=first, observe=observe)
            return run(states, progress)

        if certificate is None:
            return bracketed(plugins.composed(parts, contractors), None)
        useful = certifying(parts)
        if not useful:
            raise ModelError(f"{', '.join(contractors)} give no weights: no certificate can be written; use lifted")
        with Recording(network_statement(self, name), self.domain) as recording:
            found = bracketed(recording.contractor(useful), recording.event)
            recording.write(certificate, claims_of(found, self.domain, name))
        return found
