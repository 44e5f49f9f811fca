"""Which contractors and divisions suit a network, by its structure: what `solve` and `minimize` do without options."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np

from cpcal.solver.consequences import consequences
from cpcal.solver.existence import Equalities, reads
from cpcal.solver.interval import get_arithmetic
from cpcal.solver.network import Constraint, ConstraintNetwork, polynomial_form
from cpcal.solver.network.dag import topological

_LIFTED_UNKNOWNS, _LIFTED_PRODUCTS = 40, 1000  # beyond, linear programs of products take too long at each node
_DENSE_UNKNOWNS = 100  # for the linear programs of beaumont, one row and two programs an unknown
_TURNS = (16, 8)  # of hc4 and newton alone, and of cid and beaumont, where there is lifted
_LIFTED_COEFFICIENTS = 4_000_000  # of one array of expressions, as of a matrix times the unknowns: some 100 MB
_SLICES, _LEAST_SLICE, _LIFTED_SLICE = (2048, 16), 8, 32
_CUBE = 4000  # of the unknowns: up to there a node takes some ten microseconds
_SHALLOW = {"add", "sub", "neg", "mul", "sqr", "index", "sum", "constant", "variable", "power", "div"}


@dataclass(frozen=True)
class SearchMethod:
    """Contractors, the strategy that divides, and how many nodes of it cost about as much as those of the others.

    It gives way to the others after so many `turns`, and does not begin before the round `begins`.
    """

    contractors: tuple[str, ...]
    strategy: str
    slice: int
    turns: int | None = None
    begins: int = 0
    consequences: bool = False  # of the equations, besides them

    @property
    def name(self) -> str:
        besides = " with consequences of the equations" if self.consequences else ""
        return f"{', '.join(self.contractors)}{besides} by {self.strategy}"


CERTIFYING = (("lifted",), "it gives weights")
AS_ASKED = (SearchMethod(("as asked",), "largest", 64),)


@dataclass(frozen=True)
class Choice:
    """The methods that take turns, cheapest first, and why these."""

    methods: tuple[SearchMethod, ...]
    why: str
    consequences: tuple[Constraint, ...] = ()  # what follows from the equations, for the methods that ask for it

    def rows(self, network: ConstraintNetwork, method: SearchMethod) -> ConstraintNetwork:
        """What the contractors of a method work on."""
        out = copy(network)
        out.add(self.consequences if method.consequences else ())
        return out


def choice_to_solve(network: ConstraintNetwork, deadline: float = math.inf) -> Choice:
    """What to solve a network by; what is not polynomial at `deadline` (of time.monotonic()) counts as not."""
    unknowns = int(np.sum(network.domain.hi > network.domain.lo))
    equations = Equalities.of(network)
    lifted = _lifts(network, deadline)
    if equations.count != unknowns or equations.reads:
        kind = "fewer equations than unknowns" if equations.count < unknowns else "more equations than unknowns"
        why = f"{kind if not equations.reads else 'equations with readings'}: there is nothing for newton to prove"
        return Choice((SearchMethod(("hc4", "lifted") if lifted else ("hc4",), "largest", 64),), why)
    many, few = _TURNS if lifted else (None, None)
    quick, slow = _slices(unknowns)
    methods = [SearchMethod(("hc4", "newton"), by, quick, many) for by in ("largest", "smear-relative")]
    more = consequences(network) if lifted else ()
    if more:
        methods.append(SearchMethod(("hc4", "newton"), "largest", quick, many, consequences=True))
    methods.append(SearchMethod(("hc4", "cid", "newton"), "smear-relative", slow, few, begins=1))
    if unknowns <= _DENSE_UNKNOWNS:
        methods.append(SearchMethod(("hc4", "newton", "beaumont"), "smear-relative", slow, few, begins=1))
    if lifted:
        methods.append(SearchMethod(("hc4", "newton", "lifted"), "smear-relative", _LIFTED_SLICE, begins=1))
        methods.append(SearchMethod(("lifted", "newton"), "largest", _LIFTED_SLICE, begins=1))
    kind = "polynomial" if lifted else "not polynomial, or with too many products for lifted"
    return Choice(tuple(methods), f"{unknowns} equations in as many unknowns, {kind}", more)


def _slices(unknowns: int) -> tuple[int, int]:
    """Nodes in a turn of hc4 and newton alone, and of cid and beaumont: a tenth of a second or so.

    What newton takes for a box grows with the third power of the unknowns.
    """
    times = max(1.0, unknowns**3 / _CUBE)
    quick, slow = (max(_LEAST_SLICE, int(nodes / times)) for nodes in _SLICES)
    return quick, slow


def choice_to_minimize(network: ConstraintNetwork, deadline: float = math.inf) -> tuple[tuple[str, ...], str]:
    """The contractors to minimise by, and why; `deadline` as in `choice_to_solve`."""
    if any(map(reads, network.constraints)):
        return ("lifted",), "readings: lifted takes them at the ends that decide"
    if not _lifts(network, deadline):
        return ("hc4", "beaumont"), "no row is polynomial, or there are too many products for lifted"
    left = [c for c in network.constraints if any(node.op not in _SHALLOW for node in topological((c.body,)))]
    if left:
        return ("hc4", "lifted", "beaumont"), f"{len(left)} constraints are not polynomial: beaumont linearises them"
    return ("hc4", "lifted"), "polynomial, or with roots and divisions that are multiplied out"


def _lifts(network: ConstraintNetwork, deadline: float) -> bool:
    """Whether lifted has rows to work on, and not too many products."""
    if any(map(reads, network.constraints)):
        return True
    if len(network.names) > _LIFTED_UNKNOWNS:
        linear_time = all(len(c.body.shape) for c in network.constraints)
        sizes = (math.prod(node.shape) for c in network.constraints for node in topological((c.body,)))
        largest = max(sizes, default=0)
        if not linear_time or largest * len(network.names) > _LIFTED_COEFFICIENTS:
            return False
    system = polynomial_form(network, get_arithmetic("float64"), deadline=deadline)
    return bool(len(system.origin)) and len(system.monomials) <= _LIFTED_PRODUCTS
