"""The verbs on a network: contract, solve, minimize. `cpcal.Network` is what users write."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from copy import copy
from dataclasses import replace
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

import numpy.typing as npt

from cpcal.common import numbers
from cpcal.common.errors import ModelError
from cpcal.common.names import listed
from cpcal.execution.executors import Here, executor_for
from cpcal.execution.stopping import heard
from cpcal.execution.threads import linear_algebra_on_one_thread
from cpcal.solver import plugins
from cpcal.solver.certificate.exact_network import network_statement
from cpcal.solver.certificate.recording import Recording
from cpcal.solver.certificate.search_keeper import SearchKeeper
from cpcal.solver.certificate.uncertified import certified
from cpcal.solver.choice import AS_ASKED, CERTIFYING, Choice, SearchMethod, choice_to_minimize, choice_to_solve
from cpcal.solver.compiled import TimeUp, compiling_until
from cpcal.solver.contract import (
    Contraction,
    Contractor,
    Repeat,
    Strategy,
    Then,
    Verdict,
    contracted,
    in_sequence,
    until,
)
from cpcal.solver.existence import Inside, UniquenessProver
from cpcal.solver.interval import Box, get_arithmetic
from cpcal.solver.limits import Limits
from cpcal.solver.network import ConstraintNetwork, Expr
from cpcal.solver.network.divisions import with_products
from cpcal.solver.optimize import Bracket, Minimum, minimize, run
from cpcal.solver.questions import (
    checked_limits,
    named_contractors,
    named_order,
    named_strategy,
    relaxed,
    remaining,
    resolution,
    start_point,
    width_sentence,
    with_objective,
)
from cpcal.solver.row_use import row_use
from cpcal.solver.search import (
    Contender,
    Divide,
    Event,
    Paving,
    Process,
    Race,
    Search,
    Solution,
    WholeNumbers,
    conclusion,
    spread_over,
)
from cpcal.solver.search.paving_checkpoint import PavingCheckpoint, checkpoint_of, raced

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["DEFAULT_CONTRACTORS", "Network", "Paving", "Solution"]

DEFAULT_CONTRACTORS = ("hc4", "lifted")

P = ParamSpec("P")
T = TypeVar("T")

_LOADS = ("cpcal.solver.model", "cpcal.solver.numba_begun")  # of workers
_ABREAST = 64  # pending boxes that a round of `solve` takes, whatever the order


def _or_late(answer: Callable[[ConstraintNetwork, str], T]) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Of a verb: `answer` of the network, and why, where the time limit comes before there is anything to search by."""

    def in_time(verb: Callable[P, T]) -> Callable[P, T]:
        @wraps(verb)
        def asked_of(*args: P.args, **options: P.kwargs) -> T:
            try:
                return verb(*args, **options)
            except TimeUp as late:
                network = args[0]
                assert isinstance(network, ConstraintNetwork)
                return answer(network, str(late))

        return asked_of

    return in_time


def _no_paving(network: ConstraintNetwork, why: str) -> Paving:
    solutions = (Solution(Verdict.UNKNOWN, network.domain),)
    return Paving(False, f"Not begun: {why}; the domain holds all solutions.", solutions, 0, method=why)


def _no_minimum(network: ConstraintNetwork, why: str) -> Minimum:
    return Minimum(
        lo=-math.inf,
        hi=math.inf,
        verdict=Verdict.UNKNOWN,
        status=f"Not begun: {why}.",
        witness=None,
        enclosure=network.domain,
        floor=0.0,
        rows=(),
        decisive_rows=(),
        pending=1,
        nodes=0,
        programs=0,
        seconds=0.0,
        names=network.names,
        method=why,
    )


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
        return contracted(plugins.build(network, contractors, arithmetic=arithmetic), box)

    @_or_late(_no_paving)
    def solve(
        self,
        *,
        width: float | None = None,
        contractors: Sequence[str | Contractor] | None = None,
        arithmetic: str = "float64",
        limits: Limits | None = None,
        time_limit: float | None = None,
        node_limit: int | None = None,
        progress: Callable[[Event], None] | None = None,
        strategy: str | Strategy | None = None,
        order: str = "depth",
        inner: bool = False,
        workers: int | None = None,
        scheduler: str | None = None,
        executor: Executor | Client | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
        resume: bool = False,
    ) -> Paving:
        """Boxes, of components no wider than `width`, that hold all solutions. Ctrl-C ends it early, cleanly.

        Without `width` it is 1e-6 where equations leave single points. Where they leave curves or regions, one is
        chosen that cuts them into some hundred to some thousand boxes, and `Paving.method` says which. Half of it takes
        twice as long along a curve, four times on a surface: set `limits` with it. Where solutions may run to infinity,
        boxes further than 100 from 0 are not divided; with a width that is asked for they are: set `limits`.

        Where there are as many equations as unknowns, boxes are proved to hold exactly one solution if they do.
        Without `contractors` and `strategy` several combinations that suit the network's structure take turns, and the
        first that ends is the answer; `Paving.method` says which and why.
        `strategy` says where a box is cut in two: "largest", "round-robin", "smear", "smear-relative", "smear-max" or
        "lp" (or an object); `order` which boxes are next, up to 64 abreast: "depth", "breadth" or "best". `inner=True`
        looks for boxes that hold nothing but solutions, which are not divided, and lists what was proved to hold none:
        see `Paving`. `time_limit` and `node_limit` are `limits=Limits(seconds=..., nodes=...)`; the time counts from
        the call, and when it is over no function is compiled any more.

        `workers` processes, a Dask `scheduler` or an `executor` (see `cpcal.certify`) decide the boxes of each round;
        the answer is the same. It pays where a box takes some tenths of a millisecond or more.

        `checkpoint` names a file that says every few seconds, and at a stop, where the search stands; with `resume` it
        goes on from there, to the answer that it would have had. The file goes when all is decided. Limits are of each
        call. Raises InputError for a file that is cut off, or of another problem or other options.
        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        Raises PluginError for a contractor or strategy that is not there, ModelError for what has no meaning.
        """
        limit = checked_limits(limits, seconds=time_limit, nodes=node_limit)
        network, clock = self._as_asked(), limit.clock()
        engine = get_arithmetic(arithmetic)
        chooses = contractors is None and strategy is None
        with compiling_until(clock.deadline):
            choice = choice_to_solve(network, clock.deadline) if chooses else Choice(AS_ASKED, "as asked for")
        priority, inside = named_order(network, order), Inside(network, engine) if inner else None
        built: dict[SearchMethod, list[tuple[str, Contractor]]] = {}
        options = (contractors, strategy, order, inner, width, arithmetic)
        keeper = PavingCheckpoint(checkpoint, network, options, resume=resume)

        def contracting(method: SearchMethod) -> Contractor:
            names = method.contractors if chooses else DEFAULT_CONTRACTORS if contractors is None else contractors
            parts = plugins.build_each(choice.rows(network, method), names, arithmetic=arithmetic)
            built[method] = list(zip(map(plugins.name_of, names), parts, strict=True))
            contractor = in_sequence(parts)
            if network.whole.any():
                contractor = Repeat(Then(contractor, WholeNumbers(network.whole)))  # a point must be looked at again
            until(contractor, clock.deadline)
            return contractor

        left = partial(_contracted, contracting, choice.methods[0], network.domain)
        with compiling_until(clock.deadline):
            finest, reach, unit = resolution(network, left, width)

        def search(method: SearchMethod, spread: Callable[[Divide], Process]) -> Search:
            by = named_strategy(network, strategy or method.strategy, finest, reach, unit, arithmetic)
            process = Divide(contracting(method), by, inside=inside, outside=inner)
            roots, batch = [network.domain], process.batch
            return Search(roots, spread(process), priority, outside=inner, abreast=_ABREAST, batch=batch)

        there = spread_over(executor_for(workers, scheduler, executor, loads=_LOADS))
        with heard(), linear_algebra_on_one_thread(), there as spread, compiling_until(clock.deadline):
            race = Race(
                [Contender(m.name, partial(search, m, spread), m.slice, m.turns, m.begins) for m in choice.methods]
            )
            nodes = raced(race, keeper, clock, progress)
            found = race.leader.search or search(choice.methods[0], spread)
            keeper.end(complete=not found.waiting)
            paving = conclusion(found, UniquenessProver(network, engine, deadline=clock.deadline), clock, nodes)
            used = row_use(network, built[choice.methods[race.contenders.index(race.leader)]])
        said = f"{choice.why}: {race.sentence()}" if chooses else choice.why
        said += width_sentence(finest, reach) if width is None else ""
        return replace(paving, method=said, width=finest, row_use=used)

    @_or_late(_no_minimum)
    def minimize(
        self,
        objective: Expr,
        *,
        contractors: Sequence[str | Contractor] | None = None,
        arithmetic: str = "float64",
        limits: Limits | None = None,
        time_limit: float | None = None,
        node_limit: int | None = None,
        gap: float | None = None,
        start: npt.ArrayLike | None = None,
        progress: Callable[[Bracket], None] | None = None,
        relax: float = 0.0,
        certificate: str | os.PathLike[str] | None = None,
        about: str = "",
        workers: int | None = None,
        scheduler: str | None = None,
        executor: Executor | Client | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
        resume: bool = False,
    ) -> Minimum:
        """The smallest value of `objective`, a scalar expression over this network, bracketed by proofs.

        An expression that is no variable becomes one, "objective", the last of the answer's boxes: it is at least the
        expression, and its first bounds come from interval evaluation. `start` holds one value per component in the
        order of `names`. Raises ModelError for an objective without finite bounds.

        `time_limit`, `node_limit` and `gap` are `limits=Limits(seconds=..., nodes=..., gap=...)`, as in `solve`.

        `relax`: equations need hold to this only, as ibexopt has it (1e-8 there). The answer, and its status, are then
        about the relaxed problem, whose lower bound is one of the problem itself too. 0 asks for exact equations: their
        solutions are proved to exist.

        `certificate` names a file for the proof, which states the constraints exactly, and `about` in words what they
        are. The answer is then what the
        certificate proves, by the steps of contractors that give weights (lifted); what all contractors prove beyond
        it is in `found`. It is checked before it is written. Where equations hold at no float64 point, it proves the
        lower bound alone: the verdict is NOT_CERTIFIED then. `workers`, `scheduler`, `executor`, `checkpoint` and
        `resume` are as in `solve`; certificates are the same, byte for byte. Constraints with readings or without
        polynomial form raise ModelError. Where it cannot be written, or the checker would refuse it, UncertifiedError
        is raised, whose `answer` is what was found.
        A contractor given as an object states the constraints of the network that it was built for: whoever passes it
        says that they hold here.
        """
        limit = checked_limits(limits, seconds=time_limit, nodes=node_limit, gap=gap)
        network, clock = self._as_asked(), limit.clock()
        engine, exact, why = get_arithmetic(arithmetic), certificate is not None, "asked for"
        with compiling_until(clock.deadline):
            network, name = with_objective(relaxed(network, relax), objective)
            stated, origin = with_products(network, instead=exact)
            if contractors is None:
                contractors, why = CERTIFYING if exact else choice_to_minimize(stated, clock.deadline)
            network._check_bounded(name, contractors, chosen=why != "asked for")
            named = named_contractors(network, stated, name, contractors, arithmetic, clock.deadline, exact=exact)
        first = None if start is None else start_point(network, start, len(self.names))
        options = (list(contractors), arithmetic, limit.gap, limit.gap_absolute, first, relax, exact)
        of = {} if checkpoint is None else checkpoint_of(network, options)
        recorded = Recording(network_statement(stated, name, about), network.domain) if exact else nullcontext()
        with heard(), recorded as recording:
            keeper = SearchKeeper(None if checkpoint is None else Path(checkpoint), of, recording, resume=resume)
            before = keeper.resumed()
            with linear_algebra_on_one_thread(), executor_for(workers, scheduler, executor, loads=_LOADS) as place:
                states = minimize(
                    network,
                    name,
                    named,
                    engine=engine,
                    limits=remaining(clock, 0 if before is None else before.nodes),
                    start=first,
                    prover=None if recording is None else recording.prover,
                    observe=None if recording is None else recording.event,
                    resume=before,
                    keep=keeper,
                    place=None if isinstance(place[0], Here) else place,
                )
                found = run(states, progress)
                keeper.end(found)
            status = found.status + (f" Equations were relaxed to within {numbers.stated(relax)}." if relax else "")
            method = f"{', '.join(called for called, _ in named)}: {why}"
            used = row_use(network, named[: len(contractors)], origin)
            found = replace(found, status=status, relax=float(relax), names=network.names, method=method, row_use=used)
            if certificate is not None and recording is not None:
                found = certified(recording, certificate, found, network.domain, name)
            keeper.done(found)
            return found

    def _as_asked(self) -> Network:
        """A copy, since a callback may add to this network meanwhile. Raises ModelError where there is no variable."""
        if not self.names:
            raise ModelError(
                f"{self.name!r} has no variables: declare one with variable(name) before you ask for values"
            )
        return copy(self)

    def _check_bounded(self, objective: str, contractors: Sequence[str | Contractor], *, chosen: bool) -> None:
        """That all domains are bounded, by the constraints at least; whoever names hc4 answers for that."""
        if "hc4" in contractors and not chosen:
            return
        box = self.contract(contractors=["hc4"]).box if "hc4" in contractors else self.domain
        names = [n for n in self.names if n != objective and not box.is_empty and not box[n].is_bounded]
        if names:
            or_else = "" if chosen else ", or put hc4 first"
            raise ModelError(f"minimize needs bounded domains, and has none for {listed(names)}: give one{or_else}")


def _contracted(contracting: Callable[[SearchMethod], Contractor], method: SearchMethod, box: Box) -> Box:
    """What the contractors of a method leave of a box."""
    return contracted(contracting(method), box).box
