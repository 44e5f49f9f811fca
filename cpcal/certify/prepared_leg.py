"""One leg, set up once for all that is asked about it: bracket, support, ranges, projections.

It is passed from one question to the next and goes when the leg is done. What contractors keep of the boxes before
(expanded rows, for the readings that decide there) serves the next question, which comes by the same boxes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from cpcal.certify.question import Question
from cpcal.common.arrays import Floats, Indices
from cpcal.legs import built_in
from cpcal.solver.certificate.statement import Statement
from cpcal.solver.contract import Contractor, Restrictable, gives_weights
from cpcal.solver.interval import Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.network.restrict import restricted
from cpcal.solver.optimize import Prepared
from cpcal.solver.search import Contracting


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedLeg:
    """A leg (from 1) of a question, around `center` (n,): parameters of the model in mm.

    problem    its equations, eps up to what they allow, or the one that is asked about
    named      the contractors asked for, for all of these
    statement  what its certificates say; None where there are none, or where they depend on the values of eps
    """

    question: Question
    leg: int
    center: Floats
    problem: Prepared
    named: list[tuple[str, Contractor]]
    statement: Statement | None

    @classmethod
    def of(cls, question: Question, leg: int, center: Floats | None = None) -> PreparedLeg:
        """`center`: where it is known."""
        center = question.center(leg) if center is None else center
        network = question.network(leg, center)
        named = question.named(network)
        proving = question.certificates is not None and Contracting(named).gives_weights
        return cls(
            question=question,
            leg=leg,
            center=center,
            problem=Prepared(network, "eps", question.engine),
            named=named,
            statement=question.statement(leg, network.domain) if proving and built_in(question.model) else None,
        )

    @property
    def network(self) -> ConstraintNetwork:
        return self.problem.network

    @property
    def domain(self) -> Box:
        """All parameters, and every eps that is asked about."""
        return self.network.domain

    def at(self, eps: float) -> Box:
        """All parameters, and one eps. Empty where the legs are too short for that one."""
        lo, hi = self.domain["eps"].lo, self.domain["eps"].hi
        return self.domain.replace("eps", lo=eps, hi=eps) if lo <= eps <= hi else Box.empty(self.domain.names)

    def alone(self, elements: Indices) -> tuple[Prepared, list[tuple[str, Contractor]]]:
        """Some measurements (numbers from 0) alone, and the contractors that use no others."""
        smaller = restricted(self.network, [elements] * len(self.network.constraints))
        problem = Prepared(smaller, "eps", self.question.engine)
        if self.restrictable:
            return problem, [(name, c.restricted_to(elements)) for name, c in self.named if isinstance(c, Restrictable)]
        return problem, self.question.named(smaller)

    @property
    def restrictable(self) -> bool:
        """Whether each contractor can be restricted, and says by weights which measurements it used."""
        return all(isinstance(c, Restrictable) and gives_weights(c) for _, c in self.named)

    def asking(self, question: Question) -> PreparedLeg:
        """The same leg and box, of another question."""
        return replace(self, question=question)

    def stated(self, domain: Box) -> Statement | None:
        """What a certificate about a part of the domain would say; None where none is wanted, or there can be none."""
        if self.question.certificates is None or not Contracting(self.named).gives_weights:
            return None
        return self.statement or self.question.statement(self.leg, domain)
