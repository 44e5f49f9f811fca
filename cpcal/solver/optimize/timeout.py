"""method="timeout": the method of the paper's section 5.2.1, on any solver that says infeasible, found or timeout.

ask for a point within `delay` seconds at eps     infeasible: eps_lo = eps, go up towards eps_hi
                                                  found:      adjust eps to the point, eps_hi = that
                                                  timeout:    go down towards eps_lo; when too close to it,
                                                              double the delay and go back to the average
"""

import time
from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np

from cpcal.solver.accounts import TimeoutAnswer, Trial
from cpcal.solver.contract import Limits, Strategy
from cpcal.solver.execution.stopping import asked
from cpcal.solver.interval import Box
from cpcal.solver.optimize.witness import Witness, WitnessProver
from cpcal.solver.search.passes import Contracting, Divide
from cpcal.solver.search.search import Event, EventKind, Observer, Search

_CLOSE = 1.0 / 16.0  # of the bracket: an eps nearer than this to its lower end is too close
_SHRINK = 0.9  # of a width: another pass of the contractor is worth while
_DELAY = 0.5  # seconds, of the first call


class TimeoutOutcome(NamedTuple):
    """What a solver returns: its answer, a proved point if it found one.

    `checked`: weights alone prove that the answer is infeasible, so that a certificate can say it.
    """

    answer: TimeoutAnswer
    witness: Witness | None = None
    nodes: int = 0
    programs: int = 0
    checked: bool = False


Solver = Callable[[float, float], TimeoutOutcome]  # eps, seconds


def timeout(
    solve: Solver, *, lo: float, hi: float, limits: Limits, delay: float = _DELAY
) -> Generator[Trial, None, None]:
    """Calls of `solve` until the bracket `[lo, hi]` is closed to the gap of `limits`, or its time is up.

    `lo` is proved infeasible below, `hi` attained: both stay so. The last call gets no more than the time that is left.
    """
    clock = limits.clock()
    eps = 0.5 * (lo + hi)
    while hi - lo > max(limits.gap * hi, limits.gap_absolute) and not clock.over():
        began = time.monotonic()
        found = solve(eps, min(delay, max(clock.deadline - began, 0.0)))
        asked, waited = eps, delay
        if found.answer is TimeoutAnswer.INFEASIBLE:
            lo = eps
            eps = 0.5 * (lo + hi)
        elif found.answer is TimeoutAnswer.FOUND and found.witness is not None:
            hi = min(hi, found.witness.value)
            eps = 0.5 * (lo + hi)
        else:
            eps = 0.5 * (lo + eps)
            if eps - lo < _CLOSE * (hi - lo):
                delay, eps = 2.0 * delay, 0.5 * (lo + hi)
        spent = time.monotonic() - began
        yield Trial(asked, waited, found.answer, lo, hi, found.nodes, found.programs, spent, found.checked)


def ask(
    domain: Box,
    contracting: Contracting,
    strategy: Strategy,
    prover: WitnessProver,
    seconds: float,
    observe: Observer | None = None,
) -> TimeoutOutcome:
    """Search `domain` (its upper end of the objective is the eps that is asked about) for a valid point.

    Boxes that `strategy` no longer divides, and the points that the contractors propose, are tried: whatever their
    smallest objective is, a point that is proved with one in the domain is found.
    """
    highest = float(domain.hi[prover.objective])
    clock = Limits(seconds=seconds).clock()
    search = Search([domain], Divide(contracting, strategy, again=_SHRINK))
    nodes = programs = 0
    for event in search:
        nodes += event.kind is not EventKind.CONTRACTED
        programs += event.contraction.programs
        if observe is not None:
            observe(event)
        witness = _valid(prover, event, highest)
        if witness is not None:
            return TimeoutOutcome(TimeoutAnswer.FOUND, witness, nodes, programs)
        if clock.over() or asked():
            break
    if search.waiting or search.kept:  # a small box that was kept may hold a point or not: nothing is known
        return TimeoutOutcome(TimeoutAnswer.TIMEOUT, None, nodes, programs)
    return TimeoutOutcome(TimeoutAnswer.INFEASIBLE, None, nodes, programs, contracting.proves)


def _valid(prover: WitnessProver, event: Event, highest: float) -> Witness | None:
    """A proved point from an event, with an objective up to `highest`."""
    point, kept = event.contraction.point, event.decision.pieces if event.kind is EventKind.KEPT else ()
    proposed = [] if point is None or event.contraction.box.is_empty else [point]
    for point in proposed + [piece.box.mid for piece in kept]:
        witness = prover.prove(np.asarray(point))
        if witness is not None and witness.value <= highest:
            return witness
    return None
