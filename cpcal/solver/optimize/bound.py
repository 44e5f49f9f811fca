"""method="bound": branch and bound on the objective, a variable of the network like any other.

Below, the contractors raise the objective's lower bound; above, a local fit proposes points that
`WitnessProver` proves. Between the two the bracket is valid at every moment.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cpcal.numbers import at_least, gap_text
from cpcal.solver.contract import Contractor, Limits, Strategy, Verdict
from cpcal.solver.interval import Arithmetic, Box
from cpcal.solver.network import ConstraintNetwork
from cpcal.solver.optimize.bounding import Bounding
from cpcal.solver.optimize.witness import Witness
from cpcal.solver.search import Event, EventKind, LargestFirst, Search

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Bracket:
    """The state of a minimisation: the optimum lies in `[lo, hi]` (hi infinite: no point proved yet)."""

    lo: float
    hi: float
    nodes: int
    programs: int
    seconds: float


@dataclass(frozen=True)
class Minimum:
    """The end of a minimisation over a box.

    `lo`: proved, no solution has a smaller objective. `hi` and `witness`: a proved solution. `enclosure`: holds every
    solution with objective <= hi. `floor`: the second-order effect of the readings at the witness; boxes are not
    divided to close a smaller gap (though contraction alone often closes it). `rows`: the (constraint, element) pairs
    with a multiplier in some step of the proof of `lo`; `decisive_rows`: those of the steps that decided the leaves.
    """

    lo: float
    hi: float
    verdict: Verdict
    status: str
    witness: Witness | None
    enclosure: Box
    floor: float
    rows: tuple[tuple[int, int], ...]
    decisive_rows: tuple[tuple[int, int], ...]
    pending: int
    nodes: int
    programs: int
    seconds: float
    interrupted: bool = False


def minimize(
    network: ConstraintNetwork,
    objective: str,
    contractor: Contractor,
    *,
    engine: Arithmetic,
    limits: Limits,
    start: Floats | None = None,
    strategy: Strategy | None = None,
    enclose: bool = True,
    observe: Callable[[Event], None] | None = None,
) -> Generator[Bracket | Minimum, None, None]:
    """Brackets of the smallest value of the variable `objective`, then the `Minimum` as the last item.

    THERE EXISTS a reading in its set for every constraint, as in the network. `start` (n,) is where the
    first fit begins (default: the middle of the domain). Without `enclose` no work is spent on a tight enclosure.
    `observe` is told of every node's fate. Close the iterator to stop early.
    """
    began = time.monotonic()
    index = network.names.index(objective)
    clock = limits.clock()
    domain = network.domain
    if strategy is None:
        strategy = LargestFirst(scale=np.where(domain.rad > 0.0, domain.rad, 1.0), skip=(objective,))
    bounding = Bounding(network, index, contractor, strategy, limits, engine, enclose)
    search = Search([domain], bounding, bounding, lambda node: float(node.box.lo[index]))
    nodes = 0

    def bracket() -> Bracket:
        return Bracket(_lowest(search, bounding), bounding.hi, nodes, bounding.programs, time.monotonic() - began)

    interrupted = False
    try:
        bounding.propose(domain.mid if start is None else np.asarray(start, np.float64))
        while search.pending and not clock.over(nodes):
            event = next(search)
            if observe is not None:
                observe(event)
            nodes += event.kind is not EventKind.CONTRACTED
            yield bracket()
    except KeyboardInterrupt:
        interrupted = True
    yield _minimum(search, bounding, bracket(), interrupted)


def _lowest(search: Search, bounding: Bounding) -> float:
    boxes = [node.box for node in search.pending] + search.kept
    return min([float(box.lo[bounding.objective]) for box in boxes] + [bounding.hi])


def _minimum(search: Search, bounding: Bounding, last: Bracket, interrupted: bool) -> Minimum:
    pending = [bounding.cut(node.box) for node in search.pending]
    kept = [bounding.cut(box) for box in search.kept]
    enclosure = Box.empty(bounding.domain.names)
    for box in kept + pending:
        enclosure = enclosure.hull(box)
    undecided = [box for box in pending if not box.is_empty and not bounding.settled(box)]
    verdict, status = _status(last, bounding, len(undecided))
    return Minimum(
        last.lo,
        last.hi,
        verdict,
        status,
        bounding.witness,
        enclosure,
        bounding.floor,
        tuple(sorted(bounding.used)),
        tuple(sorted(bounding.decisive)),
        len(undecided),
        last.nodes,
        last.programs,
        last.seconds,
        interrupted,
    )


def _status(last: Bracket, bounding: Bounding, undecided: int) -> tuple[Verdict, str]:
    if bounding.witness is None and not undecided and last.lo == np.inf:
        return Verdict.REFUTED, "No point of the domain satisfies the constraints: proved."
    if bounding.witness is None:
        return Verdict.UNKNOWN, "No point was proved to satisfy the constraints; the lower bound is proved."
    if last.hi == bounding.domain.lo[bounding.objective]:
        return Verdict.PROVED, "The smallest value that the domain allows is attained: proved."
    gap, printed = last.hi - last.lo, gap_text(last.lo, last.hi)
    if gap <= max(bounding.limits.gap * abs(last.hi), bounding.limits.gap_absolute):
        return Verdict.PROVED, "Both bounds are proved and the gap is closed."
    if not undecided and gap <= bounding.floor:
        floor = at_least(bounding.floor, 2)
        return (
            Verdict.PROVED,
            f"Both bounds are proved; the gap of {printed} is below the second-order effect of the readings, {floor}.",
        )
    if not undecided:
        return (
            Verdict.UNKNOWN,
            f"Both bounds are proved; the contractors cannot close the gap of {printed}.",
        )
    return (
        Verdict.UNKNOWN,
        f"Stopped at a limit with {undecided} undecided boxes; both bounds are proved, the gap is open.",
    )


def run(states: Generator[Bracket | Minimum, None, None], progress: Callable[[Bracket], None] | None) -> Minimum:
    """Run to the end, telling `progress` of every bracket; Ctrl-C ends it with what is proved."""
    while True:
        try:
            state = next(states)
            if not isinstance(state, Minimum) and progress is not None:
                progress(state)
        except KeyboardInterrupt as stop:
            state = states.throw(stop)
        if isinstance(state, Minimum):
            return state
